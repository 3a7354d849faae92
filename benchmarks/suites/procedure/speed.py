"""CPU time of the procedure and of its parts in a nominal world, in yardsticks of the same run.

A yardstick is a fixed piece of work of numpy (``benchmarks/reference/yardstick.py``), so that goals
hold on any machine; seconds of this machine stand beside. Goals given in seconds are those of the
machine on which a yardstick takes ``REFERENCE_S``.
"""

import statistics
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from time import process_time
from typing import Any

from benchmarks.cases.growth import growths, tracker_frames
from benchmarks.metric import Metric, Progress, cpu_ms
from benchmarks.reference.yardstick import REFERENCE_S, Yardstick, pair
from benchmarks.timed_procedure import (
    CAPTURES,
    NOMINAL_SETUP,
    TimedProcedure,
    keep_imports,
    share_metrics,
    timed_procedure,
)
from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.derivation import ROBOT_PROBE
from rona_core.app.steps.maps.derivation import Survey, detect_survey
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.derivation import POSES, SCAN
from rona_core.app.steps.scan.force_controlled_scan import ContactLoop
from rona_core.compose import build_virtual_rig
from rona_core.devices.protocols import never, silent
from rona_core.session.document import Session
from rona_core.virtual.acoustics.probe import VirtualProbe

SEEDS = range(10)
# Commit 9d90310, the last one before the virtual world was put into batches: CPU time of
# `run_demo(seed)` over the median of yardsticks laid between its steps, median of the seeds 0 to 9
# (23.7 s; the shortest 21.0, the longest 38.4), one process a seed, in turn with a later program.
# A yardstick took `REFERENCE_S` there.
BEFORE_YARDSTICKS = 304.5
FASTER = 5.0
CAPTURE_S, FRAME_S, LOOP_STEP_S, SCANS_PER_S = 1.5, 60e-6, 0.4e-3, 1300.0
FRAMES = 4096


@dataclass(slots=True)
class Spent:
    """CPU time in a function, in s."""

    cpu_s: float = 0.0


@contextmanager
def spent_in(owner: type, name: str) -> Generator[Spent]:
    """Measure what a method takes while this lasts."""
    spent, method = Spent(), getattr(owner, name)

    def measured(*args: Any, **named: Any) -> Any:
        start = process_time()
        try:
            return method(*args, **named)
        finally:
            spent.cpu_s += process_time() - start

    setattr(owner, name, measured)
    try:
        yield spent
    finally:
        setattr(owner, name, method)


def run(progress: Progress) -> list[Metric]:
    """Return times of whole procedures, of their parts, of single devices, and how they grow."""
    done: list[TimedProcedure] = []
    loop_steps = 0
    keep_imports()
    with ExitStack() as stack:
        loop = stack.enter_context(spent_in(ContactLoop, "run"))
        fired = stack.enter_context(spent_in(VirtualProbe, "collect"))
        for seed in SEEDS:
            progress(f"procedure, seed {seed}")
            done.append(timed_procedure(seed))
            loop_steps += _loop_steps(done[-1].session)
    step_s = (loop.cpu_s - fired.cpu_s) / loop_steps
    yardstick_s = statistics.median(timed.yardstick_s for timed in done)
    metrics = [*_whole(done), *_captures(done), *share_metrics(done[0])]
    metrics += pair("step of the contact loop, without A-scans", step_s, yardstick_s, LOOP_STEP_S)
    progress("frames and A-scans")
    metrics += [*_frame(), *_detection(done[0].session)]
    progress("growth")
    return metrics + growths(done[0].session)


def _whole(done: Sequence[TimedProcedure]) -> list[Metric]:
    in_yardsticks = statistics.median(timed.total_s / timed.yardstick_s for timed in done)
    name = f"whole procedure (median of {len(done)})"
    goal = BEFORE_YARDSTICKS / FASTER
    return [
        Metric(name, in_yardsticks, "yardsticks", "lower", goal, "9d90310", BEFORE_YARDSTICKS),
        Metric(
            f"{name}, absolute", statistics.median(timed.total_s for timed in done), "s", "lower"
        ),
        Metric("times as fast as 9d90310", BEFORE_YARDSTICKS / in_yardsticks, "", "higher", FASTER),
        Metric("yardstick", statistics.median(timed.yardstick_s for timed in done), "s", "lower"),
    ]


def _captures(done: Sequence[TimedProcedure]) -> list[Metric]:
    """Return what each capture takes, with what is computed from it at once."""
    metrics: list[Metric] = []
    for part in CAPTURES:
        times = [(t.cpu_s[part], t.yardstick_s) for t in done if part in t.cpu_s]
        if times:
            ratio = statistics.median(spent_s / unit_s for spent_s, unit_s in times)
            unit_s = statistics.median(unit_s for _, unit_s in times)
            metrics += pair(f"capture, {part}", ratio * unit_s, unit_s, CAPTURE_S)
    return metrics


def _loop_steps(session: Session) -> int:
    """Return how many steps of the contact loop both scans recorded."""
    scans = (session.captures.scan, *session.captures.second)
    return sum(len(s.forces.times_s) for s in scans if s is not None and s.forces is not None)


def _frame() -> list[Metric]:
    rig, yardstick = build_virtual_rig(NOMINAL_SETUP), Yardstick()
    frame_s = 1e-3 * cpu_ms(lambda: tracker_frames(rig, FRAMES)) / FRAMES
    yardstick.lay()
    return pair("frame of five tools in batch", frame_s, yardstick.median_s, FRAME_S)


def _detection(session: Session) -> list[Metric]:
    """Return how fast both boundaries are found in the A-scans of a session."""
    scans, message = required(SCAN, session).scans, StartMapping()
    excitation = session.setup.devices.probe.excitation
    probe = required(ROBOT_PROBE, session)
    survey = Survey(scans, required(POSES, session), probe, excitation)
    yardstick = Yardstick()
    spent_s = 1e-3 * cpu_ms(lambda: detect_survey(survey, message, progress=silent, cancel=never))
    yardstick.lay()
    per_s = len(scans) / spent_s
    return [
        Metric(
            "A-scans in a yardstick",
            per_s * yardstick.median_s,
            "",
            "higher",
            SCANS_PER_S * REFERENCE_S,
        ),
        Metric("A-scans, absolute", per_s, "1/s", "higher"),
    ]
