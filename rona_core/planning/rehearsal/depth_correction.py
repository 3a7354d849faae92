"""Depth of the layers to come, so that the residual limit holds as surely as was asked."""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.planning.placement.chance import scores
from rona_core.planning.rehearsal.site import BurrWay


def ceiling_mm(bottoms_bed: Floats, drawn_mm: Floats, limit_mm: float, score: float) -> float:
    """Return the height below which no place of a way may lie; -inf where all may stay.

    Args:
        bottoms_bed: Lowest places of the burr (n, 3).
        drawn_mm: Bone below them in draws (n, k).
        limit_mm: That has to be left below all of them.
        score: Standard normal quantile of the probability of that.
    """
    if not len(bottoms_bed) or float(scores(drawn_mm.min(axis=0), limit_mm)) >= score:
        return -np.inf
    # a draw keeps the limit once every place is so high; heights of the way itself count alike
    wanted = np.full(drawn_mm.shape[1], -np.inf)
    for height, drawn in zip(bottoms_bed[:, 2] + limit_mm, drawn_mm, strict=True):
        np.maximum(wanted, height - drawn, out=wanted)
    median = float(np.median(wanted))
    above = wanted[wanted > median] - median
    return median + score * float(np.sqrt((above**2).mean())) if len(above) else median


def corrected_way(way: BurrWay, pause: int, ceiling: float) -> tuple[BurrWay, Ints]:
    """Return the way with its depth corrected, and which planned places (m,) it comes from.

    After the floor was scanned again nothing is milled below a height; layers that would cut
    nothing any more are left out.

    Args:
        way: As planned.
        pause: Last layer before the scan; -1: none.
        ceiling: The height; -inf: as planned.
    """
    bottoms, later = way.bottoms_bed.copy(), way.layers > pause
    bottoms[later, 2] = np.maximum(bottoms[later, 2], ceiling)
    kept = np.ones(len(way), dtype=np.bool_)
    lowest: dict[float, float] = {}  # of each burr so far
    for layer in np.unique(way.layers):
        own = way.layers == layer
        radius, depth = float(way.radii_mm[own][0]), float(bottoms[own, 2].min())
        before = lowest.get(radius, np.inf)
        kept &= ~own | (depth < before - 1e-6)
        lowest[radius] = min(depth, before)
    return way.at(bottoms).part(kept), np.flatnonzero(kept)
