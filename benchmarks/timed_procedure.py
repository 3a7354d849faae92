"""CPU time of one procedure with virtual devices, message by message."""

import gc
import json
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import process_time

from benchmarks.metric import Metric
from benchmarks.reference.yardstick import Yardstick
from rona_core.app.procedure import TO_MAPS, run_procedure
from rona_core.app.steps.setup.messages import SetSeed, SetWorld
from rona_core.compose import new_workbench
from rona_core.devices.world_settings import NOMINAL_WORLD
from rona_core.session.document import Session, Setup

STAGES = TO_MAPS
NOMINAL_SETUP = Setup(world=NOMINAL_WORLD)  # so that figures compare with those of before
PARTS = {  # stage -> part, where it is called otherwise
    "gauge": "gauge plate",
    "detection": "maps",
    "tilts": "second plan",
    "tilted": "second scan",
    "caliper": "references",
    "maps": "second maps",
}
CAPTURES = ("tool", "pointer", "surface", "path", "scan", "second scan")
# share of each step in the CPU time of the procedure; `make profile KEEP=1` writes it anew
KEPT_SHARES = Path(__file__).parent / "reference" / "step_shares.json"
DOUBLED = 2.0
SMALL_SHARE = 0.01  # a step that takes less than this of the whole may do as it likes


@dataclass(frozen=True, slots=True, eq=False)
class TimedProcedure:
    """One procedure and what each part of it took."""

    session: Session
    cpu_s: Mapping[str, float]  # part -> CPU time in s, in their order
    yardstick_s: float  # CPU time of one yardstick, measured between the parts

    @property
    def total_s(self) -> float:
        """CPU time of the whole procedure, in s."""
        return sum(self.cpu_s.values())

    def shares(self) -> dict[str, float]:
        """Return the share of each part in the whole."""
        return {part: spent_s / self.total_s for part, spent_s in self.cpu_s.items()}


def keep_imports() -> None:
    """Take what was imported out of the search for garbage, as ``rona`` does when it starts."""
    gc.collect()
    gc.freeze()


def timed_procedure(seed: int) -> TimedProcedure:
    """Carry out the procedure of ``rona demo`` in a nominal world, and time it.

    Yardsticks are laid between its parts.
    """
    cpu_s: dict[str, float] = {}
    yardstick = Yardstick()

    @contextmanager
    def part(name: str) -> Generator[None]:
        start = process_time()
        yield
        cpu_s[name] = cpu_s.get(name, 0.0) + process_time() - start
        yardstick.lay()

    with part("setup"):
        bench = new_workbench(Session(name=f"timed, seed {seed}"))
        bench.dispatch(SetSeed(seed))
        bench.dispatch(SetWorld(profile="nominal"))
        bench.rig()
    try:
        for stage in STAGES:
            with part(PARTS.get(stage.name, stage.name)):
                ending = run_procedure(bench, (stage,))
            if not ending.completed:
                break
        with part("evaluation"):
            bench.figures()
    finally:
        bench.close()
    return TimedProcedure(bench.session, cpu_s, yardstick.median_s)


def kept_shares() -> dict[str, float]:
    """Return the share of each part when it was last kept."""
    return dict(json.loads(KEPT_SHARES.read_text("utf-8")))


def keep_shares(timed: TimedProcedure) -> None:
    """Keep the shares of a procedure for later ones to be compared with."""
    kept = {part: round(share, 4) for part, share in timed.shares().items()}
    KEPT_SHARES.write_text(json.dumps(kept, indent=2) + "\n", "utf-8")


def share_metrics(timed: TimedProcedure) -> list[Metric]:
    """Return the share of each part, with the goal that it has not doubled since it was kept."""
    kept = kept_shares()
    goals = {part: DOUBLED * max(share, SMALL_SHARE / DOUBLED) for part, share in kept.items()}
    return [
        Metric(
            f"share of CPU, {part}",
            share,
            "share",
            "lower",
            goals.get(part),
            "kept",
            kept.get(part),
        )
        for part, share in timed.shares().items()
    ]
