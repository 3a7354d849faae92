"""Planes at very many places: sums over cells instead of sums over points.

The sums of Equation 2 of the paper are additive. So each cell keeps those of its own points; a
weighted sum over cells, taken along x, then y, then z, gives the sums of a soft neighbourhood; and
what lies between the nodes of the grid is interpolated. The work for a place no longer depends on
how many points are near it.
"""

import numpy as np

from rona_core.arrays import Floats, Ints
from rona_core.surface.planes import Planes

PER_RADIUS = 3.0  # cells
# A Gaussian of width s averages noise like a disc of radius r where s^4 = r^4 / 32; the boxes of
# the cells and the interpolation bring a part of it, these weights the rest.
SHARE = 32.0**-0.25  # s / r
REACH = 4  # cells on either side
MAX_NODES = 600_000  # of one block of the grid; larger clouds are cut up
PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
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
        near = near[((near > low - halo) & (near < high + halo)).all(axis=1)]
        if not len(near):
            continue
        nodes = np.floor((high - low) / cell).astype(np.int64) + 2 * REACH + 4
        if nodes.astype(float).prod() > MAX_NODES and len(rows) > 1 and (high > low).any():
            axis = int((high - low).argmax())
            left = places[rows, axis] <= (low[axis] + high[axis]) / 2.0
            todo += [(rows[left], near), (rows[~left], near)]
            continue
        corner = low - (REACH + 1.5) * cell
        sums[:, rows] = _interpolated(
            _smoothed(near - corner, nodes, cell), places[rows] - corner, cell
        )
        origins[rows] = corner
    return _planes(sums, places - origins)


def _smoothed(points: Floats, nodes: Ints, cell: float) -> Floats:
    """Return the sums (10, nx, ny, nz) of soft neighbourhoods about the middle of each cell."""
    index = np.floor(points / cell).astype(np.int64)
    inside = ((index >= 0) & (index < nodes)).all(axis=1)
    index, points = index[inside], points[inside]
    flat = (index[:, 0] * nodes[1] + index[:, 1]) * nodes[2] + index[:, 2]
    size = int(nodes.prod())
    x = points.T
    rows = [None, x[0], x[1], x[2], *(x[i] * x[j] for i, j in PAIRS)]
    sums = [np.bincount(flat, weights=row, minlength=size) for row in rows]
    grid = np.stack(sums).astype(np.float64).reshape(10, *nodes)
    variance = SHARE**2 * PER_RADIUS**2 - 1.0 / 12.0 - 1.0 / 6.0  # in cells: less box and hat
    taps = _taps(variance)
    for axis in (1, 2, 3):
        grid = _along(grid, axis, taps)
    return grid


def _taps(variance: float) -> Floats:
    """Return weights (2 REACH + 1,) of unit height whose variance is exactly ``variance``."""
    steps = np.arange(-REACH, REACH + 1.0)
    width, weights = variance, np.ones(len(steps))
    for _ in range(20):  # cutting the tails off takes a little away
        weights = np.exp(-(steps**2) / (2.0 * width))
        width *= variance / float((weights * steps**2).sum() / weights.sum())
    return weights


def _along(grid: Floats, axis: int, taps: Floats) -> Floats:
    """Return the sum of shifted copies along one axis; beyond the ends there is nothing."""
    n = grid.shape[axis]
    result = taps[REACH] * grid
    for step in range(1, min(REACH, n - 1) + 1):
        for to, frm in ((slice(step, n), slice(0, n - step)), (slice(0, n - step), slice(step, n))):
            there, here = [slice(None)] * 4, [slice(None)] * 4
            there[axis], here[axis] = to, frm
            result[tuple(there)] += taps[REACH + step] * grid[tuple(here)]
    return result


def _interpolated(grid: Floats, places: Floats, cell: float) -> Floats:
    """Return the sums (10, m) at places between the middles of the cells."""
    at = places / cell - 0.5
    low = np.floor(at).astype(np.int64)
    share = at - low
    ny, nz = grid.shape[2:]
    table = np.ascontiguousarray(grid.reshape(10, -1).T)
    base = (low[:, 0] * ny + low[:, 1]) * nz + low[:, 2]
    result = np.zeros((len(places), 10))
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                weight = (
                    (share[:, 0] if i else 1.0 - share[:, 0])
                    * (share[:, 1] if j else 1.0 - share[:, 1])
                    * (share[:, 2] if k else 1.0 - share[:, 2])
                )
                result += weight[:, None] * table[base + (i * ny + j) * nz + k]
    return result.T


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
