"""Lines that make a bed certain against others of the same length, really scanned.

On each virtual patient, after one pass, step 10 searches a bed; the limit is then set such that it
holds with P = 0.9, so that the bed is in doubt. Each kind of lines is planned, certified and
executed by the virtual robot, the probe leaning alike, and the bed is judged again on the new maps
where it lies.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.random import Generator

from benchmarks.cases.patients import to_stage
from benchmarks.metric import Metric, Progress
from rona_core.app.procedure import stages
from rona_core.app.runtime.handling import read_inputs
from rona_core.app.steps.implant.derivation import (
    BedInputs,
    ImplantBed,
    LinesInputs,
    find_bed_lines,
    hearing_around,
    search_bed,
)
from rona_core.app.steps.implant.messages import StartBedLines, StartBedSearch
from rona_core.app.steps.implant.view import floor_base
from rona_core.app.steps.maps.inputs import drawn_maps
from rona_core.app.steps.maps.messages import Row, StartMapping, StartTiltPlan, StartTiltScan
from rona_core.compose import build_virtual_rig, new_workbench
from rona_core.devices.protocols import never, silent
from rona_core.errors import InvalidInputError, RonaError
from rona_core.evaluation.map_metrics import residual_mm
from rona_core.evaluation.truth import truth_of
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import Maps
from rona_core.planning.further_lines import Hearing
from rona_core.planning.placement.figures import chance_above
from rona_core.session.document import Derived, Session

SEEDS = range(42_080, 42_106)
ONE_PASS = stages("burr", skip=("tilts", "tilted"))
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
KINDS = ("best lines", "random lines", "even rows over the map", "even rows over the bed")
DOUBT = 0.9  # P of each bed before
DRAWS = 400
ROUNDS = 20  # of finding a limit: halves of its range

Rows = list[tuple[Floats, Floats]]  # start and end of each, in cells


@dataclass(frozen=True, slots=True)
class Judged:
    """A bed as the maps of some passes tell it."""

    probability: float  # that it keeps its limit
    sigma_mm: float  # of the least bone
    risk: float  # expected cost of the better of milling it and giving it up, see `_risk`
    off_mm: float | None  # least bone by the maps less the true one


@dataclass(frozen=True, slots=True)
class LineFigures:
    """One bed before and after a pass along each kind of lines; None: the robot could not."""

    before: Judged
    explained_share: (
        float  # of the variance of the least bone, that the best lines were said to tell
    )
    after: dict[str, Judged | None]


def run(progress: Progress) -> list[Metric]:
    """Return by how much each kind of lines lowers the risk of a bed."""
    found: list[LineFigures] = []
    for session in to_stage(progress, SEEDS, FILES, ONE_PASS):
        one = line_figures(session)
        if one is not None:
            found.append(one)
    return list(metrics(found))


def line_figures(session: Session) -> LineFigures | None:
    """Return the figures of one patient; None where no bed lies in the maps."""
    if session.results.maps is None:
        return None
    try:
        known = read_inputs(BedInputs, session)
        held = search_bed(known, StartBedSearch(), progress=silent, cancel=never)
    except InvalidInputError:  # larger than what is mapped
        return None
    if held.placed is None or held.placed.residual_mm is None:
        return None
    hearing = _heard(session, held)
    shift_mm = _limit_shift_mm(hearing.least_mm)
    held = replace(held, limit_mm=max(held.limit_mm + shift_mm, 0.0))
    around = read_inputs(LinesInputs, _holding(session, held))
    best = find_bed_lines(around, StartBedLines(), progress=silent, cancel=never)
    maps: Maps = session.results.maps.value
    generator = np.random.default_rng(session.setup.seed)
    length_mm = best.length_mm
    ways: dict[str, Callable[[], tuple[Row, ...]]] = {
        "best lines": lambda: best.rows,
        "random lines": lambda: _in_mm(maps, random_rows(maps.outer.ok, length_mm, generator)),
        "even rows over the map": lambda: _in_mm(maps, closer_rows(maps, length_mm)),
        "even rows over the bed": lambda: even_rows(hearing.places_mm, length_mm),
    }
    after = {name: _scanned(session, held, ways[name]()) for name in KINDS}
    return LineFigures(_judged(session, held), best.explained_share, after)


def metrics(found: Sequence[LineFigures]) -> Iterator[Metric]:
    """Yield risk and spread of the least bone before, and after each kind of lines."""
    if not found:
        return
    yield from _metrics(f"before, {len(found)} beds", [one.before for one in found])
    told = float(np.mean([one.explained_share for one in found]))
    yield Metric("best lines: share of the variance said to be told", told, "1", "higher")
    for kind in found[0].after:
        known = [one.after[kind] for one in found]
        made = [one for one in known if one is not None]
        yield from _metrics(f"{kind}, {len(made)} beds", made)


def even_rows(places_mm: Floats, length_mm: float) -> tuple[Row, ...]:
    """Return rows to and fro over places (m, 2) in cells of 1 mm, as close as the length allows."""
    pitch = max(1.0, len(places_mm) / length_mm)
    levels = np.arange(places_mm[:, 1].min() + 0.5 * pitch, places_mm[:, 1].max(), pitch)
    rows: list[Row] = []
    for k, level in enumerate(levels.tolist()):
        there = places_mm[np.abs(places_mm[:, 1] - level) <= 0.5]
        (low, v), (high, to_v) = there[there[:, 0].argmin()], there[there[:, 0].argmax()]
        first, last = (float(low), float(v)), (float(high), float(to_v))
        rows.append((first, last) if k % 2 == 0 else (last, first))
    return tuple(rows)


def _metrics(title: str, judged: Sequence[Judged]) -> Iterator[Metric]:
    if not judged:
        return
    sigma, risk = (float(np.mean([getattr(j, k) for j in judged])) for k in ("sigma_mm", "risk"))
    off = [one.off_mm for one in judged if one.off_mm is not None]
    chance = float(np.mean([one.probability for one in judged]))
    yield Metric(f"{title}: P", chance, "1", "higher")
    yield Metric(f"{title}: least bone, sigma", sigma, "mm", "lower")
    yield Metric(f"{title}: risk of the bed", risk, "beds given up", "lower")
    rms = float(np.sqrt(np.mean(np.square(off)))) if off else None
    yield Metric(f"{title}: least bone off the true one, RMS", rms, "mm", "lower")


def _scanned(session: Session, held: ImplantBed, rows: tuple[Row, ...]) -> Judged | None:
    bench = new_workbench(session)
    try:
        for message in (StartTiltPlan(rows=rows), StartTiltScan(), StartMapping()):
            bench.run(message)
        return _judged(bench.session, held)
    except RonaError:
        return None
    finally:
        bench.close()


def _heard(session: Session, held: ImplantBed) -> Hearing:
    draws = drawn_maps(session, DRAWS, same_robot=True, grooves=True)
    return hearing_around(read_inputs(LinesInputs, _holding(session, held)), draws)


def _judged(session: Session, held: ImplantBed) -> Judged:
    least = _heard(session, held).least_mm
    chance = chance_above(least, 0.0).probability
    true = residual_mm(floor_base(held), truth_of(session, build_virtual_rig(session.setup).scene))
    off = None if true is None else float(np.median(least)) + held.limit_mm - true
    return Judged(chance, float(least.std()), _risk(chance, held.required), off)


def _limit_shift_mm(least_mm: Floats) -> float:
    """Return by how much the limit has to rise, so that draws (n,) keep it with the P of doubt."""
    low, high = -10.0, 10.0
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        sure = chance_above(least_mm, middle).probability > DOUBT
        low, high = (middle, high) if sure else (low, middle)
    return low


def _risk(kept: float, required: float) -> float:
    """Return the expected cost of the better choice, in good beds that are given up."""
    return min(kept, required / (1.0 - required) * (1.0 - kept))


def _holding(session: Session, held: ImplantBed) -> Session:
    """Return the session with a bed as if it had been searched."""
    return session.with_result("bed", Derived(held, StartBedSearch.__name__, {}, {}))


def _in_mm(maps: Maps, rows: Rows) -> tuple[Row, ...]:
    """Return rows in cells as they are in the plane of the map."""
    outer = maps.outer
    cell_mm, origin = outer.u_mm[1] - outer.u_mm[0], np.array((outer.u_mm[0], outer.v_mm[0]))
    made: list[Row] = []
    for row in rows:
        (u, v), (to_u, to_v) = (origin + cell_mm * np.array(row)).tolist()
        made.append(((u, v), (to_u, to_v)))
    return tuple(made)


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
