"""Balanced design: which tracker, robot and pointer a seed is judged with."""

from dataclasses import dataclass

from rona_core.app.procedure import TO_MAPS, Stages, run_procedure
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.setup.messages import (
    SetPointer,
    SetProbe,
    SetRobot,
    SetSeed,
    SetTracker,
    SetWorld,
)
from rona_core.compose import new_workbench
from rona_core.devices.settings import PointerKind, ProbeSettings, TrackerProfile
from rona_core.errors import RonaError
from rona_core.session.document import Session

TRACKERS: tuple[TrackerProfile, ...] = ("polaris", "spectra", "vega", "white035")
ROBOTS = ("rx90", "ur5", "ur10")
POINTERS: tuple[PointerKind, ...] = ("pointer6d", "pointer5d")


@dataclass(frozen=True, slots=True)
class Levels:
    """Devices of one session."""

    tracker: TrackerProfile
    robot: str
    pointer: PointerKind


def levels_of(seed: int) -> Levels:
    """Return the devices of a seed: any 24 seeds in a row meet every combination once.

    Every 8 in a row meet each tracker with each pointer once, every 12 each tracker and robot.
    """
    return Levels(
        TRACKERS[seed % len(TRACKERS)],
        ROBOTS[seed % len(ROBOTS)],
        POINTERS[seed // len(TRACKERS) % len(POINTERS)],
    )


def bench_of(seed: int, probe: str = ProbeSettings().name) -> Workbench:
    """Return a workbench in the realistic world of a seed with the devices of the design."""
    levels = levels_of(seed)
    bench = new_workbench(Session(name=f"honesty, seed {seed}"))
    for message in (
        SetSeed(seed),
        SetWorld(profile="realistic"),
        SetTracker(profile=levels.tracker),
        SetRobot(model=levels.robot),
        SetPointer(levels.pointer),
        SetProbe(name=probe),
    ):
        bench.dispatch(message)
    return bench


def session_of(seed: int, probe: str = ProbeSettings().name, among: Stages = TO_MAPS) -> Session:
    """Return the session of a seed after these stages of the procedure with a probe.

    Raises:
        RonaError: the procedure did not come to its end.
    """
    bench = bench_of(seed, probe)
    try:
        ending = run_procedure(bench, among)
        session = bench.session
    finally:
        bench.close()
    if not ending.completed:
        raise RonaError(f"step {ending.failed_step}: {ending.reason}")
    return session
