"""Ground truth of the bone in ``base``."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Bools, Floats, Vector3, as_points
from rona_core.geometry.pose import Poses
from rona_core.virtual.pointer_motion import cross
from rona_core.virtual.scene import VirtualScene

LANDMARK_MM = 30.0  # distance of the named points from the middle of the region
BEHIND_MM = 20.0  # rays along a probe's axis start this far before its face

# Five named points on the skull: the middle of the region, and the places on the outer surface next
# to points 30 mm away from it along the axes of `skull` (y forward, z to the top of the head).
LANDMARKS = {
    "middle": (0.0, 0.0),
    "minus_y": (-1.0, 0.0),
    "plus_y": (1.0, 0.0),
    "minus_z": (0.0, -1.0),
    "plus_z": (0.0, 1.0),
}


class Truth:
    """True surfaces of the specimen of one scene, in ``base``."""

    def __init__(self, scene: VirtualScene) -> None:
        """Look at this scene."""
        self.scene = scene
        self._T_base_skull = scene.T_base_skull
        self._T_skull_base = scene.T_base_skull.inv()

    def foot(self, points_base: ArrayLike) -> tuple[Floats, Floats]:
        """Return the nearest points (n, 3) of the outer surface and the outward normals there."""
        specimen = self.scene.specimen
        foot_skull = specimen.closest(self._T_skull_base @ as_points(points_base))
        normals = self._T_base_skull.rotate(specimen.normal(foot_skull))
        return self._T_base_skull @ foot_skull, normals

    def signed_distance_mm(self, points_base: ArrayLike) -> Floats:
        """Return the distance (n,) to the outer surface along its normal, positive outside."""
        points = as_points(points_base)
        foot, normals = self.foot(points)
        return ((points - foot) * normals).sum(axis=1)

    def thickness_mm(self, foot_base: Floats, normals_base: Floats) -> Floats:
        """Return the thickness (n,) of the bone below outer points, along the outer normal.

        Infinite where the bone has no inner boundary.
        """
        inward = self._T_skull_base.rotate(-normals_base)
        return self.scene.specimen.thickness(self._T_skull_base @ foot_base, inward)

    def inner_below_mm(self, Ts_base_probe: Poses) -> Floats:
        """Return distances (n,) from the face of a probe to the inner boundary along its axis.

        Infinite where the axis misses it.
        """
        axes = Ts_base_probe.rotations[:, :, 2]
        starts = Ts_base_probe.translations - BEHIND_MM * axes
        rays = self._T_skull_base @ starts, self._T_skull_base.rotate(axes)
        return self.scene.specimen.layers(*rays)[:, 3] - BEHIND_MM

    def landmarks_base(self) -> dict[str, Vector3]:
        """Return the five named points (3,) on the skull."""
        region = self.scene.specimen.region
        y, z = np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0))
        aims = np.array(
            [region.center_skull + LANDMARK_MM * (a * y + b * z) for a, b in LANDMARKS.values()]
        )
        points_base = self._T_base_skull @ self.scene.specimen.closest(aims)
        return dict(zip(LANDMARKS, points_base, strict=True))

    def region_points(self, step_mm: float = 1.0) -> Floats:
        """Return points (n, 3) of the outer surface over the disc to be scanned, on a grid.

        The disc lies in the tangent plane at the middle of the region; places without bone are
        left out.
        """
        center, normal, radius_mm = self.scene.region_base()
        x = cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        x /= np.linalg.norm(x)
        y = cross(normal, x)
        n = int(np.floor(radius_mm / step_mm))
        u, v = np.meshgrid(np.arange(-n, n + 1) * step_mm, np.arange(-n, n + 1) * step_mm)
        inside = np.hypot(u, v) <= radius_mm
        above = center + u[inside][:, None] * x + v[inside][:, None] * y + 2 * BEHIND_MM * normal
        down = np.broadcast_to(-normal, above.shape)
        rays = self._T_skull_base @ above, self._T_skull_base.rotate(down)
        depth = self.scene.specimen.ray(*rays)
        met: Bools = np.isfinite(depth)
        return above[met] - depth[met][:, None] * normal
