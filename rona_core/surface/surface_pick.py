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
    deep = from_origin @ ray
    aside = np.linalg.norm(from_origin - deep[:, None] * ray, axis=1)
    close = np.flatnonzero((aside <= ASIDE_MM) & (deep > 0.0))
    if not len(close):
        raise DegenerateGeometryError(
            f"no surface was measured within {ASIDE_MM:g} mm of this place: slide the pointer "
            "there first (step 4)"
        )
    front = close[deep[close] <= deep[close].min() + 2.0 * NEAR_MM]
    at, before = float(deep[front][aside[front].argmin()]), np.inf
    for _ in range(ROUNDS):
        if abs(at - before) < DONE_MM:
            break
        at, before = _cut(points, origin, ray, at), at
    return readonly(origin + at * ray)


def project_to_surface(points_base: ArrayLike, place_base: ArrayLike) -> Vector3:
    """Return the place on the measured surface beside a given one, along the normal there.

    Raises:
        DegenerateGeometryError: no surface was measured there.
    """
    points = as_points(points_base, name="points_base")
    place = as_vector3(place_base, name="place_base")
    near = _nearest(points, place)
    _, normal = _plane(points[near])
    return pick_surface_point(points, place + 10.0 * ASIDE_MM * normal, -normal)


def _cut(points: Floats, origin: Vector3, ray: Vector3, at: float) -> float:
    """Return how far along the ray the plane through the points round ``at`` lies."""
    middle, normal = _plane(points[_nearest(points, origin + at * ray)])
    facing = float(normal @ ray)
    if abs(facing) < 0.1:
        raise DegenerateGeometryError(
            "the surface is seen from its edge at this place: turn the view"
        )
    return float((middle - origin) @ normal / facing)


def _nearest(points: Floats, place: Vector3) -> Ints:
    away = np.linalg.norm(points - place, axis=1)
    near = np.flatnonzero(away <= NEAR_MM)
    if len(near) < LEAST:
        near = np.flatnonzero(away <= 2.0 * NEAR_MM)
    if len(near) < LEAST:
        raise DegenerateGeometryError(
            f"only {len(near)} surface points were measured round this place, {LEAST} are needed: "
            "slide the pointer there first (step 4)"
        )
    return near


def _plane(points: Floats) -> tuple[Vector3, Vector3]:
    middle = points.mean(axis=0)
    _, vectors = np.linalg.eigh((points - middle).T @ (points - middle))
    return middle, vectors[:, 0]
