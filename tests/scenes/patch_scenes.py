"""Serpentine scan paths over a patch of a sphere, in six places around an arm: S0 to S5.

The patch measures 80 mm by 80 mm along the sphere, whose radius is 100 mm. Its serpentine has 9
lines of 10 or 17 lines of 18 way-points; filled in to 1 mm and 1 degree these are paths of 810 and
1526 points. The arm holds the tool perpendicular to its flange. With 72 constant rolls S3 and S4
cannot be scanned; S4 can where the roll varies along the path.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel

WayPoints = Literal[90, 306]

RADIUS_MM = 100.0
HALF_MM = 40.0  # half the side of the patch, along the sphere
N_ROLLS = 72
TOOL_FLANGE_MM = (120.0, 0.0, 60.0)
LINES: Mapping[WayPoints, tuple[int, int]] = MappingProxyType({90: (9, 10), 306: (17, 18)})


@dataclass(frozen=True, slots=True)
class PatchScene:
    """Where the sphere stands, where the patch looks, and what is known of it."""

    center_base: tuple[float, float, float]  # of the sphere, mm
    outward_base: tuple[float, float, float]  # towards the middle of the patch, any length
    feasible: int  # constant rolls of 72 with which the RX90 can follow the 90 way-points
    variable: bool  # whether a roll that varies along the path can


SCENES: Mapping[str, PatchScene] = MappingProxyType(
    {
        "S0": PatchScene((600, 100, 350), (0, 0, 1), 39, True),
        "S1": PatchScene((550, 0, 300), (-0.5, 0.3, 0.8), 13, True),
        "S2": PatchScene((700, 200, 350), (-0.3, 0, 1), 39, True),
        "S3": PatchScene((450, 100, 300), (-1, 0, 0.5), 0, False),
        "S4": PatchScene((650, 0, 400), (-0.8, 0, 0.6), 0, True),
        "S5": PatchScene((500, -300, 300), (0, 0.9, 0.4), 25, True),
    }
)


def scene_model(name: str = "rx90") -> RobotModel:
    """Return a robot with the tool of the scenes: axis along +x of ``flange``, 60 mm out."""
    model = robot_model(name)
    T_flange_tip = Pose.from_rotvec((0.0, np.pi / 2.0, 0.0), TOOL_FLANGE_MM)
    T_tip_probe = Pose.identity()
    tool = replace(model.tool, T_flange_tip=T_flange_tip, T_flange_probe=T_flange_tip @ T_tip_probe)
    return replace(model, tool=tool)


def scene_path(scene: str, way_points: WayPoints = 90) -> Path5D:
    """Return the path of a scene at 1 mm and 1 degree: 810 or 1526 points."""
    lines, per_line = LINES[way_points]
    return dense_path(scene, lines=lines, per_line=per_line)


def patch_axes(scene: str) -> tuple[Vector3, Vector3, Vector3]:
    """Return two directions along the patch and the outward one in its middle, in ``base``."""
    up: Vector3 = np.array(SCENES[scene].outward_base, dtype=np.float64)
    up /= np.linalg.norm(up)
    helper = np.array((0.0, 0.0, 1.0) if abs(up[2]) < 0.9 else (1.0, 0.0, 0.0))
    u: Vector3 = helper - (helper @ up) * up
    u /= np.linalg.norm(u)
    return u, np.cross(up, u), up


def serpentine(
    scene: str, lines: int = 9, per_line: int = 10, half_mm: float = HALF_MM
) -> tuple[Floats, Floats]:
    """Return way-points (n, 3) on the sphere and their outward normals (n, 3), in ``base``."""
    u, v, up = patch_axes(scene)
    normals: list[Floats] = []
    for i, across in enumerate(np.linspace(-half_mm, half_mm, lines)):
        for along in np.linspace(-half_mm, half_mm, per_line)[:: 1 if i % 2 == 0 else -1]:
            length = float(np.hypot(across, along))
            side = (across * u + along * v) / length if length > 0 else u
            angle = length / RADIUS_MM
            normals.append(np.cos(angle) * up + np.sin(angle) * side)
    outward = np.array(normals)
    return np.array(SCENES[scene].center_base) + RADIUS_MM * outward, outward


def dense_path(
    scene: str,
    step_mm: float = 1.0,
    step_deg: float = 1.0,
    lines: int = 9,
    per_line: int = 10,
    half_mm: float = HALF_MM,
) -> Path5D:
    """Return a serpentine as a path: straight in position, evenly turning in direction."""
    points, normals = serpentine(scene, lines, per_line, half_mm)
    out_points, out_axes = [points[:1]], [-normals[:1]]
    for p, q, a, b in zip(points[:-1], points[1:], -normals[:-1], -normals[1:], strict=True):
        angle = float(np.arccos(np.clip(a @ b, -1, 1)))
        n = int(np.ceil(max(np.linalg.norm(q - p) / step_mm, np.rad2deg(angle) / step_deg, 1)))
        t = np.arange(1, n + 1)[:, None] / n
        out_points.append(p + t * (q - p))
        if angle < 1e-12:
            out_axes.append(np.repeat(b[None], n, axis=0))
        else:
            turned = (np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle)
            out_axes.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
    return Path5D(np.concatenate(out_points), np.concatenate(out_axes))
