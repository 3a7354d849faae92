"""Where to scan next: lines over the gaps against others of the same length, really scanned.

Each kind of lines is planned, certified and executed by the virtual robot after the same first
pass, with the probe leaning alike; then the maps are made again as in step 9.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator

from benchmarks.metric import Metric
from rona_core.app.dependencies.staleness import input_digests, required
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.accuracy import map_accuracy
from rona_core.app.steps.maps.messages import StartGapPlan, StartGapScan, StartMapping
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.inputs import DRIVEN
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.compose import new_workbench
from rona_core.errors import RonaError
from rona_core.evaluation.truth import rms
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.second_pass import (
    SecondPassPath,
    SecondPassSettings,
    path_along,
    plan_second_pass,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.session.document import Derived, SecondPass, Session

LIMIT_MM = 0.3  # of the deviation that a cell's thickness has for itself
FIRST_PASS = stages("maps", skip=("gaps", "second"))
LEAST_FALL = 0.7  # of the share over the limit

Rows = list[tuple[Floats, Floats]]


@dataclass(frozen=True, slots=True)
class NextFigures:
    """Share of the outer map whose thickness is less sure than the limit, or not known at all."""

    before: float
    after: dict[str, float | None]  # by kind of lines; None where the robot could not follow them
    true_mm: dict[str, float | None]  # RMS error of the thickness where it is mapped, less its mean


def next_figures(bench: Workbench, seed: int) -> NextFigures | None:
    """Return the figures of one patient; None where there is nothing to scan again.

    Args:
        bench: With a set-up; the procedure is run in it up to the maps of the first pass.
        seed: Of the random lines.

    Raises:
        RonaError: the procedure did not come to its end.
    """
    ending = run_procedure(bench, FIRST_PASS)
    if not ending.completed:
        raise RonaError(f"step {ending.failed_step}: {ending.reason}")
    session = bench.session
    made, found = session.results.maps, session.results.detection
    if made is None or found is None:
        return None
    maps, speed = made.value, found.value.sound_speed_mm_per_us
    proposed = plan_second_pass(maps, speed)
    if proposed is None:
        return None
    length_mm = float(proposed.path.arc_length_mm()[-1])
    settings, generator = SecondPassSettings(), np.random.default_rng(seed)
    ways: Mapping[str, Callable[[], SecondPassPath]] = {
        "proposed": lambda: proposed,
        "random": lambda: path_along(
            maps, random_rows(maps.outer.ok, length_mm, generator), speed, settings
        ),
        "closer rows": lambda: path_along(maps, closer_rows(maps, length_mm), speed, settings),
    }
    after: dict[str, float | None] = {}
    true_mm: dict[str, float | None] = {}
    for name, way in ways.items():
        after[name], true_mm[name] = _scanned(session, way())
    return NextFigures(share_over(session), after, true_mm)


def metrics(found: Iterable[NextFigures]) -> list[Metric]:
    """Return by how much each kind of lines lets the share over the limit fall, and the errors."""
    cases = list(found)
    if not cases:
        return []
    before = float(np.mean([one.before for one in cases]))
    words = f"thickness not sure to {LIMIT_MM:g} mm"
    made = [Metric(f"next lines: share of the map with {words}, before", before, "share", "lower")]
    for kind in cases[0].after:
        known = [(one.before, one.after[kind], one.true_mm[kind]) for one in cases]
        pairs = [(was, now) for was, now, _ in known if now is not None]
        fall = 1.0 - sum(now for _, now in pairs) / sum(was for was, _ in pairs) if pairs else None
        errors = [error for *_, error in known if error is not None]
        goal = LEAST_FALL if kind == "proposed" and pairs else None
        title = f"next lines: {kind}, of {len(pairs)}"
        made.append(Metric(f"{title}: fall of that share", fall, "share", "higher", goal))
        size = float(np.sqrt(np.mean(np.square(errors)))) if errors else None
        made.append(Metric(f"{title}: thickness, own part, true", size, "mm", "lower"))
    return made


def share_over(session: Session, limit_mm: float = LIMIT_MM) -> float:
    """Return the share of the outer map whose thickness is not as sure as the limit."""
    made, accuracy = session.results.maps, map_accuracy(session)
    if made is None or accuracy is None:
        return 1.0
    maps: Maps = made.value
    sure = maps.inner.ok & (accuracy.thickness.whole_own_mm() <= limit_mm)
    return 1.0 - float(sure[maps.outer.ok].mean())


def _scanned(session: Session, way: SecondPassPath) -> tuple[float | None, float | None]:
    """Return the share over the limit after a pass along a way, and the RMS error in truth."""
    plan = plan_scan(
        way.path,
        robot_model(session.setup.devices.robot.model),
        plan_settings(required(DRIVEN, session), StartRollSearch()),
    )
    made = Derived(
        SecondPass(way, plan), StartGapPlan.__name__, {}, input_digests("second", session)
    )
    bench = new_workbench(session.with_result("second", made))
    try:
        bench.run(StartGapScan())
        bench.run(StartMapping())
        errors = bench.map_errors().errors_mm["thickness"]
        known = errors[np.isfinite(errors)]
        return share_over(bench.session), rms(known - known.mean()) if len(known) else None
    except RonaError:
        return None, None
    finally:
        bench.close()


def random_rows(ok: Bools, length_mm: float, generator: Generator) -> Rows:
    """Return straight lines between mapped cells drawn at random, as long together as wanted.

    Cells are 1 mm wide, as those of the maps are.
    """
    cells = np.argwhere(ok).astype(np.float64)
    rows: Rows = []
    at, left_mm = cells[generator.integers(len(cells))], length_mm
    while left_mm > 0.0:
        to = cells[generator.integers(len(cells))]
        size = float(np.linalg.norm(to - at))
        if size < 1.0:
            continue
        to = at + (to - at) * min(1.0, left_mm / size)
        rows.append((at, to))
        at, left_mm = to, left_mm - size
    return rows


def closer_rows(maps: Maps, length_mm: float) -> Rows:
    """Return rows to and fro over the whole map, as close as the wanted length allows."""
    cells = np.argwhere(maps.outer.ok).astype(np.float64)
    area = len(cells)  # mm², of cells of 1 mm
    pitch = max(1.0, area / length_mm)
    rows: Rows = []
    for k, level in enumerate(np.arange(cells[:, 0].min(), cells[:, 0].max() + 1e-9, pitch)):
        there = cells[np.abs(cells[:, 0] - round(level)) < 0.5, 1]
        if not len(there):
            continue
        low, high = np.array((level, there.min())), np.array((level, there.max()))
        rows.append((low, high) if k % 2 == 0 else (high, low))
    return rows
