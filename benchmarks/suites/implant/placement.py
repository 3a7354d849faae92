"""Placement of an implant's bed: optimum beside brute force, time, and whether P is honest.

The truth of each world is one more draw of the field that its draws come from, so this shows that
the probability of a whole bed follows from the draws, not that draws of a real scan are right.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from time import process_time

import numpy as np
from numpy.random import Generator
from scipy.stats import beta

from benchmarks.metric import Metric, Progress, cpu_ms, over_seeds
from benchmarks.reference.bone_worlds import (
    BoneWorld,
    bone_world,
    milled,
    oblong_bed,
    round_bed,
    true_residual_mm,
)
from benchmarks.reference.placement_brute_force import best_objective
from rona_core.planning.bed import Bed, Screw
from rona_core.planning.placement.evaluate import judge_placement, solid_points
from rona_core.planning.placement.figures import PlacementFigures
from rona_core.planning.placement.problem import (
    ExecutionError,
    Placement,
    PlacementLimits,
    PlacementProblem,
    SearchGrid,
)
from rona_core.planning.placement.search import search_placements

ROUND_SEEDS = range(38_000, 38_006)
OBLONG_SEEDS = range(38_100, 38_102)
SEEDS = range(61_200, 61_600)  # of honesty: one bed chosen at random, and one search, in each
REGION_MM, SMALL_MM = 60.0, 40.0
EXECUTION = ExecutionError(depth_mm=0.15, lateral_mm=0.15)
BINS = (0.0, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
GRID = SearchGrid()
SCREWS = (Screw(17.0, 0.0, 3.0, 2.0), Screw(-17.0, 0.0, 3.0, 2.0))


@dataclass(frozen=True, slots=True)
class Outcome:
    """A bed with its predicted probability, and whether the truth kept the limit."""

    predicted: float
    kept: bool


def run(progress: Progress) -> list[Metric]:
    """Return optimum, times and honesty."""
    metrics = [*_optimum(progress), *_with_screws(progress), _one_placement()]
    progress(f"{len(SEEDS)} random beds")
    random = [random_bed(np.random.default_rng(seed)) for seed in SEEDS]
    progress(f"{len(SEEDS)} searches")
    searched = [searched_bed(np.random.default_rng(seed)) for seed in SEEDS]
    return [*metrics, *reliability(random), *required(searched)]


def any_problem(generator: Generator, side_mm: float) -> PlacementProblem:
    """Return a bone that is thick enough for a bed of 4.5 mm nowhere, somewhere or everywhere."""
    return PlacementProblem(any_world(generator, side_mm).bone, EXECUTION)


def any_world(generator: Generator, side_mm: float) -> BoneWorld:
    """Return a bone of 5 to 7 mm on average."""
    return bone_world(generator, side_mm, float(generator.uniform(5.0, 7.0)))


def _optimum(progress: Progress) -> Iterator[Metric]:
    """Yield the objective of the search over that of brute force, and the time of both."""
    beds = (
        ("round", round_bed(18.2, 4.5), ROUND_SEEDS),
        ("oblong", oblong_bed(26.0, 18.0, 4.5), OBLONG_SEEDS),
    )
    for name, bed, seeds in beds:
        if not seeds:
            continue
        ratios: list[float] = []
        quick_s: list[float] = []
        slow_s: list[float] = []
        for seed in seeds:
            progress(f"{name} bed, seed {seed}: brute force")
            problem = any_problem(np.random.default_rng(seed), REGION_MM)
            start = process_time()
            found = search_placements(problem, bed, (), GRID)
            middle = process_time()
            whole, judged = best_objective(problem, bed, GRID)
            slow_s.append(process_time() - middle)
            quick_s.append(middle - start)
            reached = found.best.objective if found.best else 0.0
            ratios.append(reached / whole if whole > 0.0 else 1.0)
            progress(f"{judged} placements, objective {reached:.4f} of {whole:.4f}")
        title = f"{name} bed: objective over brute force"
        yield from over_seeds(title, ratios, "", "higher", goal=0.99)
        yield from over_seeds(f"{name} bed: CPU of the search", quick_s, "s", "lower", goal=2.0)
        yield from over_seeds(f"{name} bed: CPU of brute force", slow_s, "s", "lower")


def _with_screws(progress: Progress) -> Iterator[Metric]:
    """Yield the time of the search for an oblong bed with two screws beside it."""
    spent_s: list[float] = []
    if not OBLONG_SEEDS:
        return
    for seed in OBLONG_SEEDS:
        progress(f"oblong bed with two screws, seed {seed}")
        problem = any_problem(np.random.default_rng(seed), REGION_MM)
        start = process_time()
        search_placements(problem, oblong_bed(26.0, 18.0, 4.5), SCREWS, GRID)
        spent_s.append(process_time() - start)
    title = "oblong bed with two screws: CPU of the search"
    yield from over_seeds(title, spent_s, "s", "lower", goal=2.0)


def _one_placement() -> Metric:
    """Return the time of a placement while somebody drags it."""
    problem = any_problem(np.random.default_rng(0), REGION_MM)
    solid = solid_points(problem, round_bed(18.2, 4.5))
    place = Placement(3.0, -4.0, 0.3, 0.02, 0.0)
    time_ms = cpu_ms(lambda: judge_placement(problem, solid, place))
    return Metric("one placement with 200 draws: CPU", time_ms, "ms", "lower", goal=50.0)


def random_bed(generator: Generator) -> Outcome:
    """Return how a bed at any place turns out whose depth leaves about the limit."""
    world = any_world(generator, SMALL_MM)
    problem = PlacementProblem(world.bone, EXECUTION)
    length, width = generator.uniform(12.0, 18.0), generator.uniform(10.0, 12.0)
    u, v = generator.uniform(-6.0, 6.0, 2)
    tilts = np.deg2rad(generator.uniform(-3.0, 3.0, 2))
    place = Placement(u, v, generator.uniform(0.0, np.pi), *tilts)
    wanted = problem.limits.residual_mm + generator.uniform(-0.1, 1.1)
    depth, bed = 2.0, oblong_bed(length, width, 2.0)
    judged = judge_placement(problem, solid_points(problem, bed), place)
    for _ in range(3):  # a deeper bed leaves less, not quite by as much
        if judged.residual_mm is None:
            raise ValueError("a bed in the middle of a whole map lies over it")
        depth = max(0.3, depth + judged.residual_mm - wanted)
        bed = oblong_bed(length, width, depth)
        judged = judge_placement(problem, solid_points(problem, bed), place)
    return _outcome(generator, world, bed, judged)


def searched_bed(generator: Generator) -> tuple[bool, Outcome]:
    """Return whether the best placement in a world is accepted, and how it turns out."""
    world = any_world(generator, SMALL_MM)
    bed = round_bed(14.0, 4.0)
    found = search_placements(PlacementProblem(world.bone, EXECUTION), bed, (), GRID)
    if found.best is None:
        raise ValueError("a bed smaller than a whole map can be laid")
    return found.refusal is None, _outcome(generator, world, bed, found.best)


def _outcome(generator: Generator, world: BoneWorld, bed: Bed, judged: PlacementFigures) -> Outcome:
    left = true_residual_mm(world, bed, milled(generator, EXECUTION, judged.T_map_bed))
    return Outcome(judged.probability, left >= PlacementLimits().residual_mm)


def reliability(outcomes: Sequence[Outcome]) -> Iterator[Metric]:
    """Yield the table: mean predicted P of each bin beside the share that kept the limit.

    A bin holds where the prediction lies in the 95 % interval (Clopper-Pearson) of that share.
    """
    predicted = np.array([one.predicted for one in outcomes])
    kept = np.array([one.kept for one in outcomes])
    held = bins = 0
    for low, high in pairwise(BINS):
        inside = (predicted >= low) & ((predicted < high) | (high == BINS[-1]))
        count, good = int(inside.sum()), int(kept[inside].sum())
        if not count:
            continue
        mean = float(predicted[inside].mean())
        least, most = interval(good, count)
        bins, held = bins + 1, held + (least <= mean <= most)
        title = f"random beds, P {low:g} to {high:g}, {count}"
        yield Metric(f"{title}: predicted", mean, "share", "higher")
        yield Metric(f"{title}: observed", good / count, "share", "higher")
        yield Metric(f"{title}: observed, 95 % sure above", least, "share", "higher")
        yield Metric(f"{title}: observed, 95 % sure below", most, "share", "higher")
    yield Metric(
        "random beds: bins whose interval holds", held / max(bins, 1), "share", "higher", 1.0
    )


def interval(good: int, count: int) -> tuple[float, float]:
    """Return the Clopper-Pearson interval of a share, 95 %."""
    low = float(beta.ppf(0.025, good, count - good + 1)) if good else 0.0
    high = float(beta.ppf(0.975, good + 1, count - good)) if good < count else 1.0
    return low, high


def required(searched: Sequence[tuple[bool, Outcome]]) -> Iterator[Metric]:
    """Yield how many accepted beds broke the limit, and how many refused ones kept it."""
    accepted = [one for safe, one in searched if safe]
    refused = [one for safe, one in searched if not safe]
    broken = sum(not one.kept for one in accepted)
    title = f"best beds, P >= 0.99 required, {len(accepted)} accepted"
    share = broken / len(accepted) if accepted else None
    yield Metric(f"{title}: violations", share, "share", "lower", 0.01 if accepted else None)
    if accepted:
        most = interval(broken, len(accepted))[1]
        yield Metric(f"{title}: violations, 95 % sure below", most, "share", "lower")
    kept = sum(one.kept for one in refused)
    title = f"best beds, {len(refused)} refused"
    mean = float(np.mean([one.predicted for one in refused])) if refused else None
    yield Metric(f"{title}: predicted", mean, "share", "higher")
    safe = kept / len(refused) if refused else None
    yield Metric(f"{title}: would have kept the limit", safe, "share", "lower")
