"""Faults between the passes of a scan: what the maps make of them.

The whole procedure with virtual devices up to the maps, over patients of the realistic world.
Before the third tilted pass something happens: the probe sits 0.3 mm further back in that pass
alone, slips in its holder, or the head moves in its clamp; what slipped or moved stays so. A fault
counts as corrected where the thickness is as good as without it, and as flagged where a figure that
needs no truth is to be reviewed or fails, and is not and does not without the fault.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.app.overview.acceptance import quality_rows
from rona_core.app.overview.predicted_accuracy import predicted_figures
from rona_core.app.procedure import TO_MAPS, run_procedure, stages
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.messages import StartTiltScan
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_virtual_rig, virtual_services
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.truth import rms, truth_of
from rona_core.geometry.pose import Pose
from rona_core.session.document import Session, Setup
from rona_core.session.files import load_session
from rona_core.virtual.rig import VirtualRig
from rona_core.virtual.world.world import World

SEEDS = range(63_000, 63_006)
FILES: tuple[Path, ...] = ()  # sessions with virtual devices that count as well
BEFORE = stages("tilts")
FAULTY = 2  # number of the tilted pass from 0
OFF_MM = 0.5
SOUND_MM = 0.05  # by which thicknesses may be worse than without a fault


@dataclass(frozen=True, slots=True)
class Fault:
    """What happens before a pass."""

    probe: Pose = field(default_factory=Pose.identity)  # as it sits now, in its frame before
    head_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)  # in ``base``
    stays: bool = True


FAULTS: Mapping[str, Fault | None] = {
    "no fault": None,
    "0.3 mm of stand-off in one pass": Fault(
        Pose.from_rotvec((0.0, 0.0, 0.0), (0.0, 0.0, -0.3)), stays=False
    ),
    "probe slipped by 1 mm and 1 degree": Fault(
        Pose.from_rotvec((np.deg2rad(1.0), 0.0, 0.0), (1.0, 0.0, 0.0))
    ),
    "head moved by 1 mm": Fault(head_mm=(0.6, 0.5, 0.6)),
}


@dataclass(frozen=True, slots=True)
class FaultFigures:
    """What the maps of one patient are like after a fault."""

    rms_mm: float  # of the thickness
    off: float  # share of the cells whose thickness is off by more than ``OFF_MM``
    coverage: float
    flags: frozenset[str]  # keys of figures to be reviewed or failed


@dataclass(frozen=True, slots=True, eq=False)
class _SlippedWorld(World):
    """A world whose probe is clamped elsewhere than before."""

    clamped: Pose

    @property
    def clamping(self) -> Pose:
        return self.clamped


def run(progress: Progress) -> list[Metric]:
    """Return for each fault how good the thickness is, and whether the fault is flagged."""
    found: dict[str, list[FaultFigures]] = {name: [] for name in FAULTS}
    for before in _before_the_fault(progress):
        for name, fault in FAULTS.items():
            made = _figures(_with_fault(before, fault))
            if made is not None:
                found[name].append(made)
    return list(_metrics(found))


def _bench(session: Session, fault: Fault | None = None) -> Workbench:
    services = virtual_services()
    if fault is not None:
        services = replace(services, build_rig=partial(_faulty_rig, fault=fault))
    return Workbench(session, services, Path.cwd())


def _faulty_rig(setup: Setup, fault: Fault) -> VirtualRig:
    rig = build_virtual_rig(setup)
    scene = rig.scene
    world = {one.name: getattr(scene.world, one.name) for one in fields(scene.world)}
    scene.world = _SlippedWorld(**world, clamped=scene.world.clamping @ fault.probe)
    moved = Pose.from_rotvec((0.0, 0.0, 0.0), fault.head_mm)
    scene.T_base_skull = moved @ scene.T_base_skull
    scene.T_base_headmarker = moved @ scene.T_base_headmarker
    return rig


def _before_the_fault(progress: Progress) -> Iterator[Session]:
    for seed in SEEDS:
        progress(f"seed {seed}")
        session = _scanned(seed)
        if len(session.captures.second) == FAULTY:
            yield session
    for path in FILES:
        progress(path.name)
        session = load_session(path)
        yield session.with_capture("second", session.captures.second[:FAULTY])


def _scanned(seed: int) -> Session:
    """Return a session with the tilted passes before the fault; without, where it ended earlier."""
    bench = _bench(Session(name=f"pass faults, seed {seed}"))
    bench.dispatch(SetSeed(seed))
    ended = run_procedure(bench, BEFORE)
    if ended.completed and not ended.left_out:
        for _ in range(FAULTY):
            bench.run(StartTiltScan())
    session = bench.session
    bench.close()
    return session


def _with_fault(before: Session, fault: Fault | None) -> Session:
    """Return the session with the remaining tilted passes and the maps."""
    planned = before.results.second
    session = before
    for number in range(FAULTY, 0 if planned is None else len(planned.value.passes)):
        bench = _bench(session, fault if fault and (fault.stays or number == FAULTY) else None)
        bench.run(StartTiltScan())
        session = bench.session
        bench.close()
    bench = _bench(session)
    run_procedure(bench, TO_MAPS)
    session = bench.session
    bench.close()
    return session


def _figures(session: Session) -> FaultFigures | None:
    made = session.results.maps
    if made is None:
        return None
    maps = made.value
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    errors_mm = cell_errors_mm(maps, truth)["thickness"]
    errors_mm = errors_mm[np.isfinite(errors_mm)]
    rows = quality_rows(predicted_figures(session), session)
    return FaultFigures(
        rms_mm=rms(errors_mm) or 0.0,
        off=float(np.mean(np.abs(errors_mm) > OFF_MM)),
        coverage=maps.inner_share,
        flags=frozenset(row.key for row in rows if row.verdict in ("review", "fail")),
    )


def _metrics(found: Mapping[str, list[FaultFigures]]) -> Iterator[Metric]:
    sound = found["no fault"]
    for name, made in found.items():
        errors_mm = [one.rms_mm for one in made] or [np.nan]
        yield Metric(f"thickness, {name}, median", float(np.median(errors_mm)), "mm", "lower")
        yield Metric(f"thickness, {name}, worst", max(errors_mm), "mm", "lower")
        off = max((one.off for one in made), default=np.nan)
        yield Metric(f"cells off by more than {OFF_MM:g} mm, {name}, worst", off, "share", "lower")
        coverage = min((one.coverage for one in made), default=np.nan)
        yield Metric(f"least coverage, {name}", coverage, "share", "higher")
        if name == "no fault":
            continue
        beside = list(zip(made, sound, strict=True))
        corrected = [one.rms_mm <= best.rms_mm + SOUND_MM for one, best in beside]
        flagged = [bool(one.flags - best.flags) for one, best in beside]
        either = [one or other for one, other in zip(corrected, flagged, strict=True)]
        for words, shares, goal in (
            ("corrected", corrected, None),
            ("corrected or flagged", either, 1.0),
        ):
            value = float(np.mean(shares)) if shares else None
            yield Metric(f"{words}, {name}", value, "share", "higher", goal)
