"""Fusion of several passes over one region: the offset of each pass, and agreement between them.

A pass is off as a whole by what is not known of its stand-off and by what the links of the robot
err by in its postures. Where two passes show the inner boundary side by side, they show by how much
they differ. An A-scan then counts where it agrees with the median of those around it: a step within
the bone, or a cycle of the echo, differs from one tilt of the probe to the next, the boundary does
not. See docs/algorithms/maps/tilted_passes.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.robust import MAD_TO_SIGMA
from rona_core.ultrasound.detection.detect import OK, UNSURE, Detection

PAIR_MM = 1.5  # A-scans of two passes this close are compared
AROUND_MM = 3.0  # those this close are asked whether they agree
AGREEING_MM = 0.5  # with their median
LIKELY = 0.6  # probability from which on an inner echo counts where several passes look
LEAST_AROUND = 3  # A-scans, itself among them
LEAST_PAIRS = 10  # fewer say nothing of two passes
FACE_MM = 6.0  # A-scans within one face hear the same bone and err alike
LEAST_SPREAD_MM = 0.05  # of two passes
MEDIAN_LOSS = np.pi / 2.0  # variance of a median over that of a mean
# One standard deviation, before passes are compared: an upright pass measures its stand-off itself,
# that of a tilted one comes from the map and from the poses of the robot in other postures.
UPRIGHT_MM, TILTED_MM = 0.02, 0.3
MOST_SIGMAS = 3.0  # of these, that two passes differ by at most


@dataclass(frozen=True, slots=True, eq=False)
class PassFusion:
    """How the depths of several passes fit together."""

    agreeing: Bools  # (n,) sure A-scans that agree with those around
    passes: Ints  # (n,) the pass of each
    offsets_mm: Floats  # (p,) by which each pass places the inner boundary too deep
    sigma_mm: float  # of what is left of these in the mean of all that agree

    def corrected(self, points_map: Floats) -> Floats:
        """Return points of the inner boundary (n, 3) in ``map`` without the offsets."""
        up = np.zeros(points_map.shape)
        up[:, 2] = self.offsets_mm[self.passes]
        return points_map + up


def counting(found: Detection) -> Bools:
    """Return which A-scans (n,) count where several passes look, unsure ones among them.

    What was set by hand keeps its flag.
    """
    seen = np.isin(found.flag, (OK, UNSURE)) & (found.inner_quality >= LIKELY)
    return np.asarray(found.outer_ok & ((found.flag == OK) | seen))


def fuse_passes(
    entries_mm: Floats, places_mm: Floats, depths_mm: Floats, sure: Bools, passes: Ints
) -> PassFusion:
    """Return the offset of each pass, and which A-scans agree with those around once it is gone.

    Args:
        entries_mm: Where the sound entered the bone, along the outer boundary (n, 2 or 3). Here
            they are compared with each other: an echo from less deep is off less to the side.
        places_mm: Of the inner boundary along the outer one, likewise; there passes are compared.
        depths_mm: Of the inner boundary below the outer one (n,).
        sure: Which A-scans count (n,).
        passes: The pass of each (n,), from 0; 0 is the upright one.
    """
    rows = np.flatnonzero(sure)
    places, depths, numbers = places_mm[rows], depths_mm[rows], passes[rows]
    offsets, covariance = _offsets(places, depths, numbers, int(passes.max(initial=0)) + 1)
    agreeing = np.zeros(len(sure), dtype=np.bool_)
    if len(rows):
        depths = depths - offsets[numbers]
        entries = entries_mm[rows]
        around = KDTree(entries).query_ball_point(entries, AROUND_MM)
        agreeing[rows] = [
            len(near) >= LEAST_AROUND and abs(depth - np.median(depths[near])) <= AGREEING_MM
            for depth, near in zip(depths, around, strict=True)
        ]
    counts = np.bincount(passes[agreeing], minlength=len(offsets))
    shares = counts / max(int(counts.sum()), 1)
    sigma_mm = float(np.sqrt(shares @ covariance @ shares))
    return PassFusion(readonly(agreeing), passes, readonly(offsets), sigma_mm)


def _offsets(places: Floats, depths: Floats, passes: Ints, count: int) -> tuple[Floats, Floats]:
    """Return the offset of each pass (p,) and their covariance: least squares over all pairs.

    Of m passes each is in m - 1 pairs, which are no news of their own: as information of
    independent A-scans the pairs of one face add up to m / 2 times what they tell. A pair that is
    farther apart than any offset shows two boundaries, and says nothing of it.
    """
    prior = np.where(np.arange(count) == 0, UPRIGHT_MM, TILTED_MM)
    normal, right = np.diag(prior**-2.0), np.zeros(count)
    several = max(len(np.unique(passes)), 1)
    trees = [KDTree(places[passes == k]) if (passes == k).any() else None for k in range(count)]
    for i, tree in enumerate(trees):
        for j in range(i + 1, count):
            other = trees[j]
            if tree is None or other is None:
                continue
            pairs = tree.query_ball_tree(other, PAIR_MM)
            near = np.repeat(np.arange(len(pairs)), [len(found) for found in pairs])
            there = np.array([k for found in pairs for k in found], dtype=np.int64)
            mine, theirs = np.flatnonzero(passes == i)[near], np.flatnonzero(passes == j)[there]
            off = depths[mine] - depths[theirs]
            alike = np.abs(off) <= MOST_SIGMAS * np.hypot(prior[i], prior[j])
            if np.count_nonzero(alike) < LEAST_PAIRS:
                continue
            mine, off = mine[alike], off[alike]
            middle = float(np.median(off))
            spread = max(MAD_TO_SIGMA * float(np.median(np.abs(off - middle))), LEAST_SPREAD_MM)
            faces = len(np.unique(np.floor(places[mine] / FACE_MM), axis=0))
            weight = 2.0 / several * faces / (MEDIAN_LOSS * spread**2)
            sides = np.zeros(count)
            sides[i], sides[j] = 1.0, -1.0
            normal += weight * np.outer(sides, sides)
            right += weight * middle * sides
    covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    return covariance @ right, covariance
