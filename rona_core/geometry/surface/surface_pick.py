"""Picking on a point cloud: where a line of sight meets the measured surface."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, Vector3, as_points, as_vector3, readonly

ASIDE_MM = 6.0  # a line of sight that passes all points farther off meets no surface
NEAR_MM = 5.0  # round which a plane is fitted
LEAST = 6  # points of a plane
ROUNDS = 8
DONE_MM = 1e-3


def pick_surface_point(
    points_base: ArrayLike,
    origin_base: ArrayLike,
    direction_base: ArrayLike,
) -> Vector3:
    """Return where a line of sight first meets the surface that the cloud shows, (3,) in ``base``.

    A plane is fitted to the points round the place, the line is cut with it, and so on until the
    place stays. Nothing but measured points decides how deep the place lies.

    Args:
        points_base: Surface points (n, 3).
        origin_base: Where the line starts (3,), outside the bone.
        direction_base: Where it goes (3,), any length.

    Raises:
        InvalidInputError: wrong shapes, or no direction.
        DegenerateGeometryError: no surface was measured there.
    """
    points = as_points(points_base, name="points_base")
    origin = as_vector3(origin_base, name="origin_base")
    ray = as_vector3(direction_base, name="direction_base")
    length = float(np.linalg.norm(ray))
    if not length > 0.0:
        raise InvalidInputError("the line of sight has no direction")
    ray = ray / length
    from_origin = points - origin
    depths = from_origin @ ray
    offsets = np.linalg.norm(from_origin - depths[:, None] * ray, axis=1)
    close = np.flatnonzero((offsets <= ASIDE_MM) & (depths > 0.0))
    if not len(close):
        raise DegenerateGeometryError(
            f"no surface was measured within {ASIDE_MM:g} mm of this place: slide the pointer "
            "there first (step 4)"
        )
    front = close[depths[close] <= depths[close].min() + 2.0 * NEAR_MM]
    depth, previous = float(depths[front][offsets[front].argmin()]), np.inf
    for _ in range(ROUNDS):
        if abs(depth - previous) < DONE_MM:
            break
        depth, previous = _cut(points, origin, ray, depth), depth
    return readonly(origin + depth * ray)


def project_to_surface(points_base: ArrayLike, place_base: ArrayLike) -> Vector3:
    """Return the place on the measured surface beside a given one, along the normal there.

    Raises:
        DegenerateGeometryError: no surface was measured there.
    """
    points = as_points(points_base, name="points_base")
    target = as_vector3(place_base, name="place_base")
    neighbours = _nearest(points, target)
    _, normal = _plane(points[neighbours])
    return pick_surface_point(points, target + 10.0 * ASIDE_MM * normal, -normal)


def _cut(points: Floats, origin: Vector3, ray: Vector3, depth: float) -> float:
    """Return how far along the ray the plane through the points around a depth lies."""
    middle, normal = _plane(points[_nearest(points, origin + depth * ray)])
    facing = float(normal @ ray)
    if abs(facing) < 0.1:
        raise DegenerateGeometryError(
            "the surface is seen from its edge at this place: turn the view"
        )
    return float((middle - origin) @ normal / facing)


def _nearest(points: Floats, place: Vector3) -> Ints:
    distances = np.linalg.norm(points - place, axis=1)
    neighbours = np.flatnonzero(distances <= NEAR_MM)
    if len(neighbours) < LEAST:
        neighbours = np.flatnonzero(distances <= 2.0 * NEAR_MM)
    if len(neighbours) < LEAST:
        raise DegenerateGeometryError(
            f"only {len(neighbours)} surface points were measured round this place, {LEAST} are "
            "needed: slide the pointer there first (step 4)"
        )
    return neighbours


def _plane(points: Floats) -> tuple[Vector3, Vector3]:
    middle = points.mean(axis=0)
    _, vectors = np.linalg.eigh((points - middle).T @ (points - middle))
    return middle, vectors[:, 0]
