"""Made-up measurements with known answers for the figures of registration."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.devices.trackers import GEOMETRIES
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Pose, Poses

STEREO = MarkerNoise(sigma_mm=0.35)  # depth three times worse, 3D RMS of one marker
ROBOT_MM, ROBOT_DEG = 0.1, 0.02  # RMS of the whole shift, of the whole turn
DISTANCE_MM = 1900.0
TIP_BASE = np.array((600.0, 0.0, 350.0))
TARGETS_BASE = TIP_BASE + np.array(
    ((0, 0, -10.0), (60, 0, 20), (-60, 0, 20), (0, 60, 20), (0, -60, 20))
)
HALF_AXES_MM = np.array((75.0, 95.0, 72.0))


@dataclass(frozen=True, slots=True, eq=False)
class ToolWorld:
    """Poses seen by robot and tracker, and the truth behind them."""

    Ts_base_tip: Poses
    Ts_tracker_toolmarker: Poses
    phases: Ints
    T_base_tracker: Pose
    T_toolmarker_tip: Pose


def tool_world(rng: np.random.Generator, n: int = 50, gross: float = 0.0) -> ToolWorld:
    """Return the paper's motion: 60 % pivots with turns up to 20 degrees, then 100 mm along x, y.

    The tracker looks at the marker plate from 1.9 m. Gross errors are 5 to 50 mm and 1 to 20
    degrees.
    """
    n_pivot = round(0.6 * n)
    n_x = (n - n_pivot) // 2
    phases = np.repeat((0, 1, 2), (n_pivot, n_x, n - n_pivot - n_x))
    start = Pose.from_rotvec((np.pi, 0.0, 0.0), TIP_BASE)
    turns = Rotation.from_rotvec(np.deg2rad(rng.uniform(-20.0, 20.0, (n, 3)))).as_matrix()
    turns[phases > 0] = np.eye(3)
    shifts = np.zeros((n, 3))
    for axis in (0, 1):
        rows = phases == axis + 1
        shifts[rows, axis] = np.linspace(-50.0, 50.0, int(rows.sum()))
    exact = Poses(start.rotation @ turns, start.translation + shifts @ start.rotation.T)
    T_toolmarker_tip = Pose.from_rotvec(rng.normal(0.0, 0.3, 3), (0.0, -150.0, -40.0))
    T_base_toolmarker = start @ T_toolmarker_tip.inv()
    depth = -T_base_toolmarker.rotation[:, 2] + rng.normal(0.0, 0.2, 3)
    T_base_tracker = looking(depth, T_base_toolmarker.translation, rng)
    # the robot reports what it was told to do; the tracker sees where it went
    went = T_base_tracker.inv() @ _shaken(exact, rng) @ T_toolmarker_tip.inv()
    seen = _upset(tracked(went, "toolmarker", STEREO, rng), gross, rng)
    return ToolWorld(exact, seen, phases, T_base_tracker, T_toolmarker_tip)


def looking(depth_base: Floats, at_base: Floats, rng: np.random.Generator) -> Pose:
    """Return ``T_base_tracker`` that looks along a direction at a place 1.9 m away."""
    z = depth_base / np.linalg.norm(depth_base)
    x = np.cross(z, rng.normal(size=3))
    x /= np.linalg.norm(x)
    return Pose(np.column_stack((x, np.cross(z, x), z)), at_base - DISTANCE_MM * z)


def tracked(
    Ts_tracker_marker: Poses, tool: str, noise: MarkerNoise, rng: np.random.Generator
) -> Poses:
    """Return the poses that a tracker fits, without weights, to noisy markers of a tool."""
    positions = GEOMETRIES[tool].positions_marker
    middle = positions.mean(axis=0)
    R, t = Ts_tracker_marker.rotations, Ts_tracker_marker.translations
    seen = np.einsum("nij,mj->nmi", R, positions) + t[:, None]
    seen = seen + (noise.sigma_mm or 0.0) * noise.shape() * rng.normal(size=seen.shape)
    centers = seen.mean(axis=1)
    u, _, vt = np.linalg.svd(np.einsum("nmi,mj->nij", seen - centers[:, None], positions - middle))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return Poses(u @ vt, centers - u @ vt @ middle)


def _shaken(poses: Poses, rng: np.random.Generator) -> Poses:
    n = len(poses)
    turns = rng.normal(0.0, np.deg2rad(ROBOT_DEG) / np.sqrt(3.0), (n, 3))
    shifts = rng.normal(0.0, ROBOT_MM / np.sqrt(3.0), (n, 3))
    turned = Rotation.from_rotvec(turns).as_matrix() @ poses.rotations
    return Poses(turned, poses.translations + shifts)


def _upset(poses: Poses, share: float, rng: np.random.Generator) -> Poses:
    rows = rng.permutation(len(poses))[: round(share * len(poses))]
    rotations, translations = poses.rotations.copy(), poses.translations.copy()
    ways = rng.normal(size=(2, len(rows), 3))
    axes, ways = ways / np.linalg.norm(ways, axis=2)[:, :, None]
    angles = np.deg2rad(rng.uniform(1.0, 20.0, (len(rows), 1)))
    if len(rows):
        rotations[rows] = Rotation.from_rotvec(angles * axes).as_matrix() @ rotations[rows]
    translations[rows] += rng.uniform(5.0, 50.0, (len(rows), 1)) * ways
    return Poses(rotations, translations)


def skull_radius_mm(directions: Floats) -> Floats:
    """Return the radius (n,) of an ellipsoid with smooth bumps in unit directions (n, 3)."""
    x, y, z = directions.T
    bumps = 0.03 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.02 * np.sin(4 * z + 2 * x)
    bumps += 0.015 * np.cos(5 * y - 3 * z)
    return (1.0 + bumps) / np.sqrt(((directions / HALF_AXES_MM) ** 2).sum(axis=1))


def skull_points(n: int = 60000) -> tuple[Floats, Floats]:
    """Return points and outward normals (n, 3) of that skull, spread evenly."""
    i = np.arange(n) + 0.5
    z, azimuth = 1.0 - 2.0 * i / n, i * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - z**2)
    u = np.column_stack((across * np.cos(azimuth), across * np.sin(azimuth), z))

    def implicit(p: Floats) -> Floats:
        lengths = np.linalg.norm(p, axis=1)
        return lengths - skull_radius_mm(p / lengths[:, None])

    points = u * skull_radius_mm(u)[:, None]
    slopes = [implicit(points + 1e-4 * e) - implicit(points - 1e-4 * e) for e in np.eye(3)]
    normals = np.column_stack(slopes)
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def skull_patch(rng: np.random.Generator, n: int, half_angle_deg: float, gross: float) -> Floats:
    """Return digitised points (n, 3) of its upper side, 0.2 mm noise, some 5 to 30 mm off."""
    z = rng.uniform(np.cos(np.deg2rad(half_angle_deg)), 1.0, n)
    azimuth, across = rng.uniform(0.0, 2.0 * np.pi, n), np.sqrt(1.0 - z**2)
    tilt = Rotation.from_rotvec(rng.normal(0.0, 0.4, 3)).as_matrix()
    u = np.column_stack((across * np.cos(azimuth), across * np.sin(azimuth), z)) @ tilt.T
    points = u * skull_radius_mm(u)[:, None] + rng.normal(0.0, 0.2 / np.sqrt(3.0), (n, 3))
    rows = rng.permutation(n)[: round(gross * n)]
    ways = rng.normal(size=(len(rows), 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    points[rows] += ways * rng.uniform(5.0, 30.0, (len(rows), 1))
    return points
