"""The optical tracking system: settings, tools, frames, and a hand that puts tools somewhere."""

import asyncio
from collections.abc import AsyncIterator
from dataclasses import MISSING, dataclass
from typing import Annotated, Any, ClassVar
from weakref import WeakSet

from fastapi import APIRouter, Body, Path
from starlette.concurrency import run_in_threadpool

from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.setup.messages import SetToolVisible, SetTracker
from rona_core.devices.limits import PLACE_MM, number, quaternion, require_limits, require_unit
from rona_core.devices.live import LiveTracker, live_tracker_of
from rona_core.devices.samples import TrackerFrame
from rona_core.devices.settings import STRICT, TOOLS, TrackerSettings
from rona_core.errors import DeviceError, NotFoundError, RonaError
from rona_core.geometry.pose import Pose
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import EXACT, Bench, Open, idle_rig
from rona_ui.api.json_response import plain
from rona_ui.api.routes.commands import Changed, changed
from rona_ui.api.streams import DESCRIBED, EventStream, Streams, event

router = APIRouter(route_class=BodyRoute, prefix="/sessions/{session_id}/tracker", tags=["tracker"])
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


@router.get("/settings")
def get_tracker_settings(bench: Bench) -> TrackerSettings:
    """Return noise profile, frame rate and the tools that are covered up."""
    return bench.session.setup.devices.tracker


@router.put("/settings")
def put_tracker_settings(bench: Bench, settings: Annotated[SetTracker, EXACT, Body()]) -> Changed:
    """Set noise profile and frame rate; the command `SetTracker`."""
    return changed(bench, settings)


@router.put("/tools/{name}/visible")
def put_tool_visible(bench: Bench, name: Tool, wanted: Annotated[Visible, EXACT]) -> Changed:
    """Cover a tool up or uncover it; the command `SetToolVisible`."""
    _require_tool(name)
    return changed(bench, SetToolVisible(name, wanted.visible))


@router.put("/tools/{name}/pose")
def put_tool_pose(bench: Bench, name: Tool, pose: Annotated[ToolPose, EXACT]) -> dict[str, Any]:
    """Put a pointer somewhere before the tracker, as a hand would; returns what is seen of it.

    Live only: it changes no session, and recorded motions do not start there. The tool on the
    robot follows the robot and answers 409.
    """
    _require_tool(name)
    tracker = _live(bench)
    tracker.place(name, Pose.from_wxyz(pose.wxyz, pose.translation_mm))
    return _seen(bench, tracker)


@router.delete("/tools/{name}/pose")
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


@router.get("/frame")
def get_frame(bench: Bench) -> dict[str, Any]:
    """Return the newest frame: number, time and each tool's pose, null while it is not seen."""
    return plain(newest_frame(bench))


@router.post("/start")
def start_tracking(bench: Bench) -> Tracking:
    """Deliver live frames; captures track in any case."""
    _stopped.discard(bench)
    return Tracking(True)


@router.post("/stop")
def stop_tracking(bench: Bench) -> Tracking:
    """Deliver no more live frames; open streams end, a capture under way goes on."""
    _stopped.add(bench)
    return Tracking(False)


@router.get("/stream", response_class=EventStream, responses=DESCRIBED)
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
