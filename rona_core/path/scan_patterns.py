"""Scan patterns on a surface: raster and spiral within a boundary.

A pattern is drawn in the tangent plane of a patch and dropped onto the surface along its normal,
so distances on a surface inclined by the angle a are longer by 1 / cos a.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, as_floats, as_vector3, readonly
from rona_core.geometry.pose import Pose
from rona_core.path.detours import Detours, join_strokes

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
