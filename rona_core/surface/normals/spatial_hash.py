"""Spatial hash: points of a cloud near many places."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints

KEY_BITS = 21  # of one cell coordinate within a 64-bit key
LIMIT = 1 << (KEY_BITS - 2)  # cells from the origin; further places are refused or empty
BATCH_PAIRS = 2_000_000  # candidates looked at together
BATCH_SLOTS = 400_000  # padded neighbours handed out together


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhoods:
    """The neighbours of b places, padded to the largest neighbourhood among them."""

    rows: Ints  # (b,) which of the places
    offsets: Floats  # (b, k, 3) neighbours minus place; zero where there is none
    there: Bools  # (b, k)


class CellHash:
    """Points sorted by cubic cells, so that those of neighbouring cells lie side by side.

    The cells are counted from the origin of the frame: adding points later gives the same order,
    and so the same sums to the last bit, as hashing all of them at once.
    """

    def __init__(self, points: Floats, cell_mm: float) -> None:
        """Sort ``points`` (n, 3) into cells of ``cell_mm``.

        Raises:
            InvalidInputError: a point lies more than half a million cells from the origin.
        """
        self._cell_mm = cell_mm
        self._keys: Ints = np.zeros(0, dtype=np.int64)
        self._points: Floats = np.zeros((0, 3))
        self.add(points)

    @property
    def points(self) -> Floats:
        """All points (n, 3), in the order of their cells."""
        return self._points

    def add(self, points: Floats) -> None:
        """Sort more ``points`` (n, 3) in; errors as when hashing."""
        cells = self._cells(points)
        if (np.abs(cells) >= LIMIT).any():
            far = float(np.abs(points).max())
            raise InvalidInputError(
                f"a point {far:.3g} mm from the origin is too far for cells of "
                f"{self._cell_mm:.3g} mm"
            )
        keys = _keys(cells)
        order = np.argsort(keys, kind="stable")
        keys, points = keys[order], points[order]
        slots = np.searchsorted(self._keys, keys, side="right")
        self._keys = np.insert(self._keys, slots, keys)
        self._points = np.insert(self._points, slots, points, axis=0)

    def near(self, place: Floats) -> Floats:
        """Return the points (k, 3) whose distance from ``place`` (3,) is at most one cell."""
        return self._points[self.pairs(place[None])[1]]

    def pairs(self, places: Floats) -> tuple[Ints, Ints]:
        """Return which place and which point are at most one cell apart, ordered by place."""
        first, count = self._ranges(places)
        return self._expanded(places, first, count)

    def batches(self, places: Floats) -> Iterator[Neighbourhoods]:
        """Yield the neighbourhoods of all ``places`` (m, 3) that have any, a batch at a time."""
        first, count = self._ranges(places)
        load = np.cumsum(count.sum(axis=1))
        parts = np.searchsorted(load, np.arange(BATCH_PAIRS, load[-1:].sum(), BATCH_PAIRS))
        for part in np.split(np.arange(len(places)), np.unique(parts)):
            owners, found = self._expanded(places[part], first[part], count[part])
            yield from self._padded(part, places, owners, found)

    def _padded(
        self, part: Ints, places: Floats, owners: Ints, found: Ints
    ) -> Iterator[Neighbourhoods]:
        sizes = np.bincount(owners, minlength=len(part))
        starts = np.cumsum(sizes) - sizes
        order = np.argsort(sizes, kind="stable")
        order = order[sizes[order] > 0]
        while len(order):
            # the largest come first, so that little is padded
            width = int(sizes[order[-1]])
            these = order[-max(1, BATCH_SLOTS // width) :]
            order = order[: -len(these)]
            slots = np.arange(width)
            there = slots < sizes[these][:, None]
            index = np.where(there, starts[these][:, None] + slots, 0)
            offsets = self._points[found[index]] - places[part[these]][:, None]
            yield Neighbourhoods(part[these], np.where(there[:, :, None], offsets, 0.0), there)

    def _ranges(self, places: Floats) -> tuple[Ints, Ints]:
        """Return where the candidates in the 9 columns round each place begin, and how many."""
        cells = self._cells(places)
        known: Bools = np.asarray((np.abs(cells) < LIMIT).all(axis=1))
        columns = np.where(known[:, None], cells, 0)[:, None] + _COLUMNS
        # the three cells along z of each column have keys without a gap
        first = np.searchsorted(self._keys, _keys(columns - _UP), side="left")
        last = np.searchsorted(self._keys, _keys(columns + _UP), side="right")
        return first, np.where(known[:, None], last - first, 0)

    def _expanded(self, places: Floats, first: Ints, count: Ints) -> tuple[Ints, Ints]:
        owners = np.repeat(np.arange(len(places)), count.sum(axis=1))
        sizes = count.ravel()
        before = np.repeat(np.cumsum(sizes) - sizes, sizes)
        found = np.arange(len(owners)) - before + np.repeat(first.ravel(), sizes)
        offsets = self._points[found] - places[owners]
        close = np.einsum("ij,ij->i", offsets, offsets) <= self._cell_mm**2
        return owners[close], found[close]

    def _cells(self, points: Floats) -> Ints:
        scaled = np.floor(points / self._cell_mm)
        return np.clip(scaled, -float(LIMIT), float(LIMIT)).astype(np.int64)


_UP = np.array((0, 0, 1), dtype=np.int64)
_COLUMNS = np.array([(i, j, 0) for i in (-1, 0, 1) for j in (-1, 0, 1)], dtype=np.int64)


def _keys(cells: Ints) -> Ints:
    """Return one number for each cell (..., 3), ordered by x, then y, then z."""
    shifted = cells + (1 << (KEY_BITS - 1))
    return (shifted[..., 0] << (2 * KEY_BITS)) | (shifted[..., 1] << KEY_BITS) | shifted[..., 2]
