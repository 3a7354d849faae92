"""Least distances of convex bodies: from balls, and from planes that part them near by.

Two convex bodies are as far apart as the widest gap that a plane with any normal leaves between
them (Gilbert 1988). So every normal gives a lower bound of their distance, and the one that is
best at one place of the robot is nearly as good at the places about it.
"""

from collections.abc import Sequence

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.collision.coal_geometry import Pair
from rona_core.robot.collision.collision_geometry import ConvexBody
from rona_core.robot.collision.obstacles import Box, Capsule, Obstacle

STANDING = 0  # the link that never moves: obstacles are in its frame, which is ``base``


class SeparatingPlanes:
    """Bounds of the distances of p pairs of bodies."""

    def __init__(
        self,
        pairs: Sequence[Pair],
        bodies: Sequence[ConvexBody],
        things: Sequence[Obstacle],
    ) -> None:
        """Keep the corners of all bodies, in mm in the frames of their links."""
        links = {thing.name: STANDING for thing in things}
        links |= {body.name: body.link for body in bodies}
        corners = {thing.name: _corners(thing) for thing in things}
        corners |= {body.name: (body.vertices, 0.0) for body in bodies}
        ends = [[pair.first for pair in pairs], [pair.second for pair in pairs]]
        self._links: Ints = np.array([[links[name] for name in end] for end in ends], np.int64)
        self._corners = [[corners[name][0] for name in end] for end in ends]
        self._rounding_mm = np.array([[corners[name][1] for name in end] for end in ends])
        names = list(corners)
        balls = [_ball(points) for points, _ in corners.values()]
        self._ball_links = np.array([links[name] for name in names], np.int64)
        self._centers = np.array([center for center, _ in balls])
        self._balls = np.array([[names.index(name) for name in end] for end in ends], np.int64)
        radii_mm = np.array([radius_mm for _, radius_mm in balls])
        self._reach_mm = (radii_mm[self._balls] + self._rounding_mm).sum(axis=0)

    def between_balls_mm(self, rotations: Floats, places: Floats, chosen: Ints) -> Floats:
        """Return what some pairs keep apart at least by balls about them, (k, n).

        Quicker than ``bounds_mm``, and enough for most.

        Args:
            rotations: Of the link frames, (n, 7, 3, 3).
            places: Of the link frames, (n, 7, 3) in ``base``.
            chosen: Which pairs, (k,).
        """
        # the n come last: loops over three numbers are slow
        axes = np.ascontiguousarray(rotations.transpose(3, 2, 1, 0))
        centers = np.ascontiguousarray(places.transpose(2, 1, 0))[:, self._ball_links]
        for axis, along_mm in zip(axes, self._centers.T, strict=True):
            centers += axis[:, self._ball_links] * along_mm[:, None]
        first, second = self._balls[:, chosen]
        off = centers[:, second] - centers[:, first]
        return np.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2) - self._reach_mm[chosen, None]

    def bounds_mm(
        self, rotations: Floats, places: Floats, chosen: Ints, normals_base: Floats
    ) -> Floats:
        """Return what some pairs keep apart at least, (n, k); NaN where a normal is.

        Args:
            rotations: Of the link frames, (n, 7, 3, 3).
            places: Of the link frames, (n, 7, 3) in ``base``.
            chosen: Which pairs, (k,).
            normals_base: Unit vectors (k, 3) from the first body of each to the second, of planes
                that separate them at the middle one of the n.
        """
        first, second = self._links[:, chosen]
        # the planes go with the second body: in its frame the normals stay as they are
        own = np.einsum("kji,kj->ki", rotations[len(rotations) // 2, second], normals_base)
        normals = np.einsum("nkij,kj->nki", rotations[:, second], own)
        turned = np.einsum("nkji,nkj->kin", rotations[:, first], normals)
        before, behind = np.zeros((len(chosen), len(rotations))), np.zeros(len(chosen))
        for row, pair in enumerate(chosen.tolist()):
            (self._corners[0][pair] @ turned[row]).max(axis=0, out=before[row])
            behind[row] = (self._corners[1][pair] @ own[row]).min()
        apart = np.einsum("nki,nki->nk", normals, places[:, second] - places[:, first])
        return apart + behind - before.T - self._rounding_mm[:, chosen].sum(axis=0)


def _ball(points: Floats) -> tuple[Floats, float]:
    """Return the centre (3,) and the radius of a ball about points (n, 3)."""
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return center, float(np.linalg.norm(points - center, axis=1).max())


def _corners(thing: Obstacle) -> tuple[Floats, float]:
    """Return points (n, 3) in ``base``, and how far the obstacle reaches beyond their hull."""
    shape = thing.shape
    if isinstance(shape, Capsule):
        half = np.array((0.0, 0.0, 0.5 * shape.length_mm))
        return thing.pose @ np.stack((-half, half)), shape.radius_mm
    if isinstance(shape, Box):
        signs = np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
        return thing.pose @ (signs * np.array(shape.size_mm)), 0.0
    return thing.pose @ shape.vertices, 0.0
