"""Planes at very many places from moments summed over grid cells.

The sums of Equation 2 of the paper are additive. So each cell keeps those of its own points; a
weighted sum over cells, taken along x, then y, then z, gives the sums of a soft neighbourhood; and
what lies between the nodes of the grid is interpolated. The work for a place no longer depends on
how many points are near it.
"""

import itertools

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.surface.normals.plane_fits import Planes

PER_RADIUS = 2.5  # cells
# A Gaussian of width s averages noise like a disc of radius r where s^4 = r^4 / 32; the boxes of
# the cells and the interpolation bring a part of it, these weights the rest.
SHARE = 32.0**-0.25  # s / r
REACH = 3  # cells on either side
MAX_NODES = 600_000  # of one block of the grid; larger clouds are cut up
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
TERMS = ((-1, -1), (0, -1), (1, -1), (2, -1), *PAIRS)  # the factors of each sum; -1: none
POINTS_PER_WEIGHT = 4.0  # a Gaussian of unit height knows as much as this times its weight


def grid_planes(points: Floats, places: Floats, radius_mm: float) -> tuple[Planes, Ints]:
    """Return a plane at each of ``places`` (m, 3), and how many points of a ball it is worth.

    Args:
        points: The cloud (n, 3).
        places: In its frame.
        radius_mm: Of the ball that would average the noise as much.
    """
    m = len(places)
    sums = np.zeros((10, m))
    origins = np.zeros((m, 3))
    todo = [(np.arange(m), points)] if m and len(points) else []
    cell = radius_mm / PER_RADIUS
    while todo:
        rows, near = todo.pop()
        low, high = places[rows].min(axis=0), places[rows].max(axis=0)
        halo = (REACH + 2) * cell
        near = near[_all_columns((near > low - halo) & (near < high + halo))]
        if not len(near):
            continue
        nodes = np.floor((high - low) / cell).astype(np.int64) + 2 * REACH + 4
        if nodes.astype(float).prod() > MAX_NODES and len(rows) > 1 and (high > low).any():
            axis = int((high - low).argmax())
            left = places[rows, axis] <= (low[axis] + high[axis]) / 2.0
            todo += [(rows[left], near), (rows[~left], near)]
            continue
        corner = low - (REACH + 1.5) * cell
        sums[:, rows] = _soft_sums(near - corner, places[rows] - corner, nodes, cell)
        origins[rows] = corner
    return _planes(sums, places - origins)


def _soft_sums(points: Floats, places: Floats, nodes: Ints, cell: float) -> Floats:
    """Return the ten sums (10, m) of soft neighbourhoods about places within one block."""
    index = np.floor(points / cell).astype(np.int64)
    inside = _all_columns((index >= 0) & (index < nodes))
    flat = _node(index[inside], nodes)
    p = np.ascontiguousarray(points[inside].T)
    at = places / cell - 0.5  # counted from the middle of the first cell
    low = np.floor(at)
    base = _node(low.astype(np.int64), nodes)
    order = np.argsort(base)  # neighbours in memory one after the other
    base, share = base[order], (at - low)[order].T
    far, near = share, 1.0 - share
    corners: list[tuple[Ints, Floats]] = []
    for corner in itertools.product((0, 1), repeat=3):
        x, y, z = (far[axis] if c else near[axis] for axis, c in enumerate(corner))
        corners.append((base + int(_node(np.array([corner]), nodes)[0]), x * y * z))
    taps = _taps(SHARE**2 * PER_RADIUS**2 - 1.0 / 12.0 - 1.0 / 6.0)  # less the box and the hat
    result = np.zeros((10, len(places)))
    for row, (i, j) in enumerate(TERMS):
        weights = None if i < 0 else (p[i] if j < 0 else p[i] * p[j])
        grid = np.bincount(flat, weights, int(nodes.prod())).astype(np.float64).reshape(nodes)
        for axis in range(3):
            grid = _along(grid, axis, taps)
        grid = grid.ravel()
        result[row, order] = sum(weight * grid[node] for node, weight in corners)
    return result


