"""Space hashing: find the points of a cloud near a place without looking at all of them."""

import numpy as np

from rona_core.arrays import Floats

KEY_BITS = 21  # of one cell coordinate within a 64-bit key


class CellHash:
    """Points sorted by cubic cells, so that those of neighbouring cells lie side by side."""

    def __init__(self, points: Floats, cell_mm: float) -> None:
        """Sort ``points`` (n, 3) into cells of ``cell_mm``; done once for each cloud."""
        self._cell_mm = cell_mm
        self._corner = points.min(axis=0) if len(points) else np.zeros(3)
        keys = _keys(self._cells(points))
        order = np.argsort(keys, kind="stable")
        self._keys, self._points = keys[order], points[order]

    def near(self, place: Floats) -> Floats:
        """Return the points (k, 3) whose distance from ``place`` (3,) is at most one cell."""
        cell = self._cells(place[None])[0]
        if (np.abs(cell) >= 1 << (KEY_BITS - 2)).any():
            return self._points[:0]
        columns = cell[None] + _COLUMNS
        # the three cells along z of each column have keys without a gap
        low = np.searchsorted(self._keys, _keys(columns - _UP), side="left")
        high = np.searchsorted(self._keys, _keys(columns + _UP), side="right")
        candidates = np.concatenate(
            [self._points[a:b] for a, b in zip(low, high, strict=True)], axis=0
        )
        offsets = candidates - place
        return candidates[np.einsum("ij,ij->i", offsets, offsets) <= self._cell_mm**2]

    def _cells(self, points: Floats) -> np.typing.NDArray[np.int64]:
        scaled = np.floor((points - self._corner) / self._cell_mm)
        limit = float(1 << (KEY_BITS - 2))
        return np.clip(scaled, -limit, limit).astype(np.int64)


_UP = np.array((0, 0, 1), dtype=np.int64)
_COLUMNS = np.array([(i, j, 0) for i in (-1, 0, 1) for j in (-1, 0, 1)], dtype=np.int64)


def _keys(cells: np.typing.NDArray[np.int64]) -> np.typing.NDArray[np.int64]:
    """Return one number for each cell (n, 3), ordered by x, then y, then z."""
    shifted = cells + (1 << (KEY_BITS - 1))
    return (shifted[:, 0] << (2 * KEY_BITS)) | (shifted[:, 1] << KEY_BITS) | shifted[:, 2]
