"""Verdict on a motion that was planned elsewhere: for the command line, REST and scripts."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.implant.milling import robot_path_of
from rona_core.app.steps.implant.view import milling_model, milling_view
from rona_core.app.steps.roll.certificate_view import NO_CLEARANCE
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.limits import require_within
from rona_core.devices.robots import ROBOTS
from rona_core.errors import InvalidInputError
from rona_core.planning.robot_milling import milling_obstacles
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.catalog import described_robot, milling_robot, robot_model
from rona_core.robot.kinematics.robot_model import RobotModel, Spindle
from rona_core.robot.motion_files.formats import read_motion
from rona_core.robot.trajectory.trajectory import motion_digest
from rona_core.robot.verification.foreign_motion import Finding, ForeignVerdict, verify_foreign
from rona_core.robot.verification.joint_motion import (
    MOST_PLACES,
    Interpolation,
    JointMotion,
    require_places,
)
from rona_core.robot.verification.tolerances import Tolerances
from rona_core.session.document import Session

HeldTool = Literal["probe", "burr"]
DESCRIPTION = ".urdf"


@dataclass(frozen=True, slots=True)
class VerifySettings:
    """How a motion is read and what is insisted on."""

    interpolation: Interpolation | None = None  # None: as ROS joins what the samples state
    tool: HeldTool = "probe"
    tool_speed_mm_per_s: float = 250.0  # what robots near people are held to
    demand_singular: bool = False  # whether it must stay away from singular postures
    topic: str | None = None  # of a bag with several
    most_places: int = MOST_PLACES  # that are looked at

    def __post_init__(self) -> None:
        require_within("tool_speed_mm_per_s", self.tool_speed_mm_per_s, 1.0, 10_000.0)


@dataclass(frozen=True, slots=True, eq=False)
class MotionReport:
    """What was read, and what the verifier says of it."""

    file: str
    model: RobotModel
    motion: JointMotion
    verdict: ForeignVerdict
    around: str  # what stood around, in words
    remarks: tuple[str, ...]  # what was assumed, and what was not checked

    @property
    def certified(self) -> bool:
        """Whether everything held."""
        return self.verdict.certificate.certified

    def figures(self) -> dict[str, Any]:
        """Return the report as plain values."""
        certificate, motion = self.verdict.certificate, self.motion
        return {
            "file": self.file,
            "robot": self.model.name,
            "samples": len(motion.times_s),
            "duration_s": float(motion.times_s[-1]),
            "interpolation": self.verdict.interpolation,
            "obstacles": self.around,
            "certified": self.certified,
            "least_clearance_mm": certificate.min_clearance_mm,
            "digests": {
                "motion": motion_digest("", motion.times_s, motion.qs_rad),
                "certificate": certificate.digest,
                "robot": certificate.robot,
                "tolerances": certificate.tolerances,
                "obstacles": certificate.obstacles,
            },
            "checks": [_row(one) for one in self.verdict.findings],
            "not_demanded": [_row(one) for one in self.verdict.not_demanded],
            "hints": list(self.verdict.hints),
            "remarks": list(self.remarks),
        }


def _row(one: Finding) -> dict[str, Any]:
    check = one.check
    return {
        "name": check.name,
        "holds": check.holds,
        "value": check.value,
        "limit": check.limit,
        "unit": check.unit,
        "sample": one.sample,
        "time_s": one.time_s,
        "joint": one.joint,
        "q_deg": list(one.q_deg),
        "sentence": one.sentence,
    }


def report_motion(
    file: NamedFile,
    robot: str | Path,
    settings: VerifySettings | None = None,
    session: Session | None = None,
) -> MotionReport:
    """Read a motion, and have the verifier look at it.

    Args:
        file: In any format that ``motion_files.formats.read_motion`` knows.
        robot: Name of a robot of the catalogue, or the path of a description (URDF).
        settings: How it is read and what is insisted on.
        session: What stands around, and the burr as it was registered; None: nothing stands around,
            the robot is held against itself alone.

    Raises:
        InvalidInputError: the file or the robot cannot be read; it says where, and what to do.
        StepBlockedError: the session has no bed, but a burr is asked for.
    """
    asked = settings or VerifySettings()
    remarks: list[str] = []
    model = _robot(robot, asked.tool, remarks)
    around, words = NOTHING_AROUND, "nothing: the robot and its tool against themselves alone"
    if session is not None:
        model, around = _in_session(session, model, asked.tool)
        names = ", ".join(thing.name for thing in around.things) or "nothing"
        words = f"of the session {session.name}: {names}"
    motion = read_motion(file, model, asked.topic)
    require_places(motion, asked.interpolation or motion.stated(), asked.most_places)
    tolerances = replace(Tolerances(), tool_speed_mm_per_s=asked.tool_speed_mm_per_s)
    verdict = verify_foreign(
        model,
        motion,
        asked.interpolation,
        around,
        tolerances,
        demand_singular=asked.demand_singular,
    )
    if verdict.certificate.min_clearance_mm is None:
        remarks.append(NO_CLEARANCE)
    return MotionReport(file.name, model, motion, verdict, words, (*motion.remarks, *remarks))


def _robot(robot: str | Path, tool: HeldTool, remarks: list[str]) -> RobotModel:
    """Return the robot with its tool, and say what of it was assumed."""
    remarks.append(f"its tool is that of RONA with the {tool}")
    if str(robot) in ROBOTS:
        name = str(robot)
        remarks.append(f"joint limits are those that RONA plans with; others: a {DESCRIPTION}")
        return milling_robot(name) if tool == "burr" else robot_model(name)
    path = Path(robot)
    if not path.name.lower().endswith(DESCRIPTION) or not path.is_file():
        raise InvalidInputError(
            f"there is no robot {str(robot)!r}: expected {', '.join(ROBOTS)}, or a description "
            f"({DESCRIPTION})"
        )
    model = described_robot(path)
    most = ", ".join(f"{a:g}" for a in model.acceleration_rad_per_s2)
    remarks.append(f"{path.name} states no accelerations: at most {most} rad/s² are allowed")
    held = model.tool.with_spindle(Spindle()) if tool == "burr" else model.tool
    return model.with_tool(held)


def _in_session(
    session: Session, model: RobotModel, tool: HeldTool
) -> tuple[RobotModel, Obstacles]:
    """Return the robot with its burr as it was registered, and the obstacles around it."""
    around = session_obstacles(session)
    if tool == "probe":
        return model, around
    view = milling_view(session)
    if model.name == session.setup.devices.robot.model:
        model = milling_model(session, view)
    return model, milling_obstacles(around, robot_path_of(view).cutting)
