"""Run a study: all patients of its plan that have no row yet, then the sessions that it keeps."""

import math
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from rona_core.errors import RonaError
from rona_core.study.engines import Engine, WorkerDiedError
from rona_core.study.folder import StudyFolder
from rona_core.study.patient import Row, failed, row_of, run_row, run_session
from rona_core.study.plan import Plan

FEWEST = 3  # patients before a remaining time is stated
TWO_SIGMA = 2.0


@dataclass(slots=True)
class Progress:
    """How far a study is, and how long it will take by what its patients have taken."""

    total: int
    before: int  # patients that had their row already
    failures: int
    workers: int
    seconds: list[float] = field(default_factory=list)  # of each patient of this run
    begun_s: float = field(default_factory=time.monotonic)

    @property
    def done(self) -> int:
        """Patients that have their row."""
        return self.before + len(self.seconds)

    def remaining_s(self) -> tuple[float, float] | None:
        """Return bounds of about 95 % on the seconds that are left; None: too few to say.

        The mean of the patients so far for each that is left, by the share of the workers' time
        that was used so far; the bounds by the scatter of the patients, of those to come and of
        the mean.
        """
        count, left = len(self.seconds), self.total - self.done
        if left == 0:
            return 0.0, 0.0
        if count < max(FEWEST, self.workers + 1):
            return None
        passed_s = time.monotonic() - self.begun_s
        busy = min(max(sum(self.seconds) / passed_s, 1e-9), float(self.workers))
        scatter_s = float(np.std(self.seconds, ddof=1)) * math.sqrt(left + left**2 / count)
        mean_s = left * float(np.mean(self.seconds))
        low_s, high_s = mean_s - TWO_SIGMA * scatter_s, mean_s + TWO_SIGMA * scatter_s
        return max(low_s, 0.0) / busy, high_s / busy


Watch = Callable[[Progress], None]


def run_study(plan: Plan, out: Path, engine: Engine, watch: Watch) -> Path:
    """Run what is left of a study and write its table.

    Whatever ends it, every patient that was finished keeps its row, and the same call goes on.

    Args:
        plan: Of the study.
        out: Its folder.
        engine: What runs the patients.
        watch: Called before the first patient and after each.

    Returns:
        The path of the table.

    Raises:
        NameTakenError: another study is writing there.
        RonaError: no patient can be run: a worker of another version, a scheduler that has gone.
    """
    folder = StudyFolder(out)
    with folder.held(plan):
        rows = folder.rows(plan)
        try:
            _run_patients(plan, folder, engine, rows, watch)
            _keep_sessions(plan, folder, engine, list(rows.values()))
        finally:
            in_order = [rows[one.key] for one in plan.patients() if one.key in rows]
            table = folder.write_table(plan, in_order)
    return table


def _run_patients(
    plan: Plan, folder: StudyFolder, engine: Engine, rows: dict[str, Row], watch: Watch
) -> None:
    patients = plan.patients()
    left = [patient for patient in patients if patient.key not in rows]
    failures = sum(is_failure(row) for row in rows.values())
    progress = Progress(len(patients), len(rows), failures, engine.workers())
    watch(progress)
    for patient, row in engine.each(run_row, left):
        if isinstance(row, WorkerDiedError):
            row = row_of(patient, failed(None, row.code, str(row)))
        folder.write_row(row)
        rows[patient.key] = row
        progress.seconds.append(row.get("wall_s") or row.get("cpu_s") or 0.0)
        progress.failures += is_failure(row)
        progress.workers = engine.workers()
        watch(progress)


def _keep_sessions(plan: Plan, folder: StudyFolder, engine: Engine, rows: Sequence[Row]) -> None:
    """Make the sessions that the rules keep: run again, a patient comes out with the same bits."""
    keys = {str(row["key"]) for rule in plan.keep for row in rule.chosen(rows)}
    folder.keep_sessions(list(keys))
    wanted = [p for p in plan.patients() if p.key in keys and not folder.session(p.key).is_file()]
    for patient, data in engine.each(run_session, wanted):
        if not isinstance(data, RonaError):
            folder.write_session(patient.key, data)


def is_failure(row: Row) -> bool:
    """Return whether a patient did not come to the end of the procedure."""
    return row.get("completed") is not True


def failures_of(rows: Sequence[Row]) -> list[tuple[str, str, int, str]]:
    """Return step, code, count and the first reason of each kind of failure, most first."""
    failures = [row for row in rows if is_failure(row)]
    kinds = Counter((str(r.get("failed_step")), str(r.get("failure_code"))) for r in failures)
    reasons = {
        (str(r.get("failed_step")), str(r.get("failure_code"))): str(r.get("reason"))
        for r in reversed(failures)
    }
    return [(*kind, count, reasons[kind]) for kind, count in kinds.most_common()]
