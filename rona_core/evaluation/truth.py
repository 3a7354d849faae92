"""Ground truth of the bone in ``base``, and what all figures against it share."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from rona_core.geometry.arrays import Bools, Floats, Vector3, as_points, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.redundancy.scan_postures import ScanPostures
from rona_core.session.captures import is_imported
from rona_core.virtual.pointer_motion import cross
from rona_core.virtual.scene import VirtualScene

if TYPE_CHECKING:
    from rona_core.session.document import Session


Figure = float | int | str | bool | None  # None where there is nothing to score yet
Figures = dict[str, Figure]


def rms(values: Floats) -> float | None:
    """Return the root mean square of finite values (n,) or vectors (n, 3); None without any."""
    known = values[np.isfinite(values)] if values.ndim == 1 else values
    return float(np.sqrt((known**2).sum() / len(known))) if len(known) else None


def head_place_base(session: "Session", scene: VirtualScene) -> Vector3:
    """Return how far (3,) the head was from its rest in the mean of the first stroke of step 4.

    Zero before it, and where the stroke came out of a file.
    """
    strokes = session.captures.surface
    if not strokes or is_imported(strokes[0]):
        return np.zeros(3)
    first = strokes[0]
    watched = first.head is not None and len(first.head.times_s) > 0
    track = first.head if first.head is not None and watched else first.marker
    if not len(track.times_s):
        return np.zeros(3)
    return scene.head_shift_base(first.ordinal, track.times_s).mean(axis=0)


def scan_postures(session: "Session") -> ScanPostures | None:
    """Return the postures of the first pass of a scan; None before one.

    The robot comes back to a place as it came there first: a further pass may have had another
    posture, and what that does to the maps is their error.
    """
    model, scan = robot_model(session.setup.devices.robot.model), session.captures.scan
    if scan is None or not len(scan.scans.times_s):
        return None
    qs_rad = scan.joints.at(scan.scans.times_s)
    faces = (model.forward(qs_rad) @ model.T_flange_probe).translations
    return ScanPostures(faces, qs_rad)


REST = readonly(np.zeros(3))
LANDMARK_MM = 30.0  # distance of the named points from the middle of the region
FACE_RINGS = 3  # of places about the middle of a face, that stand for all of it
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
    """True surfaces of the specimen of one scene, in ``base``.

    Attributes:
        scene: The scene.
        postures: Those that the robot scanned with.
        head_base: How far (3,) the head lies from its rest.
        T_base_skull: Where it lies.
    """

    def __init__(
        self,
        scene: VirtualScene,
        postures: ScanPostures | None = None,
        head_base: Vector3 = REST,
    ) -> None:
        """Look at this scene with the head where it lay in step 4, see `truth_of`."""
        self.scene, self.postures, self.head_base = scene, postures, head_base
        rest = scene.T_base_skull
        self.T_base_skull = Pose(rest.rotation, rest.translation + head_base)
        self._T_skull_base = self.T_base_skull.inv()
        self._feet: dict[bytes, tuple[Floats, Floats]] = {}  # of points that were asked for

    def foot(self, points_base: ArrayLike) -> tuple[Floats, Floats]:
        """Return the nearest points (n, 3) of the outer surface and the outward normals there.

        Several figures look at the same cells: what was found for them is kept.
        """
        points = as_points(points_base)
        key = points.tobytes()
        if key not in self._feet:
            specimen = self.scene.specimen
            foot_skull = specimen.closest(self._T_skull_base @ points)
            normals = self.T_base_skull.rotate(specimen.normal(foot_skull))
            self._feet[key] = readonly(self.T_base_skull @ foot_skull), readonly(normals)
        return self._feet[key]

    def signed_distance_mm(self, points_base: ArrayLike) -> Floats:
        """Return the distance (n,) to the outer surface along its normal, positive outside."""
        points = as_points(points_base)
        foot, normals = self.foot(points)
        return ((points - foot) * normals).sum(axis=1)

    def face_normals(self, points_base: ArrayLike, radius_mm: float) -> Floats:
        """Return the outward normals (n, 3) of the bone as a probe's face feels it.

        Each is that of the plane of least squared distances through the bone below a face that is
        centred at the nearest point. A point of rough bone has another normal, which nothing that
        is pressed on it feels.
        """
        feet, normals = self.foot(points_base)
        across = np.linalg.svd(normals[:, None])[2][:, 1:]
        places = feet[:, None] + radius_mm * _face() @ across
        near = self.foot(places.reshape(-1, 3))[0].reshape(places.shape)
        near = near - near.mean(axis=1, keepdims=True)
        planes = np.linalg.eigh(np.swapaxes(near, 1, 2) @ near)[1][:, :, 0]
        return planes * np.where((planes * normals).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]

    def thickness_mm(self, foot_base: Floats, normals_base: Floats) -> Floats:
        """Return the thickness (n,) of the bone below outer points, along the outer normal.

        Infinite where the bone has no inner boundary.
        """
        inward = self._T_skull_base.rotate(-normals_base)
        return self.scene.specimen.thickness(self._T_skull_base @ foot_base, inward)

    def thickness_below_mm(self, Ts_base_probe: Poses) -> Floats:
        """Return the thickness of the bone (n,) below the face of each probe, along its axis.

        Infinite where the axis misses the bone or its inner boundary.
        """
        axes = Ts_base_probe.rotations[:, :, 2]
        starts = Ts_base_probe.translations - BEHIND_MM * axes
        rays = self._T_skull_base @ starts, self._T_skull_base.rotate(axes)
        depths = self.scene.specimen.layers(*rays)
        missed = ~np.isfinite(depths).all(axis=1)
        return np.where(missed, np.inf, depths[:, 3] - np.where(missed, 0.0, depths[:, 0]))

    def landmarks_base(self) -> dict[str, Vector3]:
        """Return the five named points (3,) on the skull."""
        region = self.scene.specimen.region
        y, z = np.array((0.0, 1.0, 0.0)), np.array((0.0, 0.0, 1.0))
        aims = np.array(
            [region.center_skull + LANDMARK_MM * (a * y + b * z) for a, b in LANDMARKS.values()]
        )
        points_base = self.T_base_skull @ self.scene.specimen.closest(aims)
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
        above = above + self.head_base
        down = np.broadcast_to(-normal, above.shape)
        rays = self._T_skull_base @ above, self._T_skull_base.rotate(down)
        depth = self.scene.specimen.ray(*rays)
        met: Bools = np.isfinite(depth)
        return above[met] - depth[met][:, None] * normal


def _face() -> Floats:
    """Return places (k, 2) spread evenly over a disc of radius 1: its middle, and rings."""
    places = [np.zeros((1, 2))]
    for ring in range(1, FACE_RINGS + 1):
        turns = 2.0 * np.pi * np.arange(6 * ring) / (6 * ring)
        places.append(ring / FACE_RINGS * np.column_stack((np.cos(turns), np.sin(turns))))
    return np.concatenate(places)


def truth_of(session: "Session", scene: VirtualScene) -> Truth:
    """Return the truth that the results of a session are held against."""
    return Truth(scene, scan_postures(session), head_place_base(session, scene))
