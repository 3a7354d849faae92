"""Points hashed by the cells of a uniform grid: who lies within one radius, and their moments.

The paper's Section III.C hashes the space that holds the cloud. Here the points are sorted by the
cells that they lie in, which are one radius wide: a run of cells along z is one slice of the sorted
points, and all neighbours of a place lie in nine such runs. All places of one cell share these
points, so that one matrix product gives their squared distances, and another one, with the zeros
and ones of who is near, the exact moments of each neighbourhood.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints

BLOCK = 100_000  # distances at a time, and
GATHERED = 20_000  # points gathered at a time, unless one place has more in the cells around it
MOST_CELLS = 2**20  # along an axis: their numbers stay exact; wider clouds have wider cells
WIDER = 1.0 + 1e-9  # of the cells than the radius, so that rounding passes over no cell
SIDE = MOST_CELLS + 8  # numbers along an axis, with empty cells on both sides
TOUCHING = 1e-12  # of a squared cell; distances that close to the radius are measured again
ROUNDING = 1e-12  # of a squared cell, in the moments about its middle
AROUND = np.array([SIDE * (SIDE * x + y) for x in (-1, 0, 1) for y in (-1, 0, 1)])


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """Moments of the points near m places, per point."""

    count: Ints  # (m,)
    centroids: Floats  # (m, 3) from the place; zero where there is no point
    scatter: Floats  # (m, 3, 3) variances about the centroid, mm^2
    rounding_mm2: float  # variances up to here are none


@dataclass(frozen=True, slots=True, eq=False)
class _Block:
    """Places of one cell and the points of the cells around."""

    rows: Ints  # (b,) which of the places
    points: Ints  # (k,) which of the sorted points
    terms: Floats  # (k, 10) of these points, see ``_terms``
    near: Bools  # (b, k)


class PointGrid:
    """A cloud (n, 3) in mm, sorted by cells for neighbourhoods of one radius."""

    def __init__(self, points: Floats, radius_mm: float) -> None:
        """Sort ``points`` (n, 3), all finite."""
        self.points, self.radius_mm = points, radius_mm
        self._low = points.min(axis=0) if len(points) else np.zeros(3)
        extent_mm = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
        self.cell_mm = max(radius_mm, extent_mm / MOST_CELLS) * WIDER
        keys = self._keys(self._cells(points))
        self._order = order = np.argsort(keys, kind="stable")  # rows of the cloud, by cells
        self._sorted_keys, self._sorted = keys[order], points[order]

    def moments(self, places: Floats) -> Moments:
        """Return the moments of the points within the radius of ``places`` (m, 3)."""
        sums = np.zeros((len(places), 10))
        for block in self._blocks(places):
            sums[block.rows] = block.near.astype(np.float64) @ block.terms
        count = sums[:, 0]
        means = sums[:, 1:] / np.maximum(count, 1.0)[:, None]
        squares, xx, xy, xz, yy, yz = means.T[3:]
        second = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, squares - xx - yy)))
        first = means[:, :3]
        scatter = second.transpose(2, 0, 1) - first[:, :, None] * first[:, None]
        shifts = self._middles(self._cells(places)) - places
        centroids = np.where(count[:, None] > 0, first + shifts, 0.0)
        return Moments(count.astype(np.int64), centroids, scatter, ROUNDING * self.cell_mm**2)

    def neighbours(self, places: Floats) -> Ints:
        """Return the rows of the cloud (p,) near each of ``places``, one place after another."""
        pairs = [
            (block.rows[place], block.points[point])
            for block in self._blocks(places)
            for place, point in (np.nonzero(block.near),)
        ]
        if not pairs:
            return np.zeros(0, dtype=np.int64)
        place, point = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
        return self._order[point[np.argsort(place, kind="stable")]]

    def _cells(self, places: Floats) -> Floats:
        """Return in which cells (m, 3) places lie, by whole numbers along the axes."""
        return np.floor((places - self._low) / self.cell_mm)

    def _middles(self, cells: Floats) -> Floats:
        return self._low + (cells + 0.5) * self.cell_mm

    def _keys(self, cells: Floats) -> Ints:
        """Return the numbers (m,) of the cells; those of one row along z follow each other."""
        x, y, z = np.clip(cells, -2.0, MOST_CELLS + 2.0).astype(np.int64).T + 3
        return (x * SIDE + y) * SIDE + z

    def _blocks(self, places: Floats) -> Iterator[_Block]:
        """Yield the places that have points in the cells around, a few of one cell at a time."""
        cells = self._cells(places)
        keys = self._keys(cells)
        order = np.argsort(keys, kind="stable")
        keys, starts = np.unique(keys[order], return_index=True)
        stops = np.append(starts[1:], len(order))
        runs = keys[:, None] + AROUND
        first = np.searchsorted(self._sorted_keys, runs - 1, side="left")
        lengths = np.searchsorted(self._sorted_keys, runs + 1, side="right") - first
        totals = lengths.sum(axis=1)
        middles = self._middles(cells[order])
        factors = self._factors(places[order] - middles)
        middles = middles[starts]
        parts = np.flatnonzero(np.diff(np.cumsum(totals) // GATHERED)) + 1
        for part in np.split(np.arange(len(keys)), parts):
            points = _ranges(first[part].ravel(), lengths[part].ravel())
            terms = _terms(self._sorted[points] - np.repeat(middles[part], totals[part], axis=0))
            ends = np.cumsum(totals[part])
            for cell, end in zip(part[totals[part] > 0], ends[totals[part] > 0], strict=True):
                mine = slice(end - totals[cell], end)
                around, step = (points[mine], terms[mine]), max(1, BLOCK // totals[cell])
                for k in range(starts[cell], stops[cell], step):
                    some = slice(k, min(k + step, stops[cell]))
                    near = self._near(factors[some], places, order[some], *around)
                    yield _Block(order[some], *around, near)

    def _factors(self, local: Floats) -> Floats:
        """Return the factors (m, 5) of the terms whose sum is squared distance less radius^2.

        ``local`` (m, 3) are the places from the middles of their cells.
        """
        factors = np.ones((len(local), 5))
        factors[:, 0] = (local**2).sum(axis=1) - self.radius_mm**2
        factors[:, 1:4] = -2.0 * local
        return factors

    def _near(
        self, factors: Floats, places: Floats, rows: Ints, points: Ints, terms: Floats
    ) -> Bools:
        """Return which of the sorted ``points`` (k,) are near which ``rows`` (b,) of the places."""
        beyond = factors @ terms[:, :5].T
        bound = TOUCHING * self.cell_mm**2
        near = beyond <= bound
        if np.count_nonzero(near) != np.count_nonzero(beyond < -bound):
            i, j = np.nonzero(np.abs(beyond) <= bound)
            x, y, z = (places[rows[i]] - self._sorted[points[j]]).T
            near[i, j] = x * x + y * y + z * z <= self.radius_mm**2
        return near


def _ranges(first: Ints, lengths: Ints) -> Ints:
    """Return the numbers from each ``first`` on, ``lengths`` of them, one run after another."""
    begins = np.cumsum(lengths) - lengths
    return np.arange(lengths.sum()) + np.repeat(first - begins, lengths)


def _terms(points: Floats) -> Floats:
    """Return 1, x, y, z, their square, xx, xy, xz, yy and yz (k, 10) of points (k, 3).

    Squared distances are sums of the first five, moments of all.
    """
    terms = np.ones((len(points), 10))
    terms[:, 1:4] = points
    np.einsum("ki,ki->k", points, points, out=terms[:, 4])
    np.multiply(points[:, :1], points, out=terms[:, 5:8])
    np.multiply(points[:, 1:2], points[:, 1:], out=terms[:, 8:])
    return terms
