"""Scan patterns on a surface: raster and spiral within a boundary.

A pattern is drawn in the tangent plane of a patch and dropped onto the surface along its normal,
so distances on a surface inclined by the angle a are longer by 1 / cos a.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats, as_vector3, readonly
from rona_core.geometry.pose import Pose

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


Heights = Callable[[Floats], Floats]  # places (k, 2) in the plane of the patch -> height (k,)
Inside = Callable[[Floats], Bools]  # places (k, 2) in the plane of the patch -> whether they count
MAX_POINTS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class PathPattern:
    """Points in the order they are scanned; between strokes the probe is lifted."""

    points_base: Floats  # (n, 3)
    stroke: Ints  # (n,) number of the stroke that a point belongs to, from 0


def patch_pose(
    center_base: ArrayLike, normal_base: ArrayLike, along_base: ArrayLike | None = None
) -> Pose:
    """Return the pose of a patch: origin at its centre, z along the normal out of the bone.

    Args:
        center_base: Centre (3,).
        normal_base: Normal (3,), any length.
        along_base: Direction (3,) that x should follow; None takes the axis of ``base`` that is
            farthest from the normal.

    Raises:
        DegenerateGeometryError: no normal, or a direction along it.
    """
    center = as_vector3(center_base, name="center_base")
    z = as_vector3(normal_base, name="normal_base")
    if not np.linalg.norm(z) > 0:
        raise DegenerateGeometryError("the normal of the patch has no length")
    z = z / np.linalg.norm(z)
    along = np.eye(3)[np.abs(z).argmin()] if along_base is None else as_vector3(along_base)
    x = along - (along @ z) * z
    if not np.linalg.norm(x) > 1e-6 * np.linalg.norm(along):
        raise DegenerateGeometryError("the direction of the patch lies along its normal")
    x = x / np.linalg.norm(x)
    return Pose(np.column_stack((x, np.cross(z, x), z)), center)


def raster(
    T_base_patch: Pose,
    boundary: ArrayLike,
    heights: Heights,
    *,
    spacing_mm: float,
    margin_mm: float = 0.0,
    step_mm: float = 1.0,
    allowed: Inside | None = None,
) -> PathPattern:
    """Return lines along x of the patch, there and back, from the smallest y to the largest.

    Lines lie ``spacing_mm`` apart, one of them through the origin. Where the boundary cuts a line
    into parts, or the way to the next line would leave it, a new stroke begins.

    Args:
        T_base_patch: Pose of the patch, see :func:`patch_pose`.
        boundary: Corners (k, 2) of a polygon in the plane of the patch, in mm.
        heights: Surface over that plane, see :func:`rona_core.path.height_field.relief`.
        spacing_mm: Distance between lines.
        margin_mm: Least distance of all points from the boundary.
        step_mm: Distance between the points of a line, at most.
        allowed: Which places (k, 2) of the plane may be scanned. The strokes are then joined to one
            by ways that keep to these and to the boundary.

    Raises:
        InvalidInputError: fewer than three corners, or lengths that are not positive.
        DegenerateGeometryError: nothing lies within the boundary, or what may be scanned there is
            in parts.
    """
    inside = _region(boundary, margin_mm, allowed)
    corners = as_floats(boundary, name="boundary")
    _check_lengths(corners, spacing_mm, step_mm)
    low, high = corners.min(axis=0), corners.max(axis=0)
    x = low[0] + step_mm * np.arange(int(np.ceil((high[0] - low[0]) / step_mm)) + 1)
    rows = np.arange(int(np.ceil(low[1] / spacing_mm)), int(np.floor(high[1] / spacing_mm)) + 1)
    lines = [_runs(np.column_stack((x, np.full(len(x), y))), inside) for y in rows * spacing_mm]
    strokes: list[Floats] = []
    for k in range(len(lines)):
        while lines[k]:
            strokes.append(_boustrophedon(lines, k, inside, step_mm))
    if allowed is not None:
        strokes = _joined(strokes, inside, corners, step_mm)
    return _dropped(T_base_patch, strokes, heights)


def spiral(
    T_base_patch: Pose,
    boundary: ArrayLike,
    heights: Heights,
    *,
    spacing_mm: float,
    margin_mm: float = 0.0,
    step_mm: float = 1.0,
    allowed: Inside | None = None,
) -> PathPattern:
    """Return a spiral from the origin of the patch outwards, as far as the boundary reaches.

    Neighbouring turns lie ``spacing_mm`` apart (an Archimedean spiral). Where it leaves the
    boundary and comes back, a new stroke begins. Arguments and errors as for :func:`raster`.
    """
    inside = _region(boundary, margin_mm, allowed)
    corners = as_floats(boundary, name="boundary")
    _check_lengths(corners, spacing_mm, step_mm)
    reach = float(np.linalg.norm(corners, axis=1).max())
    growth = spacing_mm / (2.0 * np.pi)
    # steps of the angle that keep the chord below the step: radius r turns by step / (r + growth)
    count = int(np.ceil(np.pi * (reach + spacing_mm) ** 2 / (spacing_mm * step_mm))) + 2
    length = step_mm * np.arange(count)
    angle = np.sqrt(2.0 * length / growth)  # arc length is at least growth angle^2 / 2
    angle = angle[growth * angle <= reach]
    gaps = np.diff(angle)
    finer = np.ceil(growth * np.sqrt(1.0 + angle[1:] ** 2) * gaps / step_mm).astype(np.int64)
    start = np.repeat(angle[:-1], finer)
    within = np.arange(len(start)) - np.repeat(np.cumsum(finer) - finer, finer)
    angle = np.append(start + within * np.repeat(gaps / np.maximum(finer, 1), finer), angle[-1:])
    places = growth * angle[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    strokes = _runs(places, inside)
    if allowed is not None:
        strokes = _joined(strokes, inside, corners, step_mm)
    return _dropped(T_base_patch, strokes, heights)


def _joined(strokes: list[Floats], inside: Inside, corners: Floats, step_mm: float) -> list[Floats]:
    """Return the strokes as one, led round what is not inside."""
    if len(strokes) < 2:
        return strokes
    detours = Detours(inside, corners.min(axis=0), corners.max(axis=0), step_mm)
    return [join_strokes(strokes, detours, step_mm)]


def _check_lengths(corners: Floats, spacing_mm: float, step_mm: float) -> None:
    if not (0.0 < spacing_mm < np.inf and 0.0 < step_mm < np.inf):
        raise InvalidInputError(
            f"spacing_mm and step_mm must be positive, not {spacing_mm} and {step_mm}"
        )
    size = np.abs(corners).max() * 2.0 + spacing_mm
    if size**2 / (spacing_mm * step_mm) > MAX_POINTS:
        raise InvalidInputError(
            f"a pattern of {size:.4g} mm with spacing {spacing_mm} mm and step {step_mm} mm has "
            f"more than {MAX_POINTS} points"
        )


def _region(boundary: ArrayLike, margin_mm: float, allowed: Inside | None) -> Inside:
    """Return the test which places (k, 2) lie in the polygon, off its edges, and are allowed."""
    corners = as_floats(boundary, name="boundary")
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise InvalidInputError(f"boundary must have shape (k, 2), k >= 3, not {corners.shape}")
    if not 0.0 <= margin_mm < np.inf:
        raise InvalidInputError(f"margin_mm must be 0 or more, not {margin_mm}")
    ends = np.roll(corners, -1, axis=0)

    def inside(places: Floats) -> Bools:
        odd = np.zeros(len(places), dtype=np.bool_)
        nearest = np.full(len(places), np.inf)
        for a, b in zip(corners, ends, strict=True):
            spans = (a[1] > places[:, 1]) != (b[1] > places[:, 1])
            if spans.any():
                x = a[0] + (places[:, 1] - a[1]) / (b[1] - a[1] or 1.0) * (b[0] - a[0])
                odd ^= spans & (places[:, 0] < x)
            edge = b - a
            t = (places - a) @ edge / max(float(edge @ edge), 1e-300)
            away = places - a - np.clip(t, 0.0, 1.0)[:, None] * edge
            nearest = np.minimum(nearest, np.sqrt((away**2).sum(axis=1)))
        within = odd & (nearest >= margin_mm)
        return within if allowed is None else within & allowed(places)

    return inside


def _runs(places: Floats, inside: Inside) -> list[Floats]:
    """Return the stretches of ``places`` that lie inside."""
    good = np.concatenate(([False], inside(places), [False]))
    starts, stops = np.flatnonzero(~good[:-1] & good[1:]), np.flatnonzero(good[:-1] & ~good[1:])
    return [places[a:b] for a, b in zip(starts, stops, strict=True)]


def _boustrophedon(lines: list[list[Floats]], k: int, inside: Inside, step_mm: float) -> Floats:
    """Take a run from line ``k`` and from each later one while the way there stays inside."""
    stroke = [lines[k].pop(0)]
    for line in lines[k + 1 :]:
        end = stroke[-1][-1]
        for i, run in enumerate(line):
            onward = run if np.abs(run[0] - end)[0] < np.abs(run[-1] - end)[0] else run[::-1]
            far = float(np.linalg.norm(onward[0] - end))
            t = np.linspace(0.0, 1.0, int(np.ceil(far / step_mm)) + 1)[:, None]
            link = end + t * (onward[0] - end)
            if inside(link).all():
                stroke += [link[1:-1], onward]
                line.pop(i)
                break
        else:
            break
    return np.vstack(stroke)


def _dropped(T_base_patch: Pose, strokes: list[Floats], heights: Heights) -> PathPattern:
    if not strokes:
        raise DegenerateGeometryError("nothing of the pattern lies within the boundary")
    places = np.vstack(strokes)
    number = np.repeat(np.arange(len(strokes)), [len(stroke) for stroke in strokes])
    points_patch = np.column_stack((places, heights(places)))
    return PathPattern(readonly(T_base_patch @ points_patch), readonly(number))