def _node(index: Ints, nodes: Ints) -> Ints:
    """Return the number of each node (n, 3) in a grid of ``nodes`` (3,)."""
    return (index[:, 0] * nodes[1] + index[:, 1]) * nodes[2] + index[:, 2]


def _all_columns(truths: Bools) -> Bools:
    return truths[:, 0] & truths[:, 1] & truths[:, 2]


def _taps(variance: float) -> Floats:
    """Return weights (2 REACH + 1,) of unit height whose variance is exactly ``variance``."""
    steps = np.arange(-REACH, REACH + 1.0)
    width, weights = variance, np.ones(len(steps))
    for _ in range(20):  # cutting the tails off takes a little away
        weights = np.exp(-(steps**2) / (2.0 * width))
        width *= variance / float((weights * steps**2).sum() / weights.sum())
    return weights


def _along(grid: Floats, axis: int, taps: Floats) -> Floats:
    """Return the sum of shifted copies (nx, ny, nz) along one axis; beyond the ends is nothing."""
    n = grid.shape[axis]
    grid = grid.swapaxes(0, axis)
    result = taps[REACH] * grid
    for step in range(1, min(REACH, n - 1) + 1):
        scaled = taps[REACH + step] * grid
        result[step:] += scaled[:-step]
        result[:-step] += scaled[step:]
    return result.swapaxes(0, axis)


def _planes(sums: Floats, places: Floats) -> tuple[Planes, Ints]:
    """Return total least squares from the sums about the origins of the blocks."""
    weight = np.where(sums[0] > 1e-9, sums[0], 0.0)
    safe = np.where(weight > 0.0, weight, 1.0)
    mean = sums[1:4] / safe
    second = np.stack([sums[4 + n] / safe - mean[i] * mean[j] for n, (i, j) in enumerate(PAIRS)])
    eigenvalues, normals = smallest_axes(np.where(weight > 0.0, second, 0.0))
    worth = POINTS_PER_WEIGHT * weight
    planes = Planes(
        normals=normals,
        eigenvalues=eigenvalues,
        centroids=np.where(weight > 0.0, mean, 0.0).T - np.where(weight > 0.0, places.T, 0.0).T,
        noise_mm2=eigenvalues[:, 0],
        weight=worth,
    )
    return planes, np.rint(worth).astype(np.int64)


def smallest_axes(s: Floats) -> tuple[Floats, Floats]:
    """Return eigenvalues (m, 3), ascending, and the axis (m, 3) of the smallest.

    In closed form for symmetric matrices given as (xx, xy, xz, yy, yz, zz) (6, m): the roots of
    the cubic by cosines, then the axis as the largest cross product of two rows of S - lambda I.
    """
    xx, xy, xz, yy, yz, zz = s
    q = (xx + yy + zz) / 3.0
    a, b, c = xx - q, yy - q, zz - q
    p = np.sqrt((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    safe = np.where(p > 0.0, p, 1.0)
    half = (a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)) / 2.0
    turn = np.arccos(np.clip(half / safe**3, -1.0, 1.0)) / 3.0
    high = q + 2.0 * p * np.cos(turn)
    low = q + 2.0 * p * np.cos(turn + 2.0 * np.pi / 3.0)
    values = np.stack((low, 3.0 * q - high - low, high), axis=1)
    a, b, c = xx - low, yy - low, zz - low
    crosses = np.stack(
        (
            (xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy),
            (xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz),
            (b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz),
        )
    )  # (3 pairs of rows, 3 components, m)
    lengths = (crosses**2).sum(axis=1)
    best = lengths.argmax(axis=0)
    m = np.arange(len(best))
    chosen, length = crosses[best, :, m], np.sqrt(lengths[best, m])
    normals = np.divide(
        chosen, length[:, None], out=np.zeros_like(chosen), where=length[:, None] > 0
    )
    return np.maximum(values, 0.0), normals
