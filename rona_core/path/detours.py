"""Detours within a region of a plane: the shortest way round holes, by Dijkstra 1959 on a grid."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints

MAX_NODES = 100_000
CHECK_SHARE = 0.25  # of the step, between places at which a straight line is looked at
STEPS = ((1, 0), (0, 1), (1, 1), (1, -1))  # to the neighbours of a node, one of each pair


class Detours:
    """Ways between places of a region, by straight lines that stay inside."""

    def __init__(
        self, inside: Callable[[Floats], Bools], low: Floats, high: Floats, step: float
    ) -> None:
        """Lay a grid over the region.

        Args:
            inside: Which places (k, 2) belong to it.
            low: Least coordinates (2,) of the region.
            high: Largest coordinates (2,).
            step: Between nodes, in the unit of the places.

        Raises:
            InvalidInputError: the region needs too many nodes.
        """
        self._inside, self._step = inside, step
        counts = np.ceil((np.asarray(high) - low) / step).astype(np.int64) + 1
        if int(counts.prod()) > MAX_NODES:
            raise InvalidInputError(
                f"a region of {counts[0]} x {counts[1]} nodes is too large for detours: at most "
                f"{MAX_NODES} nodes"
            )
        axes = (low[0] + step * np.arange(counts[0]), low[1] + step * np.arange(counts[1]))
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        free = inside(nodes.reshape(-1, 2)).reshape(nodes.shape[:2])
        number = np.full(free.shape, -1, dtype=np.int64)
        number[free] = np.arange(int(free.sum()))
        self._nodes: Floats = nodes[free]
        self._graph = _edges(number, step)
        self._tree = KDTree(self._nodes) if len(self._nodes) else None

    def clear(self, start: Floats, end: Floats) -> bool:
        """Return whether the straight line between two places (2,) stays inside."""
        far = float(np.linalg.norm(end - start))
        t = np.linspace(0.0, 1.0, int(np.ceil(far / (CHECK_SHARE * self._step))) + 2)[:, None]
        return bool(self._inside(start + t * (end - start)).all())

    def lengths(self, start: Floats, ends: Floats) -> Floats:
        """Return the lengths (k,) of the ways from a place (2,) to places (k, 2); inf: no way."""
        if self._tree is None or not len(ends):
            return np.full(len(ends), np.inf)
        at, far = self._node(start)
        found, _ = self._from(at)
        offsets, rows = self._tree.query(ends)
        lengths = far + offsets + found[rows]
        lengths[offsets > 2.0 * self._step] = np.inf
        return np.full(len(ends), np.inf) if far > 2.0 * self._step else lengths

    def way(self, start: Floats, end: Floats) -> Floats | None:
        """Return the corners (k, 2) between two places (2,), without these; None: no way."""
        if self.clear(start, end):
            return np.zeros((0, 2))
        if not np.isfinite(self.lengths(start, end[None])[0]):
            return None
        (first, _), (last, _) = self._node(start), self._node(end)
        before = self._from(first)[1]
        rows = [last]
        while rows[-1] != first:
            rows.append(int(before[rows[-1]]))
        return self._pulled(np.vstack((start, self._nodes[rows[::-1]], end)))

    def _node(self, place: Floats) -> tuple[int, float]:
        if self._tree is None:
            return 0, np.inf
        far, row = self._tree.query(place)
        return int(row), float(far)

    def _from(self, node: int) -> tuple[Floats, Ints]:
        lengths, before = dijkstra(
            self._graph, directed=False, indices=node, return_predecessors=True
        )
        return np.asarray(lengths), np.asarray(before, dtype=np.int64)

    def _pulled(self, places: Floats) -> Floats:
        """Return the corners that are left where each leads straight to the farthest it can."""
        kept, at = [], 0
        while at < len(places) - 1:
            ahead = range(len(places) - 1, at, -1)
            at = next((k for k in ahead if self.clear(places[at], places[k])), at + 1)
            kept.append(places[at])
        return np.array(kept[:-1]).reshape(-1, 2)


def _edges(number: Ints, step: float) -> csr_array:
    """Return the graph of neighbouring nodes, numbered (nx, ny) from 0; -1 is outside."""
    starts: list[Ints] = []
    ends: list[Ints] = []
    lengths: list[Floats] = []
    nx, ny = number.shape
    for dx, dy in STEPS:
        a = number[: nx - dx, max(0, -dy) : ny - max(0, dy)]
        b = number[dx:, max(0, dy) : ny + min(0, dy)]
        both = (a >= 0) & (b >= 0)
        starts.append(a[both])
        ends.append(b[both])
        lengths.append(np.full(int(both.sum()), step * float(np.hypot(dx, dy))))
    count = int(number.max(initial=-1)) + 1
    rows, columns = np.concatenate(starts), np.concatenate(ends)
    return csr_array(coo_array((np.concatenate(lengths), (rows, columns)), shape=(count, count)))


def join_strokes(strokes: list[Floats], detours: Detours, step_mm: float) -> Floats:
    """Return one line (n, 2) through all strokes, the nearest next, by ways that stay inside.

    Args:
        strokes: Lines (k, 2), each inside; the first one begins.
        detours: Ways between them.
        step_mm: Distance between the points of a way, at most.

    Raises:
        DegenerateGeometryError: the region is in parts that no way connects.
    """
    joined, left = [strokes[0]], list(strokes[1:])
    while left:
        end = joined[-1][-1]
        ends = np.array([(stroke[0], stroke[-1]) for stroke in left]).reshape(-1, 2)
        lengths = detours.lengths(end, ends)
        nearest = int(lengths.argmin())
        way = detours.way(end, ends[nearest])
        if way is None:
            raise DegenerateGeometryError(
                "the region to be scanned is in parts that are not connected, but the probe stays "
                "on the bone: paint a bridge between them, or make a path for each"
            )
        stroke = left.pop(nearest // 2)
        joined += [
            _filled(np.vstack((end, way, ends[nearest])), step_mm),
            stroke[::-1] if nearest % 2 else stroke,
        ]
    return np.vstack(joined)


def _filled(corners: Floats, step_mm: float) -> Floats:
    """Return places along corners (k, 2), at most a step apart, without the first and the last."""
    parts: list[Floats] = []
    for start, end in pairwise(corners):
        count = max(1, int(np.ceil(np.linalg.norm(end - start) / step_mm - 1e-9)))
        parts.append(start + (np.arange(1, count + 1) / count)[:, None] * (end - start))
    return np.vstack(parts)[:-1]
