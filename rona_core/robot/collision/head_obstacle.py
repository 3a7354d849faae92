"""A head to keep clear of, from what is known: a measured patch, a registered mesh, or a place.

A pointer touches only the patch that is to be scanned. A convex body whose radii of curvature are
nowhere larger than R lies inside the ball of radius R that touches it from outside at any of its
points (Blaschke 1916). So the head lies in the ball that touches the middle of the patch, whatever
part of the head the patch is and whichever way the head lies. See
docs/algorithms/robot/collision.md.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Bools, Floats, Vector3, as_points, as_unit_vectors
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.obstacles import HEAD, Capsule, Hull, Obstacle

LARGE_HEAD_MM = (180.0, 230.0, 270.0)  # broad, long, from vertex to chin: larger than adults have
FLATTEST_MM = 205.0  # largest radius of curvature of an ellipsoid of that size: 135 * 135 / 90
MIN_POINTS = 30
MIN_PATCH_MM = 5.0  # root mean square distance from the middle of the patch
DIRECTIONS = 500  # corners of the ball
TOUCH_MM = 5.0  # by which the delay line may reach below the measured surface
STRAY = 4.0  # robust sigmas of a point that belongs to no surface: a tip that was lifted
GOLDEN_RAD = np.pi * (3.0 - np.sqrt(5.0))


def head_from_cloud(points_base: ArrayLike, outward_base: ArrayLike, margin_mm: float) -> Obstacle:
    """Return all that a large head could be under a measured patch.

    Args:
        points_base: Touched points (n, 3) of the outer surface, in ``base``.
        outward_base: Any direction (3,) that points out of the head there.
        margin_mm: How far to keep from it.

    Raises:
        DegenerateGeometryError: too few points, or they do not spread over a patch.
    """
    points = as_points(points_base, name="points_base")
    if len(points) < MIN_POINTS:
        raise DegenerateGeometryError(
            f"{len(points)} points are too few for a head, {MIN_POINTS} are the least"
        )
    middle = points.mean(axis=0)
    spread, axes = np.linalg.svd(points - middle, full_matrices=False)[1:]
    if spread[1] / np.sqrt(len(points)) < MIN_PATCH_MM:
        raise DegenerateGeometryError(
            f"the points lie along a line ({spread[1] / np.sqrt(len(points)):.1f} mm broad): "
            "slide the pointer over a patch"
        )
    outward = as_unit_vectors(np.atleast_2d(outward_base), name="outward_base")[0]
    if axes[2] @ outward < 0.0:
        axes[2] = -axes[2]
    local = (points - middle) @ axes.T
    foot, normal, kept = _middle_of_patch(local)
    ball = foot + FLATTEST_MM * (_sphere() - normal)
    shape = middle + np.vstack((ball, local[kept])) @ axes
    return _head(shape, points[kept], margin_mm)


def head_from_mesh(
    vertices_skull: ArrayLike, T_base_skull: Pose, points_base: ArrayLike, margin_mm: float
) -> Obstacle:
    """Return the convex hull of a registered skull and of what was touched on it.

    Raises:
        DegenerateGeometryError: the vertices enclose nothing.
    """
    vertices = T_base_skull @ as_points(vertices_skull, at_least=4, name="vertices_skull")
    points = as_points(points_base, name="points_base")
    return _head(np.vstack((vertices, points)), points, margin_mm)


def head_as_placed(center_base: ArrayLike, margin_mm: float) -> Obstacle:
    """Return the ball that a large head fills, however it lies: before anything is measured."""
    radius_mm = 0.5 * max(LARGE_HEAD_MM)
    place = Pose.from_translation(center_base)
    return Obstacle(HEAD, Capsule(radius_mm, 0.0), place, margin_mm)


def _head(shape_base: Floats, touched_base: Floats, margin_mm: float) -> Obstacle:
    """Return the hull of some points; the probe may touch as deep in it as what was touched."""
    try:
        hull = ConvexHull(shape_base)
    except QhullError as error:
        raise DegenerateGeometryError("the points of the head enclose nothing") from error
    depth_mm = 0.0
    for part in np.array_split(touched_base, max(1, len(touched_base) // 500)):
        height = part @ hull.equations[:, :3].T + hull.equations[:, 3]
        depth_mm = max(depth_mm, float(-height.max(axis=1).min(initial=0.0)))
    corners = Hull(shape_base[hull.vertices])
    return Obstacle(HEAD, corners, Pose.identity(), margin_mm, depth_mm + TOUCH_MM)


def _middle_of_patch(local: Floats) -> tuple[Vector3, Vector3, Bools]:
    """Return a place (3,) on the surface, its outward normal (3,), and which points (n,) lie on it.

    The height over the plane of the patch is fitted by a quadratic; points far off are left out.
    """
    u, v, w = local.T
    terms = np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=1)
    kept = np.ones(len(u), dtype=np.bool_)
    bend = np.zeros(6)
    for _ in range(3):
        bend = np.linalg.lstsq(terms[kept], w[kept])[0]
        off = np.abs(w - terms @ bend)
        kept = off <= max(STRAY * 1.4826 * float(np.median(off[kept])), 1e-6)
    normal = np.array((-bend[1], -bend[2], 1.0))
    return np.array((0.0, 0.0, bend[0])), normal / np.linalg.norm(normal), kept


def _sphere() -> Floats:
    """Return directions (m, 3) spread evenly."""
    height = 1.0 - 2.0 * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    turn = GOLDEN_RAD * np.arange(DIRECTIONS)
    flat = np.sqrt(1.0 - height * height)
    return np.stack((flat * np.cos(turn), flat * np.sin(turn), height), axis=1)
