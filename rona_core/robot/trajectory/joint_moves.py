"""Moves of the joints from rest to rest, away from the scan path, and sampling them in time."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.arm import as_posture
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.point_to_point import plan_joint_path
from rona_core.robot.trajectory.trajectory import SAMPLE_S, Trajectory, sampled_motion

SPEED_SHARE = 0.3  # of the joint speed limits, for moves that are not scans
ACCELERATION_SHARE = 0.9
TIP_SPEED_MM_PER_S = 250.0  # what robots near people are commonly held to
PEAK_SPEED, PEAK_ACCELERATION = 1.875, 10.0 / np.sqrt(3.0)  # of the quintic below, for T = 1
TIP_SAMPLES = 64


def smooth_step(share: Floats) -> Floats:
    """Return 10 u^3 - 15 u^4 + 6 u^5: from 0 to 1 with rest, and no acceleration, at both ends."""
    u = np.clip(share, 0.0, 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u**2)


def sample_times(duration_s: float) -> Floats:
    """Return sample times from 0 that cover ``duration_s``, rounded up to whole samples."""
    count = max(1, int(np.ceil(duration_s / SAMPLE_S - 1e-9)))
    return np.arange(count + 1, dtype=np.float64) * SAMPLE_S


def joint_move(model: RobotModel, q_from_rad: Floats, q_to_rad: Floats) -> Floats:
    """Return samples (n, 6) of a straight move in joint space, ``SAMPLE_S`` apart.

    All joints start and stop together. The slowest of joint speed, joint acceleration and the
    speed of the tip decides how long it takes.
    """
    way = q_to_rad - q_from_rad
    by_speed = PEAK_SPEED * np.abs(way) / (SPEED_SHARE * model.speed_rad_per_s)
    most = ACCELERATION_SHARE * model.acceleration_rad_per_s2
    by_acceleration = np.sqrt(PEAK_ACCELERATION * np.abs(way) / most)
    u = np.linspace(0.0, 1.0, TIP_SAMPLES + 1)[:, None]
    tips = (model.forward(q_from_rad + u * way) @ model.T_flange_tip).translations
    tip_mm = np.linalg.norm(np.diff(tips, axis=0), axis=1).max() * TIP_SAMPLES
    by_tip = PEAK_SPEED * tip_mm / (ACCELERATION_SHARE * TIP_SPEED_MM_PER_S)
    times = sample_times(max(by_speed.max(), by_acceleration.max(), by_tip))
    qs = q_from_rad + smooth_step(times / times[-1])[:, None] * way
    qs[-1] = q_to_rad
    return qs


def chain(parts: Sequence[Floats]) -> Floats:
    """Return motions that follow each other as one; each starts where the last one ended."""
    return np.concatenate([parts[0], *(part[1:] for part in parts[1:])])


def clear_move(
    model: RobotModel,
    q_from_rad: Floats,
    q_to_rad: Floats,
    clear: Clear | None,
) -> Floats:
    """Return samples (n, 6) of a move on which nothing is touched, ``SAMPLE_S`` apart.

    It is the straight move where that is clear or nothing is known of the surroundings
    (``clear`` is None); otherwise it rests at each place that it goes by.

    Raises:
        NotReachableError: no clear way was found.
    """
    if clear is None:
        return joint_move(model, q_from_rad, q_to_rad)
    stops = plan_joint_path(q_from_rad, q_to_rad, model, clear)
    return chain([joint_move(model, a, b) for a, b in pairwise(stops)])


def plan_joint_move(
    q_from_rad: ArrayLike,
    q_to_rad: ArrayLike,
    model: RobotModel,
    *,
    clear: Clear | None = None,
) -> Trajectory:
    """Plan a move in joint space from rest to rest: straight, or around what is in the way.

    Args:
        q_from_rad: Joint angles (6,) where the robot stands.
        q_to_rad: Joint angles (6,) to go to.
        model: The robot.
        clear: Tells for joint angles (n, 6) where nothing is touched; None: nothing is around.

    Raises:
        InvalidInputError: wrong shapes.
        NotReachableError: the goal lies outside the joint limits, or no clear way was found.
    """
    q_from = as_posture(q_from_rad, name="q_from_rad")
    q_to = as_posture(q_to_rad, name="q_to_rad")
    room = model.limits.clearance_rad(q_to)
    if room.min() < 0.0:
        joint = int(np.argmin(room))
        low, high, goal = np.rad2deg((model.lower_rad[joint], model.upper_rad[joint], q_to[joint]))
        raise NotReachableError(
            f"joint {joint + 1} cannot go to {goal:.1f}°: it moves from {low:.1f}° to {high:.1f}°",
            joint=joint + 1,
        )
    return sampled_motion(clear_move(model, q_from, q_to, clear))
