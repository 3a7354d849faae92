"""How much room a joint path leaves: to limits, singularities, jumps and the end of the reach.

Room is a plain number: the distance from the border of what is allowed, in steps of a size that
is comfortable for that quantity. Negative room means not allowed. See
docs/algorithms/robot/roll_search.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.settings import require
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.joint_limits import JointLimits, shift_to_fit, unwrap
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.kinematics.spherical_wrist import IkSolutions

EVEN_DIGITS = 9  # decimals of room; what agrees in them is the same room
ROUNDED_MM = 1e-9  # a pose that cannot be reached is outside by at least this much


@dataclass(frozen=True, slots=True)
class RoomRules:
    """What is allowed along a path, and what counts as one unit of room."""

    singular_rad: float = float(np.deg2rad(5.0))  # least angle of elbow and wrist from straight
    shoulder_mm: float = 30.0  # least distance of the wrist centre from axis 1
    step_rad: float = float(np.deg2rad(10.0))  # largest joint step between dense samples
    limit_unit_rad: float = float(np.deg2rad(20.0))
    singular_unit: float = float(np.sin(np.deg2rad(20.0)))
    shoulder_unit_mm: float = 150.0
    step_unit_rad: float = float(np.deg2rad(5.0))
    reach_unit_mm: float = 100.0

    def __post_init__(self) -> None:
        require(0.0 < self.singular_rad < np.pi / 2, "singular_rad must be 0 to pi/2")
        require(self.shoulder_mm >= 0.0, "shoulder_mm must not be negative")
        require(0.0 < self.step_rad < np.pi, "step_rad must be 0 to pi")


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """Room of all branches over n samples, by cause; the least of them decides."""

    qs_rad: Floats  # (n, 8, 6) continuous, turns chosen to fit the limits
    reach: Floats  # (n, 8)
    singularity: Floats  # (n, 8)
    limit: Floats  # (n, 8)
    jump: Floats  # (n, 8) of the step that leads to the sample

    def least(self) -> Floats:
        """Return the least room (n, 8) of each sample."""
        return np.minimum(
            np.minimum(self.reach, self.singularity), np.minimum(self.limit, self.jump)
        )


def judge(model: RobotModel, Ts_base_flange: Poses, rules: RoomRules) -> Room:
    """Return the room of every branch along a sequence of flange poses."""
    solutions = model.inverse(Ts_base_flange)
    qs = continuous(solutions.qs_rad, model.limits)
    steps = np.abs(np.diff(qs, axis=0)).max(axis=2, initial=0.0)
    jump = np.full(qs.shape[:2], rules.step_rad / rules.step_unit_rad)
    jump[1:] = (rules.step_rad - steps) / rules.step_unit_rad
    outside = np.minimum(solutions.reaches_mm, -ROUNDED_MM)
    reach = np.where(solutions.valid, np.maximum(solutions.reaches_mm, 0.0), outside)
    return Room(
        qs_rad=qs,
        reach=reach / rules.reach_unit_mm,
        singularity=singular_room(solutions, rules),
        limit=model.limits.clearance_rad(qs).min(axis=2) / rules.limit_unit_rad,
        jump=jump,
    )


def singular_room(solutions: IkSolutions, rules: RoomRules) -> Floats:
    """Return the room (n, 8) to the nearest of elbow, wrist and shoulder singularity."""
    sine = np.minimum(solutions.sin_wrist, solutions.sin_elbows)
    angular = (sine - np.sin(rules.singular_rad)) / rules.singular_unit
    away = (solutions.wrist_distance_mm - rules.shoulder_mm) / rules.shoulder_unit_mm
    return np.minimum(angular, away[:, None])


def continuous(qs_rad: Floats, limits: JointLimits) -> Floats:
    """Return branches (n, 8, 6) with spinning joints unwrapped and shifted by full turns to fit."""
    qs = qs_rad.copy()
    if not len(qs):
        return qs
    spinning = list(limits.spinning())
    qs[:, :, spinning] = unwrap(qs[:, :, spinning])
    for joint in np.flatnonzero(limits.multi_turn()):
        lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
        qs[:, :, joint] = shift_to_fit(qs[:, :, joint], lower, upper)
    return qs
