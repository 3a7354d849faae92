"""The robot: kinematics, the search over the free roll, verification and timing."""

from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.motion_files.formats import read_motion
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.robot.verification.foreign_motion import verify_foreign
from rona_core.robot.verification.tolerances import Tolerances
from rona_core.robot.verification.verifier import verify_motion, verify_scan

__all__ = [
    "NOTHING_AROUND",
    "Obstacles",
    "RobotPlan",
    "Tolerances",
    "plan_scan",
    "read_motion",
    "robot_model",
    "verify_foreign",
    "verify_motion",
    "verify_scan",
]
