"""Tool: registration of tool, robot and tracker."""

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.base_reference import placed_reason
from rona_core.app.dependencies.inputs import capture_input, result_input
from rona_core.app.dependencies.staleness import capture_setup_digest, session_obstacles
from rona_core.app.runtime.handling import compute_result, record
from rona_core.app.runtime.recording import begin, record_frames
from rona_core.app.steps.setup import capture_parts as parts
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

TOOL_CAPTURE, TOOL = capture_input("tool"), result_input("tool")


def capture_tool(
    activity: StartToolCapture, session: Session, context: ActivityContext
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
    drive_to(plan.qs_rad[0], session, context)
    ordinal = begin(session, context)
    motion = context.rig.robot.move(plan.times_s, plan.qs_rad)
    joints: list[JointSample] = []

    def with_joints(frame: TrackerFrame) -> bool:
        joints.append(context.rig.robot.state())
        context.live.put(joints=joints[-1])
        context.progress(motion.progress())
        return motion.done()

    frames: list[TrackerFrame] = []
    partial = record_frames(context, with_joints, frames)
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


def _summary(session: Session) -> str:
    held = session.results.tool
    if held is None:
        return ""
    return f"{held.value.n_poses} poses, expected error {held.value.tip_sigma_mm:.2f} mm"


STEP = declare.Step(
    "tool",
    commands=(declare.Command(RegisterTool, compute_result, needs=(TOOL_CAPTURE,)),),
    activities=(
        declare.Activity(
            StartToolCapture,
            record("tool", capture_tool, RegisterTool),
            "Moving the tool",
            drives_robot=True,
            records=True,
        ),
    ),
    captures=(
        declare.Capture(
            "tool",
            "record the tool motion (step 2)",
            (parts.tracker, parts.robot, parts.robot_errors),
        ),
    ),
    results=(
        declare.Result(
            "tool",
            RegisterTool,
            derive_registration,
            {"capture": TOOL_CAPTURE, "robot": MODEL},
            "register the tool (step 2)",
        ),
    ),
    line=declare.StepLine(
        "Tool",
        _summary,
        StartToolCapture,
        leaves=lambda session: (TOOL_CAPTURE, TOOL),
        stale=placed_reason,
    ),
)
