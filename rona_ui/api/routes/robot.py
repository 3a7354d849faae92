"""The robot: state, certified moves, settings, and Stop, which wins over everything."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from fastapi import APIRouter, Body, Query, Response
from starlette.concurrency import run_in_threadpool

from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.scan.view import contact_report, head_report
from rona_core.app.steps.setup.messages import SetContact, SetRobot
from rona_core.app.steps.setup.robot_parameters import RobotFigure, robot_figures
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.devices.settings import RobotSettings
from rona_core.errors import RonaError
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import EXACT, Bench, Open
from rona_ui.api.json_response import FastJson, described, plain
from rona_ui.api.routes.commands import Changed, changed
from rona_ui.api.routes.jobs import JobInfo, start
from rona_ui.api.streams import ALIVE, DESCRIBED, PERIOD_S, EventStream, Streams, event

router = APIRouter(route_class=BodyRoute, prefix="/sessions/{session_id}/robot", tags=["robot"])
STREAM_HZ = 30.0
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


@router.get("/state")
def get_state(bench: Bench) -> RobotState:
    """Return the joint angles in degrees, and whether the robot moves."""
    return robot_state(bench)


@router.post("/move", status_code=202)
def move(
    bench: Bench, target: Annotated[StartRobotMove, EXACT, Body()], response: Response
) -> JobInfo:
    """Move to joint angles in degrees; the job fails unless the verifier certifies the motion."""
    return start(bench, target, response)


@router.get("/settings")
def get_robot_settings(bench: Bench) -> RobotSettings:
    """Return model, errors, scan speed and place of the base."""
    return bench.session.setup.devices.robot


@router.put("/settings")
def put_robot_settings(bench: Bench, settings: Annotated[SetRobot, EXACT, Body()]) -> Changed:
    """Set model, errors, scan speed and place of the base; the command `SetRobot`."""
    return changed(bench, settings)


@router.get("/figures")
def list_robot_figures(bench: Bench) -> list[RobotFigure]:
    """Return every figure of the robot that is chosen: value, unit, trust and where it is from.

    Trust `assumed` means that no source states the figure.
    """
    return list(robot_figures(bench.session.setup.devices.robot.model))


@router.put("/contact")
def put_contact(bench: Bench, contact: Annotated[SetContact, EXACT, Body()]) -> Changed:
    """Set how the probe is pressed on; the command `SetContact`."""
    return changed(bench, contact)


@router.get("/contact", response_class=FastJson, responses=described("object", "null"))
def get_contact(bench: Bench) -> FastJson:
    """Return what the last scan says of force and clocks; `null` before there is one.

    Forces in N along the tool axis; `delay` is null where the scan does not tell it. The force at
    each step of the loop is in the results of step `scan`.
    """
    return FastJson(plain(contact_report(bench.session)))


@router.get("/head", response_class=FastJson, responses=described("object", "null"))
def get_head(bench: Bench) -> FastJson:
    """Return how the head lay in each capture against step 4; `null` before a scan that watched it.

    Shifts in mm along the axes of `base` with their standard deviations, at the middle of the scan;
    null where `state` is `unchecked`, and `reason` says why. What has `moved` is corrected.
    """
    return FastJson(plain(head_report(bench.session)))


@router.post("/stop")
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


@router.get("/stream", response_class=EventStream, responses=DESCRIBED)
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
