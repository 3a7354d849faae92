"""Distances from points to a segment, and the area of the strip between a path and a segment.

All work in any dimension: points are (k, m), the ends of a segment (m,) or one each (k, m).
"""

import numpy as np

from rona_core.arrays import Floats

_roots, _weights = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (_roots + 1.0) / 2.0, _weights / 2.0  # of Gauss's rule on 0 to 1


def feet_on_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the place (k, m) nearest to each point on the segment ``start`` to ``end``."""
    along = end - start
    length_sq = (along**2).sum(axis=-1)
    t = ((points - start) * along).sum(axis=-1) / np.where(length_sq > 0, length_sq, 1.0)
    return start + np.clip(t, 0.0, 1.0)[..., None] * along


def distances_to_segment(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distance (k,) of each point from the segment; to its start if it has no length."""
    return np.sqrt(((points - feet_on_segment(points, start, end)) ** 2).sum(axis=-1))


def strip_areas(points: Floats, feet: Floats) -> Floats:
    """Return the area (k - 1,) between each step of a path and the step of its feet.

    Lines from points to feet rule the strip. It is cut where the two steps come closest, so that
    crossing paths count both sides, and integrated by Gauss: exact where the strip is flat.
    """
    step, foot_step = np.diff(points, axis=0), np.diff(feet, axis=0)
    gap, change = (feet - points)[:-1], foot_step - step
    change_sq = (change**2).sum(axis=-1)
    cut = np.clip(-(gap * change).sum(axis=-1) / np.where(change_sq > 0, change_sq, 1.0), 0.0, 1.0)
    along = (1.0 - NODES)[:, None, None] * step + NODES[:, None, None] * foot_step
    total = np.zeros(len(step))
    for start, width in ((np.zeros_like(cut), cut), (cut, 1.0 - cut)):
        at = start + NODES[:, None] * width
        ruling = gap + at[..., None] * change
        areas = _parallelogram_areas(ruling[:, None], along[None])  # (nodes, nodes, k - 1)
        total += width * np.einsum("i,j,ijk->k", WEIGHTS, WEIGHTS, areas)
    return total


def _parallelogram_areas(u: Floats, v: Floats) -> Floats:
    """Return the area (...) spanned by each pair of vectors (..., m), in any dimension."""
    u_sq = (u**2).sum(axis=-1)
    share = (u * v).sum(axis=-1) / np.where(u_sq > 0, u_sq, 1.0)
    return np.sqrt(u_sq * ((v - share[..., None] * u) ** 2).sum(axis=-1))
