"""Tool: registration of tool, robot and tracker."""

import numpy as np

from rona_core.app.declarations.declarations import (
    Activity,
    ActivityContext,
    Capture,
    Command,
    Message,
    Result,
    Step,
    StepLine,
)
from rona_core.app.dependencies.base_reference import placed_reason
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.dependencies.staleness import capture_setup_digest, session_obstacles
from rona_core.app.dependencies.step_states import stopped_early
from rona_core.app.messages.outcomes import StoreCapture
from rona_core.app.runtime.handling import compute_result
from rona_core.app.runtime.recording import begin, record_frames
from rona_core.app.steps.setup.capture_parts import robot_errors_part, robot_part, tracker_part
from rona_core.app.steps.setup.inputs import MODEL
from rona_core.app.steps.tool.derivation import derive_registration
from rona_core.app.steps.tool.messages import RegisterTool, StartToolCapture
from rona_core.app.steps.tool.robot_motion import drive_to, require_certified
from rona_core.devices.samples import JointSample, JointTrack, ToolTrack, TrackerFrame
from rona_core.geometry.arrays import readonly
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.session.captures import ToolCapture
from rona_core.session.document import Session


def capture_tool(
    activity: StartToolCapture, session: Session, tools: ActivityContext
) -> ToolCapture:
    """Record the tool marker and the joints while the robot pivots and translates the tool."""
    model = robot_model(session.setup.devices.robot.model)
    around = session_obstacles(session).without_touch()
    plan = plan_tool_motion(
        model,
        ToolMotionSettings(
            cone_deg=activity.cone_deg,
            n_pivot=activity.n_pivot,
            n_translate=activity.n_translate,
        ),
        obstacles=around,
    )
    require_certified("the tool motion", plan.certificate, plan, around)
    drive_to(plan.qs_rad[0], session, tools)
    ordinal = begin(session, tools)
    motion = tools.rig.robot.move(plan.times_s, plan.qs_rad)
    joints: list[JointSample] = []

    def with_joints(frame: TrackerFrame) -> bool:
        joints.append(tools.rig.robot.state())
        tools.live.put(joints=joints[-1])
        tools.progress(motion.progress())
        return motion.done()

    frames, partial = record_frames(tools, with_joints)
    return ToolCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest("tool", session),
        marker=ToolTrack.from_frames("toolmarker", frames),
        joints=JointTrack.from_samples(joints),
        dwell_start_s=readonly(np.array(plan.dwell_start_s)),
        dwell_end_s=readonly(np.array(plan.dwell_end_s)),
        phases=readonly(np.array(plan.phases, dtype=np.int64)),
        partial=partial or motion.progress() < 1.0,
        base=ToolTrack.from_frames("basemarker", frames),
        tracker_place=session.setup.devices.tracker.place,
    )


def record_tool(
    activity: StartToolCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record the tool motion, then register the tool."""
    capture = capture_tool(activity, session, context)
    stored = StoreCapture("tool", capture)
    return (stored,) if capture.partial else (stored, RegisterTool())


TOOL_CAPTURE, TOOL = capture_input("tool"), result_input("tool")


def _summary(session: Session) -> str:
    held = session.results.tool
    if held is None:
        return ""
    return f"{held.value.n_poses} poses, random error {held.value.tip_sigma_mm:.2f} mm"


STEP = Step(
    "tool",
    commands=(Command(RegisterTool, compute_result, needs=(TOOL_CAPTURE,)),),
    activities=(
        Activity(
            StartToolCapture,
            record_tool,
            "Moving the tool",
            uses_devices=True,
            drives_robot=True,
            records=True,
        ),
    ),
    captures=(
        Capture(
            "tool",
            "record the tool motion (step 2)",
            (tracker_part, robot_part, robot_errors_part),
        ),
    ),
    results=(
        Result(
            "tool",
            RegisterTool,
            derive_registration,
            {"capture": TOOL_CAPTURE, "robot": MODEL},
            "register the tool (step 2)",
        ),
    ),
    line=StepLine(
        "Tool",
        _summary,
        StartToolCapture,
        leaves=lambda session: (TOOL_CAPTURE, TOOL),
        partial=lambda session: stopped_early("tool", session),
        stale=placed_reason,
    ),
)
