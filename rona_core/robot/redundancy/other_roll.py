"""Postures that reach the same places of the probe with another roll about its axis."""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.arm import wrapped
from rona_core.robot.kinematics.robot_model import RobotModel

TURNS_DEG = (90.0, -90.0, 60.0, -60.0, 30.0, -30.0)  # the first that is reached everywhere


def with_other_roll(model: RobotModel, qs_rad: Floats) -> tuple[float, Floats] | None:
    """Return by how much the roll was turned, in degrees, and the postures (n, 6) with it.

    Each is the one nearest to the posture it stands for; None where no turn of ``TURNS_DEG`` is
    within reach at all n places.

    Args:
        model: The robot.
        qs_rad: Postures (n, 6).
    """
    probes = model.forward(qs_rad) @ model.T_flange_probe
    rows = np.arange(len(qs_rad))
    for turn_deg in TURNS_DEG:
        turn = Pose.from_rotvec((0.0, 0.0, np.deg2rad(turn_deg)))
        found = model.inverse(probes @ (turn @ model.T_flange_probe.inv()))
        steps = wrapped(found.qs_rad - qs_rad[:, None])
        qs = qs_rad[:, None] + steps
        reached = found.valid & (model.limits.clearance_rad(qs).min(axis=2) >= 0.0)
        if len(rows) and reached.any(axis=1).all():
            away = np.where(reached, np.abs(steps).max(axis=2), np.inf)
            return turn_deg, qs[rows, np.argmin(away, axis=1)]
    return None
