"""Routes of the devices: tracker, robot, probe, and the hand that holds the pointer."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, ClassVar
from weakref import WeakSet

import numpy as np
from fastapi import APIRouter, Body, Path, Query, Response
from starlette.concurrency import run_in_threadpool

from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.scan.view import contact_report, head_report
from rona_core.app.steps.setup.messages import (
    SetContact,
    SetProbe,
    SetRobot,
    SetToolVisible,
    SetTracker,
)
from rona_core.app.steps.setup.step import RobotFigure, robot_figures
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.devices.limits import PLACE_MM, number, quaternion, require_limits, require_unit
from rona_core.devices.live import LiveTracker, live_tracker_of
from rona_core.devices.samples import AScan, TrackerFrame
from rona_core.devices.settings import STRICT, TOOLS, ProbeSettings, RobotSettings, TrackerSettings
from rona_core.errors import CancelledError, DeviceError, NotFoundError, RonaError
from rona_core.geometry.pose import Pose
from rona_ui.api.answers import FastJson, described, plain
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import EXACT, Bench, Open, idle_rig
from rona_ui.api.routes.jobs import Changed, JobInfo, changed, start
from rona_ui.api.streams import ALIVE, DESCRIBED, PERIOD_S, EventStream, Streams, event

tracker_router = APIRouter(
    route_class=BodyRoute, prefix="/sessions/{session_id}/tracker", tags=["tracker"]
)
Tool = Annotated[str, Path(description=f"one of {', '.join(TOOLS)}")]
STREAM_HZ = 30.0
_stopped: WeakSet[Workbench] = WeakSet()  # sessions whose live tracking is switched off


@dataclass(frozen=True, slots=True)
class Visible:
    """Whether a tool can be seen."""

    __pydantic_config__: ClassVar = STRICT
    visible: bool


@dataclass(frozen=True, slots=True)
class ToolPose:
    """Pose of a tool's marker in the frame of the tracker."""

    __pydantic_config__: ClassVar = STRICT
    wxyz: tuple[float, float, float, float] = quaternion(MISSING, "Rotation")
    translation_mm: tuple[float, float, float] = number(
        MISSING, "Position", "mm", *PLACE_MM, 1.0, hint="Of the marker"
    )

    def __post_init__(self) -> None:
        require_limits(self)
        require_unit("wxyz", self.wxyz)


@dataclass(frozen=True, slots=True)
class Tracking:
    """Whether live frames are delivered."""

    tracking: bool


def _require_tool(name: str) -> None:
    if name not in TOOLS:
        raise NotFoundError(f"there is no tool {name!r}: tools are {', '.join(TOOLS)}")


def _live(bench: Workbench) -> LiveTracker:
    tracker = live_tracker_of(idle_rig(bench))
    if tracker is None:
        raise DeviceError("this tracker has no virtual hand: hold the tool before the camera")
    return tracker


def newest_frame(bench: Workbench) -> TrackerFrame:
    """Return the frame that a capture under way saw last, else what is before the tracker now.

    Raises:
        DeviceError: live tracking is switched off, or no frame has come yet.
    """
    if bench in _stopped:
        raise DeviceError("live tracking is switched off: POST tracker/start first")
    if bench.jobs.devices_busy:
        frame = bench.live.get().frame
        if frame is None:
            raise DeviceError("the tracker has not delivered a frame yet: ask again")
        return frame
    rig = bench.rig()
    live = live_tracker_of(rig)
    if live is None:
        return rig.tracker.latest()
    return live.frame(bench.session.setup.devices.tracker)


@tracker_router.get("/settings")
def get_tracker_settings(bench: Bench) -> TrackerSettings:
    """Return noise profile, frame rate and the tools that are covered up."""
    return bench.session.setup.devices.tracker


@tracker_router.put("/settings")
def put_tracker_settings(bench: Bench, settings: Annotated[SetTracker, EXACT, Body()]) -> Changed:
    """Set noise profile and frame rate; the command `SetTracker`."""
    return changed(bench, settings)


@tracker_router.put("/tools/{name}/visible")
def put_tool_visible(bench: Bench, name: Tool, wanted: Annotated[Visible, EXACT]) -> Changed:
    """Cover a tool up or uncover it; the command `SetToolVisible`."""
    _require_tool(name)
    return changed(bench, SetToolVisible(name, wanted.visible))


@tracker_router.put("/tools/{name}/pose")
def put_tool_pose(bench: Bench, name: Tool, pose: Annotated[ToolPose, EXACT]) -> dict[str, Any]:
    """Put a pointer somewhere before the tracker, as a hand would; returns what is seen of it.

    Live only: it changes no session, and recorded motions do not start there. The tool on the
    robot follows the robot and answers 409.
    """
    _require_tool(name)
    tracker = _live(bench)
    tracker.place(name, Pose.from_wxyz(pose.wxyz, pose.translation_mm))
    return _seen(bench, tracker)


