"""``rona study``: many virtual patients by a plan, how far they are, and their report."""

import os
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bars

from rona_core.errors import InvalidInputError
from rona_core.session.files import write_whole
from rona_core.study.beds import beds_file
from rona_core.study.engines import opened
from rona_core.study.folder import StudyFolder
from rona_core.study.markdown import study_markdown
from rona_core.study.plan import read_plan
from rona_core.study.report import study_report
from rona_core.study.study import Progress, failures_of, run_study

REPORT, MARKDOWN, BEDS = "report.html", "report.md", "beds.json"
NO_BEDS = (
    "no beds.json: it takes a study to the search of a bed whose patients differ by seed alone\n"
)
MINUTE_S, HOUR_S = 60.0, 3600.0
LEAST_IN_MINUTES_S, LEAST_IN_HOURS_S = 90.0, 5400.0


def run(wanted: Any) -> int:
    """Run the patients of a plan, or say how far they are, or write what they say together."""
    if wanted.what == "status":
        return _status(_folder(wanted))
    if wanted.what == "report":
        return _report(_folder(wanted))
    if wanted.folder is not None or wanted.out is None:
        raise InvalidInputError("expected: rona study PLAN.toml --out FOLDER")
    if wanted.workers is not None and wanted.workers < 1:
        raise InvalidInputError(f"--workers must be at least 1, not {wanted.workers}")
    return _run(wanted)


def _folder(wanted: Any) -> StudyFolder:
    if wanted.folder is None:
        raise InvalidInputError(f"expected: rona study {wanted.what} FOLDER")
    return StudyFolder(wanted.folder)


def _run(wanted: Any) -> int:
    plan = read_plan(Path(wanted.what))
    workers = wanted.workers or os.cpu_count() or 1
    console = Console(stderr=True)
    try:
        with opened(wanted.scheduler, workers) as engine:
            console.print(f"{plan.title}: {len(plan.patients())} patients on {engine.words}")
            with _bar(console) as watch:
                table = run_study(plan, wanted.out, engine, watch)
    except KeyboardInterrupt:
        console.print("stopped; every finished patient is kept, and the same command goes on")
        raise
    sys.stdout.write(f"{table}\n")
    return _status(StudyFolder(wanted.out))


@contextmanager
def _bar(console: Console) -> Generator[Callable[[Progress], None]]:
    """Draw one bar for all patients; yields a function that receives how far they are."""
    columns = (
        MofNCompleteColumn(),
        BarColumn(40),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    with Bars(*columns, console=console) as bars:
        task = bars.add_task("")

        def watch(progress: Progress) -> None:
            words = f"{progress.failures} failed, {remaining_words(progress.remaining_s())}"
            bars.update(task, total=progress.total, completed=progress.done, description=words)

        yield watch


def remaining_words(bounds_s: tuple[float, float] | None) -> str:
    """Return a remaining time as it is shown: between two bounds, in a unit that fits."""
    if bounds_s is None:
        return "remaining time not known yet"
    low_s, high_s = bounds_s
    unit_s, unit = 1.0, "s"
    if high_s >= LEAST_IN_HOURS_S:
        unit_s, unit = HOUR_S, "h"
    elif high_s >= LEAST_IN_MINUTES_S:
        unit_s, unit = MINUTE_S, "min"
    digits = 1 if unit == "h" else 0
    low, high = f"{low_s / unit_s:.{digits}f}", f"{high_s / unit_s:.{digits}f}"
    return f"{low} to {high} {unit} left" if low != high else f"{high} {unit} left"


def _status(folder: StudyFolder) -> int:
    plan = folder.plan()
    total, rows = len(plan.patients()), list(folder.rows(plan).values())
    failures = failures_of(rows)
    failed = sum(count for _, _, count, _ in failures)
    left = total - len(rows)
    lines = [f"{plan.title}: {len(rows)} of {total} patients done, {failed} failed, {left} left"]
    if rows:
        cpu_s = sum(float(row.get("cpu_s") or 0.0) for row in rows) / len(rows)
        to_come = f", {left * cpu_s / HOUR_S:.2g} h to come" if left else ""
        lines.append(f"CPU {cpu_s:.1f} s a patient{to_come}")
    lines += [f"{count} x {step}, {code}: {reason}" for step, code, count, reason in failures]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _report(folder: StudyFolder) -> int:
    """Write the report as a page and as Markdown, and the beds for the risk of one."""
    files = {
        REPORT: study_report(folder).encode("utf-8"),
        MARKDOWN: study_markdown(folder).encode("utf-8"),
        BEDS: beds_file(folder),
    }
    for name, data in files.items():
        if data is not None:
            out = write_whole(folder.path / name, data)
            sys.stdout.write(f"{out}  {len(data) / 1024:.0f} kB\n")
    if files[BEDS] is None:
        sys.stdout.write(NO_BEDS)
    return 0
