"""Smoothing of a demonstrated scan path, beside the paper's figure, brute force and peers."""

from collections.abc import Callable

import numpy as np

from benchmarks.cases import surface_normals as normal_cases
from benchmarks.cases.demonstrated_path import demonstration as demonstrated
from benchmarks.metric import Metric, Progress, cpu_ms, over_seeds
from benchmarks.peers.line_simplification import PEERS, as_index
from benchmarks.reference.path.brute_force_simplification import (
    fewest,
    segment_deviation_mm,
    textbook_order,
    within_frechet,
)
from benchmarks.reference.path.lower_bound import points_lower_bound
from benchmarks.reference.path.path_coverage import length_mm
from benchmarks.reference.path.removal_order import removal_order
from benchmarks.reference.yardstick import Yardstick, pair
from rona_core.geometry.arrays import Floats
from rona_core.path.simplification.error_bound import ErrorBound, deviations
from rona_core.path.simplification.simplify import METHODS, SimplifiedPath, as_keep, simplify

__all__ = ["POINTS", "demonstration", "run", "segment_deviation_mm"]

POINTS, FAST_POINTS, LONG_POINTS = 307, 3000, 20_000
TOLERANCE_MM, PAPER_POINTS = 1.0, 90.0
K1_ALONE = ErrorBound(TOLERANCE_MM, frechet=False)  # as in the paper
SEEDS, FAST_SEEDS = range(20), range(8)
GREEDY_TRIALS, BRUTE_TRIALS = 30, 100


def run(progress: Progress) -> list[Metric]:
    """Return how many points remain at 1 mm, how long that takes, and whether it is right."""
    progress(f"{len(SEEDS)} demonstrations of {POINTS} points")
    metrics = as_in_the_paper()
    progress(f"{len(FAST_SEEDS)} demonstrations of {FAST_POINTS} points")
    metrics += sampled_fast()
    progress(f"{GREEDY_TRIALS} paths by the textbook, {BRUTE_TRIALS} by brute force")
    metrics += against_brute_force()
    metrics.append(strokes_kept())
    progress("times")
    metrics += times() + beside_peers()
    return metrics + normal_cases.metrics(progress)


def demonstration(seed: int) -> Floats:
    """Return as many positions (n, 3) in mm as the paper's path has."""
    return demonstrated(seed, POINTS)


def as_in_the_paper() -> list[Metric]:
    """Return the counts on paths like the paper's, and the worst deviation of all methods."""
    paths = [demonstration(seed) for seed in SEEDS]
    greedy = [len(simplify(p, K1_ALONE, method="greedy")) for p in paths]
    best = [len(simplify(p, TOLERANCE_MM)) for p in paths]
    shares = [b / g for b, g in zip(best, greedy, strict=True)]
    checked = [excess(p, simplify(p, TOLERANCE_MM, method=m)) for p in paths for m in METHODS]
    off = abs(float(np.median(greedy)) - PAPER_POINTS)
    return [
        *over_seeds("points kept, greedy, 307", greedy, "points", "lower"),
        Metric("greedy median, off the paper's 90", off, "points", "lower", 10.0),
        *over_seeds("points kept, fewest, 307", best, "points", "lower", peer="paper",
                    peer_value=PAPER_POINTS),
        *over_seeds("fewest / greedy, 307", shares, "1", "lower", goal=0.80),
        Metric("K1 / bound, all methods, worst", max(checked), "1", "lower", 1.0),
    ]  # fmt: skip


def excess(points: Floats, path: SimplifiedPath) -> float:
    """Return K1, measured apart, as a share of the bound; infinite if a stroke is lost."""
    walks = within_frechet(points, path.index, path.tolerance * (1.0 + 1e-12))
    found = max(segment_deviation_mm(points, path.index), deviations(points, path.index).k1_mm)
    return found / path.tolerance if walks else float("inf")


def sampled_fast() -> list[Metric]:
    """Return the counts at 85 Hz."""
    paths = [demonstrated(seed, FAST_POINTS) for seed in FAST_SEEDS]
    greedy = [len(simplify(p, K1_ALONE, method="greedy")) for p in paths]
    best = [len(simplify(p, TOLERANCE_MM)) for p in paths]
    fast = [simplify(p, TOLERANCE_MM, method="fast") for p in paths]
    slack = [len(f) / b for f, b in zip(fast, best, strict=True)]
    proven = [proven_least(p) / b for p, b in zip(paths, best, strict=True)]
    return [
        *over_seeds("points kept, fewest, 3000", best, "points", "lower"),
        *over_seeds("fewest / greedy, 3000", [b / g for b, g in zip(best, greedy, strict=True)],
                    "1", "lower", goal=0.35),
        *over_seeds("fast / fewest, 3000", slack, "1", "lower", goal=1.10),
        *over_seeds("proven lower bound / fewest, 3000", proven, "1", "higher"),
    ]  # fmt: skip


def proven_least(points: Floats) -> int:
    """Return a number of points that no path within the bound can undercut."""
    columns, test = np.ascontiguousarray(points.T), ErrorBound(TOLERANCE_MM).shortcut_test(points)
    return points_lower_bound(columns, as_keep(None, len(points)), test)


