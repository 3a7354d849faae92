"""Simulated sets of robot and sensor poses for hand-eye calibration, and solvers of others.

The sensor is an optical tracker beside the robot that fits a body of four markers, or a camera on
the robot that finds the corners of a board; its errors are those of markers and pixels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.linalg import sqrtm
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.recorded_poses import SensorNoise, Setup
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.rigid_fit import register_points

FAMILIES = ("clean", "gross", "few", "parallel")
METHODS = ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")
Solver = Callable[[Poses, Poses], Pose]  # T_a_b of poses left and right: right of T_b_c = sensor
BODY = np.array(((-31.0, -22.0, 0.0), (38.0, -19.0, 2.0), (27.0, 33.0, -1.0), (-24.0, 28.0, 4.0)))
BOARD = np.array([(25.0 * i, 25.0 * j, 0.0) for i in range(9) for j in range(6)])
FOCAL_PX = 1150.0
STEPS = 8  # of the fit of a board


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeSet:
    """Poses as they were measured, and where the sensor is."""

    family: str
    setup: Setup
    noise: SensorNoise
    Ts_base_tip: Poses
    Ts_tracker_marker: Poses
    sensor: Pose

    def solved_by(self, solve: Solver) -> Pose:
        """Return the sensor by a solver of AX = XB."""
        robot = self.Ts_base_tip
        return solve(robot if self.setup == "eye-in-hand" else robot.inv(), self.Ts_tracker_marker)


def made_set(family: str, seed: int) -> HandEyeSet:
    """Return one set; even seeds have a tracker, odd ones a camera."""
    rng = np.random.default_rng((46, FAMILIES.index(family), seed))
    in_hand = bool(seed % 2)
    n = int(rng.integers(6, 10)) if family == "few" else int(rng.integers(15, 41))
    tilt = np.deg2rad(rng.uniform(20.0, 45.0)) * rng.uniform(-1.0, 1.0, (n, 3))
    if family == "parallel":
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        along = np.outer(tilt @ axis, axis)
        tilt = along + np.deg2rad(rng.uniform(0.3, 1.5)) * rng.normal(size=(n, 3)) / np.sqrt(3.0)
    T_a_marker = Pose.from_rotvec(rng.normal(0.0, 1.0, 3), rng.uniform(-120.0, 120.0, 3))
    if in_hand:
        sensor = Pose.from_rotvec(rng.normal(0.0, 0.5, 3), rng.uniform(-80.0, 80.0, 3))
        board = Pose.from_rotvec((np.pi, 0.0, 0.0), (450.0, 100.0, 20.0))
        seen = [
            Pose.from_translation(rng.uniform((-60, -60, 330), (60, 60, 600)))
            @ Pose.from_rotvec(t)
            @ Pose.from_translation(-BOARD.mean(axis=0))
            for t in tilt
        ]
        Ts_tracker_marker = Poses.stack(seen)
        Ts_base_tip = board @ Ts_tracker_marker.inv() @ sensor.inv()
        measured = _by_camera(Ts_tracker_marker, rng.uniform(0.1, 0.5), rng)
    else:
        sensor = Pose.from_rotvec(rng.normal(0.0, 1.0, 3), (800.0, -1300.0, 900.0))
        middle = sensor.inv() @ Pose.from_translation((500.0, 0.0, 300.0)).translation
        sensor = sensor @ Pose.from_translation(middle - (50.0, -80.0, 1800.0))
        start = Pose.from_translation((500.0, 0.0, 300.0)) @ Pose.from_rotvec((np.pi, 0.0, 0.0))
        Ts_base_tip = Poses.stack(
            [start @ Pose.from_rotvec(t, rng.uniform(-120.0, 120.0, 3)) for t in tilt]
        )
        Ts_tracker_marker = sensor.inv() @ (Ts_base_tip @ T_a_marker)
        measured = _by_tracker(Ts_tracker_marker, rng.uniform(0.05, 0.3), rng)
    if family == "gross":
        measured = _spoiled(measured, rng)
    robot = Poses.stack(
        [
            p @ Pose.from_rotvec(rng.normal(0.0, 1.5e-4, 3) / 3, rng.normal(0.0, 0.02, 3))
            for p in Ts_base_tip
        ]
    )
    setup: Setup = "eye-in-hand" if in_hand else "eye-to-hand"
    return HandEyeSet(family, setup, "camera" if in_hand else "tracker", robot, measured, sensor)


def _by_tracker(poses: Poses, noise_mm: float, rng: np.random.Generator) -> Poses:
    per_axis = noise_mm * np.array((0.45, 0.45, 1.2)) / np.sqrt(2.0 * 0.45**2 + 1.2**2)
    seen = [p @ BODY + rng.normal(size=BODY.shape) * per_axis for p in poses]
    return Poses.stack([register_points(BODY, points).T_b_a for points in seen])


def _by_camera(poses: Poses, noise_px: float, rng: np.random.Generator) -> Poses:
    """Return the poses that fit noisy corners best, by Gauss-Newton from the true ones."""
    found: list[Pose] = []
    for pose in poses:
        corners = pose @ BOARD
        image = FOCAL_PX * corners[:, :2] / corners[:, 2:] + rng.normal(0.0, noise_px, (54, 2))
        for _ in range(STEPS):
            p = pose @ BOARD
            z = p[:, 2]
            J = np.zeros((len(p), 2, 3))
            J[:, 0, 0] = J[:, 1, 1] = FOCAL_PX / z
            J[:, :, 2] = -FOCAL_PX * p[:, :2] / z[:, None] ** 2
            arm = p - pose.translation
            turn = np.zeros((len(p), 3, 3))
            turn[:, 0, 1], turn[:, 0, 2], turn[:, 1, 2] = arm[:, 2], -arm[:, 1], arm[:, 0]
            turn -= np.swapaxes(turn, 1, 2)
            full = np.concatenate((J @ turn, J), axis=2).reshape(-1, 6)
            off = (image - FOCAL_PX * p[:, :2] / z[:, None]).ravel()
            step = np.linalg.lstsq(full, off)[0]
            R = Rotation.from_rotvec(step[:3]).as_matrix() @ pose.rotation
            pose = Pose(R, pose.translation + step[3:])
        found.append(pose)
    return Poses.stack(found)


def _spoiled(poses: Poses, rng: np.random.Generator) -> Poses:
    """Return the poses with gross errors in one of twenty, at least one."""
    bad = rng.permutation(len(poses))[: max(1, round(0.05 * len(poses)))]
    held = list(poses)
    for i in bad:
        turn = rng.normal(size=3)
        turn *= np.deg2rad(rng.uniform(2.0, 20.0)) / np.linalg.norm(turn)
        held[i] = Pose.from_translation(rng.uniform(-50.0, 50.0, 3)) @ held[i]
        held[i] = held[i] @ Pose.from_rotvec(turn)
    return Poses.stack(held)


# ------------------------------------------------------------------ others


def park(left: Poses, right: Poses) -> Pose:
    """Return X of AX = XB by Park 1994, of all pairs of poses."""
    i, j = np.triu_indices(len(left), 1)
    A = left.select(i).inv() @ left.select(j)
    B = right.select(i) @ right.select(j).inv()
    a, b = (Rotation.from_matrix(m.rotations).as_rotvec() for m in (A, B))
    M = b.T @ a
    R = np.real(np.asarray(np.linalg.solve(np.asarray(sqrtm(M.T @ M)), M.T)))
    design = (A.rotations - np.eye(3)).reshape(-1, 3)
    wanted = (B.translations @ R.T - A.translations).ravel()
    u, _, vt = np.linalg.svd(R)
    shift = np.asarray(np.linalg.lstsq(design, wanted)[0], dtype=np.float64)
    return Pose(u @ vt, shift)


def solvers() -> dict[str, Solver]:
    """Return the five methods of OpenCV, or that of Park alone where it is not installed."""
    if find_spec("cv2") is None:
        return {"Park (ours)": park}
    cv2: Any = import_module("cv2")

    def by(method: str) -> Solver:
        def solve(left: Poses, right: Poses) -> Pose:
            parts = (left.rotations, left.translations, right.rotations, right.translations)
            known = getattr(cv2, f"CALIB_HAND_EYE_{method}")
            R, t = cv2.calibrateHandEye(*(list(part) for part in parts), method=known)
            u, _, vt = np.linalg.svd(np.asarray(R, dtype=np.float64))
            return Pose(u @ vt, np.asarray(t, dtype=np.float64).ravel())

        return solve

    return {f"OpenCV {method.capitalize()}": by(method) for method in METHODS}


def error_of(found: Pose, true: Pose) -> Floats:
    """Return turn (rad) and shift (mm) by which a pose is off (6,)."""
    turn = Rotation.from_matrix(found.rotation @ true.rotation.T).as_rotvec()
    return np.concatenate((turn, found.translation - true.translation))
