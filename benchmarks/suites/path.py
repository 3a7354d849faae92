"""Smoothing of a demonstrated scan path, beside the paper's figure and a peer.

The demonstration has as many points as the paper's Figure 6: 307 along a meander on a curved patch,
drawn by a hand with wander and tremor.
"""

import importlib
import itertools
from collections.abc import Callable

import numpy as np

from benchmarks.metric import Metric, Progress, cpu_ms, over_seeds
from benchmarks.suites import normal_cases
from rona_core.arrays import Floats, Ints
from rona_core.path.smooth import simplify

POINTS, TOLERANCE_MM = 307, 1.0
SEEDS = range(10)
RADIUS_MM, WIDTH_MM, LINES = 80.0, 50.0, 11


def run(progress: Progress) -> list[Metric]:
    """Return how many points remain at 1 mm, and how far the result strays."""
    progress(f"{len(SEEDS)} demonstrations of {POINTS} points")
    paths = [demonstration(seed) for seed in SEEDS]
    smoothed = [simplify(points, TOLERANCE_MM) for points in paths]
    counts = [float(len(path.index)) for path in smoothed]
    metrics = over_seeds(
        "path_points_smoothed", counts, "points", "lower", peer="paper", peer_value=90.0
    )
    worst = max(segment_deviation_mm(p, s.index) for p, s in zip(paths, smoothed, strict=True))
    metrics.append(Metric("K1, worst, measured anew", worst, "mm", "lower", goal=TOLERANCE_MM))
    peer = peer_indices()
    metrics.append(
        Metric(
            "smoothing of 307 points, CPU", cpu_ms(lambda: simplify(paths[0], 1.0)), "ms", "lower"
        )
    )
    if peer:
        kept = [peer(points) for points in paths]
        name = "Douglas-Peucker (pybind11-rdp)"
        ratio = float(np.median([c / len(k) for c, k in zip(counts, kept, strict=True)]))
        metrics.append(Metric("points, share of the peer's", ratio, "1", "lower", None, name, 1.0))
    metrics += normal_cases.metrics(progress)
    return metrics


def demonstration(seed: int) -> Floats:
    """Return 307 positions (n, 3) in mm along a meander on a sphere, with wander and tremor."""
    rng = np.random.default_rng((3, seed))
    rows = np.linspace(-WIDTH_MM / 2, WIDTH_MM / 2, LINES)
    ends = np.array([-WIDTH_MM / 2, WIDTH_MM / 2])
    places = [(x, y) for i, y in enumerate(rows) for x in (ends if i % 2 == 0 else ends[::-1])]
    corners = np.array(places)
    arc = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))))
    at = np.linspace(0.0, arc[-1], POINTS)
    flat = np.column_stack([np.interp(at, arc, column) for column in corners.T])
    wander = sum(
        rng.normal(0.0, 0.4, 2) * np.sin(2 * np.pi * at[:, None] / wave + rng.uniform(0, 6.3, 2))
        for wave in (18.0, 31.0, 57.0)
    )
    flat = flat + wander + rng.normal(0.0, 0.1, flat.shape)
    height = np.sqrt(RADIUS_MM**2 - (flat**2).sum(axis=1)) + rng.normal(0.0, 0.1, POINTS)
    return np.column_stack((flat, height))


def segment_deviation_mm(points: Floats, index: Ints) -> float:
    """Return the largest distance of a point from the segment that replaces it (brute force)."""
    worst = 0.0
    for first, last in itertools.pairwise(index):
        a, b, inner = points[first], points[last], points[first : last + 1]
        span = b - a
        share = np.clip((inner - a) @ span / max(float(span @ span), 1e-12), 0.0, 1.0)
        distance = np.linalg.norm(inner - a - share[:, None] * span, axis=1)
        worst = max(worst, float(distance.max()))
    return worst


def peer_indices() -> Callable[[Floats], Floats] | None:
    """Return the peer's simplification (points (n, 3) to points kept), None where not installed."""
    try:
        rdp = importlib.import_module("pybind11_rdp")
    except ImportError:
        return None

    def kept(points: Floats) -> Floats:
        return np.asarray(rdp.rdp(points, epsilon=TOLERANCE_MM), dtype=np.float64)

    return kept