@tracker_router.delete("/tools/{name}/pose")
def delete_tool_pose(bench: Bench, name: Tool) -> dict[str, Any]:
    """Lay a pointer aside."""
    _require_tool(name)
    tracker = _live(bench)
    tracker.place(name, None)
    return _seen(bench, tracker)


def _seen(bench: Workbench, tracker: LiveTracker) -> dict[str, Any]:
    frame = tracker.frame(bench.session.setup.devices.tracker)
    if bench not in _stopped:
        bench.live.put(frame=frame)
    return plain(frame)


@tracker_router.get("/frame")
def get_frame(bench: Bench) -> dict[str, Any]:
    """Return the newest frame: number, time and each tool's pose, null while it is not seen."""
    return plain(newest_frame(bench))


@tracker_router.post("/start")
def start_tracking(bench: Bench) -> Tracking:
    """Deliver live frames; captures track in any case."""
    _stopped.discard(bench)
    return Tracking(True)


@tracker_router.post("/stop")
def stop_tracking(bench: Bench) -> Tracking:
    """Deliver no more live frames; open streams end, a capture under way goes on."""
    _stopped.add(bench)
    return Tracking(False)


@tracker_router.get("/stream", response_class=EventStream, responses=DESCRIBED)
async def stream_frames(bench: Bench, streams: Open) -> EventStream:
    """Follow the frames by server-sent events, up to 30 a second."""
    return EventStream(_frames(bench, streams))


async def _frames(bench: Workbench, streams: Streams) -> AsyncIterator[bytes]:
    with streams.waker() as waker:
        seen: tuple[int, float] | None = None
        while not streams.closing and not bench.closed:
            try:
                frame = await run_in_threadpool(newest_frame, bench)
            except DeviceError as error:
                if bench in _stopped:
                    yield event({"code": error.code, "detail": str(error)}, kind="stopped")
                    return
                await asyncio.sleep(1.0 / STREAM_HZ)
                continue
            except RonaError as error:
                yield event({"code": error.code, "detail": str(error)}, kind="problem")
                return
            if (frame.number, frame.time_s) != seen:
                seen = (frame.number, frame.time_s)
                yield event(plain(frame), kind="frame", number=frame.number)
            await waker.wait(1.0 / STREAM_HZ)


robot_router = APIRouter(
    route_class=BodyRoute, prefix="/sessions/{session_id}/robot", tags=["robot"]
)
# Stop has threads of its own, so that it never waits behind other requests.
_STOP = ThreadPoolExecutor(4, thread_name_prefix="rona-stop")


@dataclass(frozen=True, slots=True)
class RobotState:
    """Joint angles as the encoders report them."""

    joints_deg: list[float]
    moving: bool
    time_s: float  # on the clock of the capture


@dataclass(frozen=True, slots=True)
class Stopped:
    """The robot stands still; ``stopped`` is false where it did so anyway."""

    stopped: bool


def robot_state(bench: Workbench) -> RobotState:
    """Return the joint angles now."""
    sample = bench.rig().robot.state()
    return RobotState(np.rad2deg(sample.q_rad).tolist(), sample.moving, sample.time_s)


@robot_router.get("/state")
def get_state(bench: Bench) -> RobotState:
    """Return the joint angles in degrees, and whether the robot moves."""
    return robot_state(bench)


@robot_router.post("/move", status_code=202)
def move(
    bench: Bench, target: Annotated[StartRobotMove, EXACT, Body()], response: Response
) -> JobInfo:
    """Move to joint angles in degrees; the job fails unless the verifier certifies the motion."""
    return start(bench, target, response)


@robot_router.get("/settings")
def get_robot_settings(bench: Bench) -> RobotSettings:
    """Return model, errors, scan speed and place of the base."""
    return bench.session.setup.devices.robot


@robot_router.put("/settings")
def put_robot_settings(bench: Bench, settings: Annotated[SetRobot, EXACT, Body()]) -> Changed:
    """Set model, errors, scan speed and place of the base; the command `SetRobot`."""
    return changed(bench, settings)


@robot_router.get("/figures")
def list_robot_figures(bench: Bench) -> list[RobotFigure]:
    """Return every figure of the robot that is chosen: value, unit, trust and where it is from.

    Trust `assumed` means that no source states the figure.
    """
    return list(robot_figures(bench.session.setup.devices.robot.model))


@robot_router.put("/contact")
def put_contact(bench: Bench, contact: Annotated[SetContact, EXACT, Body()]) -> Changed:
    """Set how the probe is pressed on; the command `SetContact`."""
    return changed(bench, contact)


@robot_router.get("/contact", response_class=FastJson, responses=described("object", "null"))
def get_contact(bench: Bench) -> FastJson:
    """Return what the last scan says of force and clocks; `null` before there is one.

    Forces in N along the tool axis; `delay` is null where the scan does not tell it. The force at
    each step of the loop is in the results of step `scan`.
    """
    return FastJson(plain(contact_report(bench.session)))