def against_brute_force() -> list[Metric]:
    """Return in how many cases the fast ways and the plain ways disagree."""
    wrong_order, told, seed = 0, 0, 0
    while told < GREEDY_TRIALS:
        rng = np.random.default_rng((12, seed))
        path = walk(rng, int(rng.integers(50, 200)), (2, 3, 6)[seed % 3])
        bound = (0.5, 2.0, np.inf)[seed // 3 % 3]
        expected = textbook_order(path, bound)
        if expected is not None:  # else two removals cost the same
            told += 1
            wrong_order += removal_order(path, tolerance=bound).index.tolist() != expected
        seed += 1
    wrong_count = 0
    for seed in range(BRUTE_TRIALS):
        rng = np.random.default_rng((13, seed))
        path = walk(rng, int(rng.integers(20, 301)), (2, 3, 6)[seed % 3])
        bound, frechet = rng.uniform(0.3, 3.0), seed % 2 == 0
        found = len(simplify(path, ErrorBound(bound, frechet=frechet)))
        wrong_count += found != fewest(path, bound, frechet=frechet)
    return [
        Metric(
            f"greedy unlike the textbook, of {told} without ties", wrong_order, "paths", "lower", 0
        ),
        Metric(f"fewest unlike brute force, of {BRUTE_TRIALS}", wrong_count, "paths", "lower", 0),
    ]


def walk(rng: np.random.Generator, n: int, axes: int) -> Floats:
    """Return a random walk (n, axes) that turns slowly and trembles."""
    turning = np.cumsum(rng.normal(0.0, 0.3, (n, axes)), axis=0)
    return np.cumsum(turning * 0.3, axis=0) + rng.normal(0.0, 0.3, (n, axes))


def strokes_kept() -> Metric:
    """Return how much of the length of a raster finer than the bound is left."""
    x = np.concatenate([np.linspace(0.0, 25.0, 40)[:: (-1) ** k] for k in range(9)])
    raster = np.column_stack((x, np.repeat(np.arange(9) * 0.4, 40), np.zeros(len(x))))
    left = length_mm(raster[simplify(raster, TOLERANCE_MM).index]) / length_mm(raster)
    lost = length_mm(raster[simplify(raster, K1_ALONE).index])
    name = "length of a 0.4 mm raster that is left"
    return Metric(name, left, "1", "higher", 0.9, "by K1 alone", lost / length_mm(raster))


def times() -> list[Metric]:
    """Return CPU times of one thread, best of five, in yardsticks and seconds."""
    short, middle = demonstration(0), demonstrated(0, FAST_POINTS)
    dense = demonstrated(0, LONG_POINTS)
    line = np.outer(np.linspace(0.0, 300.0, LONG_POINTS), (0.6, 0.0, 0.8))
    works: list[tuple[str, Callable[[], object], float | None]] = [
        ("fewest, 307", lambda: simplify(short, TOLERANCE_MM), 0.05),
        ("fewest, 3000", lambda: simplify(middle, TOLERANCE_MM), 1.0),
        ("fast, 3000", lambda: simplify(middle, TOLERANCE_MM, method="fast"), 0.1),
        ("greedy, 20 000 in 35 s", lambda: removal_order(dense, tolerance=1.0), 2.0),
        ("greedy, 20 000 on a line", lambda: removal_order(line, tolerance=1.0), 2.0),
        ("greedy with Fréchet, 3000", lambda: simplify(middle, 1.0, method="greedy"), None),
    ]
    yardstick, metrics = Yardstick(), list[Metric]()
    for name, work, goal_s in works:
        spent_s = cpu_ms(work) / 1e3
        yardstick.lay()
        metrics += pair(f"CPU, {name}", spent_s, yardstick.median_s, goal_s)
    return metrics


def beside_peers() -> list[Metric]:
    """Return points, 3D deviation and time of peers beside ours, on the same path."""
    metrics: list[Metric] = []
    for n in (POINTS, FAST_POINTS):
        path = demonstrated(0, n)
        ours, slow = simplify(path, TOLERANCE_MM), simplify(path, TOLERANCE_MM, method="rdp")
        for name, load in PEERS:
            peer = load(TOLERANCE_MM)
            theirs = as_index(path, peer(path)) if peer else None
            count = None if theirs is None else float(len(theirs))
            off = None if theirs is None else segment_deviation_mm(path, theirs)
            ms = None if peer is None else cpu_ms(lambda p=path, f=peer: f(p))
            metrics += [
                Metric(f"points, {n}", len(ours), "points", "lower", None, name, count),
                Metric(f"K1 in 3D, {n}", ours.k1_mm, "mm", "lower", TOLERANCE_MM, name, off),
                Metric(f"CPU, {name}, {n}", ms, "ms", "lower"),
            ]
        ms = cpu_ms(lambda p=path: simplify(p, TOLERANCE_MM, method="rdp"))
        metrics.append(Metric(f"points, own rdp, {n}", len(slow), "points", "lower"))
        metrics.append(Metric(f"CPU, own rdp, {n}", ms, "ms", "lower"))
    return metrics
