"""Depth of the layers to come, so that the residual limit holds as surely as was asked."""

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.placement.chance import spreads_above


def ceiling_mm(bottoms_bed: Floats, drawn_mm: Floats, limit_mm: float, spreads: float) -> float:
    """Return the height below which no place of a way may lie; -inf where all may stay.

    Args:
        bottoms_bed: Lowest places of the burr (n, 3).
        drawn_mm: Bone below them in draws (n, k).
        limit_mm: That has to be left below all of them.
        spreads: By how many the median has to be above that, see `spreads_for`.
    """
    if not len(bottoms_bed) or float(spreads_above(drawn_mm.min(axis=0), limit_mm)) >= spreads:
        return -np.inf
    # a draw keeps the limit once every place is so high; heights of the way itself count alike
    wanted = np.full(drawn_mm.shape[1], -np.inf)
    for height, drawn in zip(bottoms_bed[:, 2] + limit_mm, drawn_mm, strict=True):
        np.maximum(wanted, height - drawn, out=wanted)
    median = float(np.median(wanted))
    above = wanted[wanted > median] - median
    return median + spreads * float(np.sqrt((above**2).mean())) if len(above) else median


def raised_path(
    path: MillingPath, pause: int, ceiling: float, surface_mm: float
) -> tuple[MillingPath, Ints] | None:
    """Return what is left to be milled after a layer, nothing of it below a height.

    Layers above that height stay, one ends on it, those that would cut nothing are left out.

    Args:
        path: As planned, of n places.
        pause: Last layer that is milled; -1: none.
        ceiling: The height in ``bed``.
        surface_mm: Height in ``bed`` that no bone within the outline rises above.

    Returns:
        The path, and which planned places (m,) it comes from; None where nothing is left.
    """
    heights, later = path.bottoms_bed()[:, 2], path.layers > pause
    lifts = np.where(later, np.maximum(ceiling - heights, 0.0), 0.0)
    kept = later.copy()
    lowest: dict[int, float] = {}  # of each burr so far
    for layer in np.unique(path.layers):
        own = path.layers == layer
        burr, depth = int(path.tools[own][0]), float((heights + lifts)[own].min())
        before = lowest.get(burr, surface_mm)
        kept &= ~own | (depth < before - 1e-6)
        lowest[burr] = min(depth, before)
    rows = np.flatnonzero(kept)
    if not len(rows):
        return None
    tips = path.tips_bed + lifts[:, None] * (0.0, 0.0, 1.0)
    moves, layers, tools = (part[rows] for part in (path.moves, path.layers, path.tools))
    return MillingPath(tips[rows], path.axes_bed[rows], moves, layers, tools, path.burrs), rows
