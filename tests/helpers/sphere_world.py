"""Exact doubles: a bone of spheres, a robot of known error, tools that move by script."""

from dataclasses import dataclass, field

import numpy as np
import trimesh

from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Poses
from rona_core.virtual.specimen.simulated.simulated_skull import cube_sphere

DEPTHS_MM = {"outer": 0.0, "diploe_outer": 1.5, "diploe_inner": 4.0, "inner": 6.0}


@dataclass(frozen=True)
class SphereRegion:
    center_skull: np.ndarray
    normal_skull: np.ndarray
    radius_mm: float = 25.0


@dataclass(frozen=True)
class SphereSpecimen:
    """Bone between spheres about one centre; the region is where ``normal`` leaves it."""

    radius_mm: float = 80.0
    center: tuple[float, float, float] = (5.0, -7.0, 11.0)
    normal_skull: tuple[float, float, float] = (-0.8, -0.36, 0.48)
    region_radius_mm: float = 25.0
    depths: dict = field(default_factory=lambda: dict(DEPTHS_MM))

    head_axes_skull = None

    @property
    def region(self):
        n = np.array(self.normal_skull) / np.linalg.norm(self.normal_skull)
        return SphereRegion(np.array(self.center) + self.radius_mm * n, n, self.region_radius_mm)

    def ray(self, origins_skull, directions_skull, boundary="outer"):
        p = np.asarray(origins_skull) - self.center
        d = np.asarray(directions_skull)
        radius = self.radius_mm - self.depths[boundary]
        b = (p * d).sum(axis=1)
        root = b**2 - (p**2).sum(axis=1) + radius**2
        near = -b - np.sqrt(np.maximum(root, 0.0))
        return np.where((root >= 0) & (near >= 0), near, np.inf)

    def layers(self, origins_skull, directions_skull):
        return np.stack([self.ray(origins_skull, directions_skull, b) for b in self.depths], axis=1)

    def thickness(self, points_skull, directions_skull):
        d = np.asarray(directions_skull)
        return self.ray(np.asarray(points_skull) - d, d, "inner") - 1.0

    def closest(self, points_skull):
        n = self.normal(points_skull)
        return self.center + self.radius_mm * n

    def normal(self, points_skull):
        p = np.asarray(points_skull) - self.center
        return p / np.linalg.norm(p, axis=1)[:, None]

    def mesh(self, edge_mm=3.0):

        mesh = trimesh.creation.icosphere(2, self.radius_mm)
        return Mesh(np.array(mesh.vertices) + self.center, np.array(mesh.faces, dtype=np.int64))

    def drawn_head(self, edge_mm=3.0):
        return None


@dataclass(frozen=True)
class ShiftError:
    """A robot that is always off by the same vector."""

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def Ts_base_tip_true(self, Ts_base_tip_nominal, qs_rad, ordinal, keys):  # noqa: N802
        nominal = Ts_base_tip_nominal
        return Poses(nominal.rotations, nominal.translations + np.array(self.offset))

    def systematic_mm(self, points_base, qs_rad=None):
        return np.broadcast_to(np.array(self.offset), np.shape(points_base)).copy()

    def of_motion_mm(self, ordinal, key):
        return np.zeros(3)


def boundary_meshes(specimen, edge_mm):
    """Return the outer and the inner boundary of a simulated skull as two trimeshes."""
    cells = round(120.0 / edge_mm)
    faces, directions = cube_sphere(cells)
    radii = specimen.shape.radii(directions)
    center = specimen.shape.center_skull
    return [trimesh.Trimesh(center + radii[:, [k]] * directions, faces) for k in (0, 3)]


class ScriptedWorld:
    """Tools that move as ``true_pose(tool, time_s)`` says; None for a tool that is not there.

    ``clear(tool, T_tracker_marker, time_s)`` says which markers (m,) nothing hides; None: all.
    Without ``foreseen`` the motion answers to what happens: frames are measured one by one.
    """

    def __init__(self, true_pose, clear=None, *, foreseen=True):
        self.true_pose, self.hidden_by, self.foreseen = true_pose, clear, foreseen
        self.changes = 0  # to be raised when the motion becomes another

    def Ts_tracker_marker(self, tool, times_s):  # noqa: N802
        poses = [self.true_pose(tool, float(time_s)) for time_s in times_s]
        return None if poses[0] is None else Poses.stack(poses)

    def sight(self, times_s):
        def clear(tool, Ts_tracker_marker):
            if self.hidden_by is None:
                markers = len(GEOMETRIES[tool].positions_marker)
                return np.ones((len(times_s), markers), dtype=bool)
            looks = zip(Ts_tracker_marker, times_s, strict=True)
            return np.stack([self.hidden_by(tool, pose, float(time_s)) for pose, time_s in looks])

        return clear

    def motion_key(self):
        return self.changes if self.foreseen else None


def signed_distance(specimen, points_skull):
    """Return the distance (n,) of points to the outer surface of any specimen, positive outside."""
    foot = specimen.closest(points_skull)
    side = ((points_skull - foot) * specimen.normal(foot)).sum(axis=1)
    return np.where(side < 0.0, -1.0, 1.0) * np.linalg.norm(points_skull - foot, axis=1)
