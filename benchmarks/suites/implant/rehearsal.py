"""Rehearsed millings on virtual patients: what reaches the dura, and what the guards are worth.

Whole procedures of the realistic world with the simulated skull. On each patient the searched bed
is rehearsed, and others at its place that are too deep on purpose: by the maps they leave between
-0.8 and 0.4 mm of bone. Each is milled with all guards, with the force alone and with none. Nothing
was tuned on these seeds.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.cases.patients import to_stage
from benchmarks.metric import Metric, Progress
from benchmarks.suites.implant.placement import interval
from benchmarks.suites.implant.rehearsed_beds import Rehearsed, rehearsed
from rona_core.app.procedure import stages
from rona_core.geometry.arrays import Floats
from rona_core.planning.rehearsal.breakthrough import PAST_MM

SEEDS = range(39_156, 39_186)
FILES: tuple[Path, ...] = ()  # sessions with virtual devices and a bed that count as well
DEEP_BEDS = 9  # of each patient
TO_BED = stages("implant")
PLAIN_MM = 0.3  # past the inner boundary: a breakthrough that has to be felt
LATE_MM = 0.5  # past it: too late
SPARE_MM = 0.3  # of bone below a burr that was stopped: for nothing
BINS = (0.05, 0.3, 0.5, 0.7, 0.95, 1.0)  # of the probability that the burr is through


def run(progress: Progress) -> list[Metric]:
    """Return the figures."""
    found: list[Rehearsed] = []
    for session in to_stage(progress, SEEDS, FILES, TO_BED):
        seed = session.setup.seed
        found += rehearsed(seed, session, np.random.default_rng(seed), DEEP_BEDS)
    return list(figures(found))


def figures(found: Sequence[Rehearsed]) -> Iterator[Metric]:
    """Yield the figures of rehearsals."""
    safe = _of(found, "all guards")
    yield Metric("beds rehearsed", float(len(safe)), "beds", "higher")
    yield Metric("beds too deep on purpose", float(sum(one.deep for one in safe)), "beds", "higher")
    yield Metric(
        "all guards: dura reached",
        float(sum(one.least_mm < 0.0 for one in safe)),
        "beds",
        "lower",
        0.0,
    )
    if safe:
        least = min(one.least_mm for one in safe)
        yield Metric("all guards: least true residual", least, "mm", "higher")
    for name in ("force alone", "no guard"):
        for deep, kind in ((False, "as searched"), (True, "too deep")):
            through = [one.least_mm < 0.0 for one in _of(found, name, deep)]
            yield _share(f"{name}, {kind}: dura reached", through)
    yield from _felt(found)
    yield from _reliability(_of(found, "no guard"))
    yield from _limits(found)
    anew = [one.certified for one in safe if one.certified is not None]
    yield _share("raised layers certified", anew)
    again = [one.scan_certified for one in safe if one.scan_certified is not None]
    yield _share("re-scans certified", again)
    yield from _measured(safe)
    yield from _seats([one for one in safe if not one.deep])


def _felt(found: Sequence[Rehearsed]) -> Iterator[Metric]:
    """Yield how the force by itself finds breakthroughs, and how often it stops for nothing."""
    alone = _of(found, "force alone")
    past = [-one.least_mm for one in alone if one.stopped and one.least_mm < 0.0]
    missed = sum(not one.stopped and one.least_mm < -PLAIN_MM for one in alone)
    good = [way <= LATE_MM for way in past] + missed * [False]
    yield _share("force alone: breakthroughs found", good, 0.95)
    median = float(np.median(past)) if past else None
    yield Metric("force alone: past the inner boundary when stopped", median, "mm", "lower")
    early = [one.stopped and one.least_mm >= 0.0 for one in alone if one.deep]
    yield _share("force alone, too deep: stopped before the boundary", early)
    spare = [one.stopped and one.least_mm >= SPARE_MM for one in alone if one.deep]
    yield _share(f"force alone, too deep: stopped {SPARE_MM} mm before it", spare)
    stopped = [one.stopped for one in _of(found, "all guards", False)]
    yield _share("all guards, as searched: false stops", stopped, 0.01)
    if stopped:
        most = interval(sum(stopped), len(stopped))[1]
        yield Metric("all guards, as searched: false stops, 95 % sure below", most, "1", "lower")


def _reliability(unguarded: Sequence[Rehearsed]) -> Iterator[Metric]:
    """Yield how often the burr is through at steps where it is said to be, with a probability."""
    said = np.concatenate([one.through for one in unguarded] or [np.zeros(0)])
    true = np.concatenate([one.left_mm < -PAST_MM for one in unguarded] or [np.zeros(0)])
    for low, high in pairwise(BINS):
        steps = (said >= low) & (said < high if high < 1.0 else said <= 1.0)
        if steps.any():
            words = f"{steps.sum()} steps said to be through with {said[steps].mean():.2f}"
            yield Metric(words, float(true[steps].mean()), "1", "higher")


def _limits(found: Sequence[Rehearsed]) -> Iterator[Metric]:
    """Yield how often less than the limit was left, with the depth put right and without."""
    for deep, kind in ((False, "as searched"), (True, "too deep")):
        for name, words in (("all guards", "corrected"), ("no guard", "as planned")):
            broken = [one.least_mm < one.limit_mm for one in _of(found, name, deep)]
            goal = 0.01 if name == "all guards" else None
            yield _share(f"{kind}, depth {words}: violations of the limit", broken, goal)
        safe = _of(found, "all guards", deep)
        yield _share(f"{kind}: raised", [one.raised_mm > 0.0 for one in safe])


def _measured(safe: Sequence[Rehearsed]) -> Iterator[Metric]:
    """Yield how far residuals of the floor are off the true ones."""
    asked = [one for one in safe if one.asked]
    yield _share("beds whose floor was measured", [len(one.measured_off_mm) > 0 for one in safe])
    if not asked or not any(len(one.measured_off_mm) for one in asked):
        return
    measured = np.concatenate([one.measured_off_mm for one in asked])
    mapped = np.concatenate([one.mapped_off_mm for one in asked])
    yield Metric(
        f"re-scan, {len(measured)} places: residual RMS", _rms(measured), "mm", "lower", 0.3
    )
    yield Metric("maps at the same places: residual RMS", _rms(mapped), "mm", "lower")


def _seats(safe: Sequence[Rehearsed]) -> Iterator[Metric]:
    """Yield how implants sit in the beds that were searched."""
    seats = [(one.seated, one.raised_mm) for one in safe if one.seated is not None]
    high = [seat.high_mm - raised for seat, raised in seats]
    for name, values in (
        ("implant over its commanded seat", high),
        ("gap below it, mean", [seat.gap_mean_mm for seat, _ in seats]),
        ("rock at its edge", [seat.rock_mm for seat, _ in seats]),
    ):
        median = float(np.median(values)) if values else None
        yield Metric(f"{name}, median", median, "mm", "lower")
        yield Metric(f"{name}, most", max(values, default=None), "mm", "lower")


def _of(found: Sequence[Rehearsed], guards: str, deep: bool | None = None) -> list[Rehearsed]:
    return [one for one in found if one.guards == guards and deep in (None, one.deep)]


def _share(name: str, which: Sequence[bool], goal: float | None = None) -> Metric:
    share = sum(which) / len(which) if which else None
    lower = goal is None or goal < 0.5
    return Metric(
        f"{name} ({sum(which)} of {len(which)})", share, "1", "lower" if lower else "higher", goal
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt((values**2).mean()))