@robot_router.get("/head", response_class=FastJson, responses=described("object", "null"))
def get_head(bench: Bench) -> FastJson:
    """Return how the head lay in each capture against step 4; `null` before a scan that watched it.

    Shifts in mm along the axes of `base` with their standard deviations, at the middle of the scan;
    null where `state` is `unchecked`, and `reason` says why. What has `moved` is corrected.
    """
    return FastJson(plain(head_report(bench.session)))


@robot_router.post("/stop")
async def stop(
    bench: Bench,
    if_moving: Annotated[
        bool, Query(description="only if the robot moves; else nothing ends, `stopped` is false")
    ] = False,
) -> Stopped:
    """Stop the robot at once and end what uses the devices; always allowed, any number of times."""
    loop = asyncio.get_running_loop()
    if if_moving:
        return Stopped(await loop.run_in_executor(_STOP, bench.stop_if_moving))
    await loop.run_in_executor(_STOP, bench.stop)
    return Stopped(True)


@robot_router.get("/stream", response_class=EventStream, responses=DESCRIBED)
async def stream_state(bench: Bench, streams: Open) -> EventStream:
    """Follow the joint angles by server-sent events while they change, up to 30 a second."""
    return EventStream(_states(bench, streams))


async def _states(bench: Workbench, streams: Streams) -> AsyncIterator[bytes]:
    with streams.waker() as waker:
        seen, silent_s = None, 0.0
        while not streams.closing and not bench.closed:
            try:
                state = await run_in_threadpool(robot_state, bench)
            except RonaError as error:
                yield event({"code": error.code, "detail": str(error)}, kind="problem")
                return
            silent_s += 1.0 / STREAM_HZ
            if (state.joints_deg, state.moving) != seen:
                seen, silent_s = (state.joints_deg, state.moving), 0.0
                yield event(plain(state), kind="state")
            elif silent_s > PERIOD_S:
                silent_s = 0.0
                yield ALIVE
            await waker.wait(1.0 / STREAM_HZ)


probe_router = APIRouter(
    route_class=BodyRoute, prefix="/sessions/{session_id}/probe", tags=["probe"]
)
TIMEOUT_S = 20.0


@dataclass(frozen=True, slots=True)
class ProbeAcquire:
    """Fire the probe once; reserves the devices like any job."""


@probe_router.get("/settings")
def get_probe_settings(bench: Bench) -> ProbeSettings:
    """Return probe, excitation, signal-to-noise ratio and scan pitch."""
    return bench.session.setup.devices.probe


@probe_router.put("/settings")
def put_probe_settings(bench: Bench, settings: Annotated[SetProbe, EXACT, Body()]) -> Changed:
    """Set probe, excitation, signal-to-noise ratio and scan pitch; the command `SetProbe`."""
    return changed(bench, settings)


@probe_router.post("/acquire", response_class=FastJson, responses=described("object"))
def acquire(bench: Bench) -> FastJson:
    """Fire once where the robot holds the probe now and return the trace; changes no session."""
    rig = idle_rig(bench)
    taken: list[AScan] = []

    def work(progress: Any, cancel: Any) -> int:
        session = bench.session
        rig.begin(session.setup.devices, len(session.archive) + 1)
        taken.append(rig.probe.acquire())
        bench.live.put(ascan=taken[-1])
        return bench.store.revision

    status = bench.jobs.start(ProbeAcquire(), work, device=True)
    status = bench.jobs.wait(status.id, TIMEOUT_S)
    if not taken:
        if status.state == "cancelled":
            raise CancelledError("the probe was stopped before it fired")
        raise DeviceError(status.error or "the probe did not answer in time")
    return FastJson(plain(taken[0]))


operator_router = APIRouter(
    route_class=BodyRoute, prefix="/sessions/{session_id}/operator", tags=["operator"]
)


@dataclass(frozen=True, slots=True)
class PointerTurn:
    """Rotation of the pointer about its tip, relative to the start, along the axes of the base."""

    __pydantic_config__: ClassVar = STRICT
    wxyz: tuple[float, float, float, float] = quaternion(MISSING, "Rotation")

    def __post_init__(self) -> None:
        require_limits(self)
        require_unit("wxyz", self.wxyz)


@dataclass(frozen=True, slots=True)
class InHand:
    """Whether the pointer is pivoted by hand now."""

    in_hand: bool


@operator_router.get("/pointer")
def get_pointer(bench: Bench) -> InHand:
    """Return whether a capture by hand waits for turns of the pointer."""
    return InHand(bench.pointer_in_hand())


@operator_router.put("/pointer")
def put_pointer(bench: Bench, turn: Annotated[PointerTurn, EXACT, Body()]) -> PointerTurn:
    """Turn the pointer while the job `StartPointerCapture` with `by_hand` runs; live, else 409.

    The hand follows smoothly at a bounded speed; the last rotation counts.
    """
    bench.turn_pointer(turn.wxyz)
    return turn


@operator_router.post("/pointer/finish")
def finish_pointer(bench: Bench) -> InHand:
    """End the pivoting by hand before its time; the calibration follows."""
    bench.finish_pointer()
    return InHand(False)
