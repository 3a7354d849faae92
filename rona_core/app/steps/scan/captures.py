"""Step 8: drive the certified scan, pressed on or by position alone, and record what comes."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.staleness import capture_setup_digest, session_obstacles
from rona_core.app.runtime.handling import HEAD_HZ, begin, finish
from rona_core.app.steps.scan.force_controlled_scan import MOST_CLOCK_SCANS, ContactLoop
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.app.steps.tool.robot_motion import STOPPED, FreeMoves, drive_to, require_certified
from rona_core.devices.live import RecordedSoFar
from rona_core.devices.samples import (
    AScan,
    AScanTrack,
    JointSample,
    JointTrack,
    ToolTrack,
    TrackerFrame,
)
from rona_core.devices.settings import ContactSettings
from rona_core.devices.wrench import ForceTrack, ToolLoad
from rona_core.errors import CancelledError, DegenerateGeometryError, NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.force_control.correction_corridor import correction_corridor, straight_line
from rona_core.robot.force_control.gravity_compensation import fit_tool_load
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session

# Turns of joints 4 to 6 in degrees, about two axes, so that weight and offset can be separated.
TURNS_DEG = ((0, 0, 0), (0, 25, 0), (0, -25, 0), (0, 0, 35), (0, 0, -35), (20, 15, 20))
SETTLE_S = 0.1
READINGS = 12
PERIOD_S = 0.016
STOPPED_WEIGHING = (
    "the robot was stopped while the tool was weighed, before the probe came near the bone: no "
    "A-scan was recorded, and an earlier scan is kept"
)


def identify_payload(
    q_rest_rad: Floats, model: RobotModel, around: Obstacles, context: ActivityContext
) -> ToolLoad:
    """Return the load on the force sensor; the robot ends where it stood, at ``q_rest_rad`` (6,).

    A pose that the joints or something in the way do not allow is turned the other way, or left
    out. Every move is planned and certified among what stands around.

    Raises:
        DegenerateGeometryError: the poses that are left do not tell weight and offset apart; it
            says what stood in the way of the others.
        NotReachableError: the robot stands where it touches something, or cannot return.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    moves = FreeMoves(model, around)
    rotations: list[Floats] = []
    wrenches: list[Floats] = []
    left_out: list[str] = []
    here = q_rest_rad
    for turn in TURNS_DEG:
        for sign in (1.0, -1.0):
            goal = q_rest_rad + np.concatenate((np.zeros(3), sign * np.deg2rad(turn)))
            try:
                _go(here, goal, moves, context)
            except NotReachableError as error:
                left_out.append(str(error))
                continue
            here = goal
            wrenches.append(_mean_wrench(context))
            rotations.append(model.forward(goal[None])[0].rotation)
            break
    _go(here, q_rest_rad, moves, context)
    try:
        return fit_tool_load(
            np.array(rotations).reshape(-1, 3, 3), np.array(wrenches).reshape(-1, 6)
        )
    except DegenerateGeometryError as error:
        if not left_out:
            raise
        ways = "; ".join(dict.fromkeys(left_out))
        raise DegenerateGeometryError(
            f"{error}. The robot could not turn it every way: {ways}"
        ) from error


def _go(here: Floats, goal: Floats, moves: FreeMoves, context: ActivityContext) -> None:
    """Move on motions that are certified among what stands around.

    Raises:
        NotReachableError: there is none; it says why.
        CancelledError: Cancel or Stop was pressed on the way.
    """
    if np.array_equal(here, goal):
        return
    rig = context.rig
    for planned in moves.plan(here, goal):
        if context.cancel():
            raise CancelledError(STOPPED_WEIGHING)
        motion = rig.robot.move(planned.times_s, planned.qs_rad)
        arrival_s = rig.clock.now() + planned.duration_s
        while not motion.done():
            if context.cancel():
                rig.robot.stop()
                raise CancelledError(STOPPED_WEIGHING)
            rig.clock.wait_until(min(rig.clock.now() + 0.1, arrival_s))
            context.live.put(joints=rig.robot.state())


def _mean_wrench(context: ActivityContext) -> Floats:
    clock = context.rig.clock
    start_s = clock.now() + SETTLE_S
    readings: list[Floats] = []
    for i in range(READINGS):
        clock.wait_until(start_s + i * PERIOD_S)
        readings.append(context.rig.force.read().wrench)
    return np.array(readings).mean(axis=0)


TICK_S = 0.016  # between joint samples of a scan by position alone
CLOCK_MM = 2.5  # within this of the ends of the path, A-scans are fired to compare the clocks
SHOWN_EVERY = 32  # A-scans of a scan by position alone between two updates of the growing map
AFTER_S = 0.1  # joint angles are recorded so long after the last A-scan: they arrive late


@dataclass(slots=True)
class Recorded:
    """What has come so far."""

    scans: list[AScan] = field(default_factory=list)
    clock_scans: list[AScan] = field(default_factory=list)
    joints: list[JointSample] = field(default_factory=list)
    forces: ForceTrack | None = None
    partial: bool = False
    frames: list[TrackerFrame] = field(default_factory=list)


def capture_scan(
    session: Session, context: ActivityContext, kind: Literal["scan", "second"] = "scan"
) -> ScanCapture:
    """Execute the certified plan and record an A-scan every ``pitch_mm`` along the path.

    The clocks are compared in the first pass alone: all poses are looked up by its delay.

    Raises:
        NotReachableError: there is no plan, the verifier did not certify it, or there is no room
            for the force loop.
        CancelledError: Cancel or Stop was pressed before the probe came near the bone.
    """
    first, second = session.results.roll, session.results.second
    plan = None if first is None else first.value
    if kind == "second":
        planned = None if second is None else second.value.next_pass(usable_second(session))
        plan = None if planned is None else planned.plan
    if plan is None or plan.trajectory is None or plan.certificate is None:
        raise NotReachableError("there is no path that the robot can traverse: see step 7")
    devices, trajectory = session.setup.devices, plan.trajectory
    model, around = robot_model(devices.robot.model), session_obstacles(session)
    require_certified("the scan", plan.certificate, trajectory, model, around)
    contact = devices.robot.contact
    places_s = fire_times(trajectory, devices.probe.pitch_mm)
    try:
        if contact is None:
            drive_to(trajectory.qs_rad[0], session, context)
            ordinal = begin(session, context)
            clock_s = _clock_times(trajectory, model) if kind == "scan" else np.zeros(0)
            recorded = _by_position(trajectory, places_s, clock_s, context)
        else:
            most_clock_scans = MOST_CLOCK_SCANS if kind == "scan" else 0
            ordinal, recorded = _in_contact(
                trajectory, places_s, contact, model, most_clock_scans, session, context
            )
    finally:
        context.live.put(recorded=None)
    if recorded.partial and not recorded.scans:
        raise CancelledError(STOPPED)
    return ScanCapture(
        ordinal=ordinal,
        setup_digest=capture_setup_digest(kind, session),
        scans=AScanTrack.from_scans(recorded.scans),
        joints=JointTrack.from_samples(recorded.joints),
        partial=recorded.partial,
        forces=recorded.forces,
        clock_scans=AScanTrack.from_scans(recorded.clock_scans) if recorded.clock_scans else None,
        base=ToolTrack.from_frames("basemarker", recorded.frames),
        head=ToolTrack.from_frames("headmarker", recorded.frames),
    )


def fire_times(trajectory: Trajectory, pitch_mm: float) -> Floats:
    """Return when the probe is to fire (n,): at the start of the path and every ``pitch_mm``."""
    inside = (trajectory.times_s >= trajectory.scan_start_s) & (
        trajectory.times_s <= trajectory.scan_end_s
    )
    way_mm, times_s = trajectory.path_mm[inside], trajectory.times_s[inside]
    moving = np.concatenate(([True], np.diff(way_mm) > 0))  # a place is passed once
    places_mm = np.arange(0.0, way_mm[-1], pitch_mm)
    return np.interp(places_mm, way_mm[moving], times_s[moving])


def _in_contact(
    trajectory: Trajectory,
    places_s: Floats,
    contact: ContactSettings,
    model: RobotModel,
    most_clock_scans: int,
    session: Session,
    context: ActivityContext,
) -> tuple[int, Recorded]:
    """Weigh the tool, press it on, and follow the path with the force loop."""
    around = session_obstacles(session)
    band = correction_corridor(model, trajectory, contact, CollisionWorld(model, around))
    drive_to(trajectory.qs_rad[0], session, context)
    ordinal = begin(session, context)
    load = identify_payload(trajectory.qs_rad[0], model, around, context)
    loop = ContactLoop(trajectory, band, places_s, contact, load, model, context)
    loop.most_clock_scans = most_clock_scans
    loop.run()
    return ordinal, Recorded(
        scans=loop.scans,
        clock_scans=loop.clock_scans,
        joints=loop.joints,
        forces=loop.track(),
        partial=loop.partial,
        frames=_head_frames(loop.near_s, context),
    )


def _by_position(
    trajectory: Trajectory, places_s: Floats, clock_s: Floats, context: ActivityContext
) -> Recorded:
    """Drive the motion as it is; the compliance of the probe bridges what the map is off."""
    rig, clock = context.rig, context.rig.clock
    motion = rig.robot.move(trajectory.times_s, trajectory.qs_rad)
    recorded = Recorded(joints=[rig.robot.state()])
    last_s = min(
        max(clock_s.max(initial=0.0), places_s[-1]) + AFTER_S, float(trajectory.times_s[-1])
    )
    ticks = np.arange(min(clock_s.min(initial=np.inf), places_s[0]), last_s, TICK_S)
    times = np.concatenate((places_s, clock_s, ticks))
    kinds = np.repeat((0, 1, 2), (len(places_s), len(clock_s), len(ticks)))
    order = np.lexsort((kinds, times))
    for time_s, kind in zip(times[order], kinds[order], strict=True):
        if context.cancel() or motion.done():
            recorded.partial = len(recorded.scans) < len(places_s)
            break
        clock.wait_until(float(time_s))
        if kind == 0:
            recorded.scans.append(rig.probe.acquire())
            n = len(recorded.scans)
            context.live.put(ascan=recorded.scans[-1], n_scans=n)
            if n % SHOWN_EVERY == 0 or n == len(places_s):
                so_far = RecordedSoFar(tuple(recorded.scans), tuple(recorded.joints))
                context.live.put(recorded=so_far)
            context.progress(len(recorded.scans) / len(places_s))
        elif kind == 1:
            recorded.clock_scans.append(rig.probe.acquire())
        if clock.now() > recorded.joints[-1].time_s:
            recorded.joints.append(rig.robot.state())
            context.live.put(joints=recorded.joints[-1])
    if not finish(motion, context):
        recorded.partial = True
    recorded.frames = _head_frames(float(times.min()), context)
    return recorded


def _head_frames(since_s: float | None, context: ActivityContext) -> list[TrackerFrame]:
    """Return what the tracker saw since the probe came near the bone; nothing if it never did."""
    return [] if since_s is None else context.rig.tracker.past(since_s, HEAD_HZ)


def _clock_times(trajectory: Trajectory, model: RobotModel) -> Floats:
    """Return times (n,) at which the face comes near the bone and leaves it, straight up and down.

    There the echoes see the robot move, which shows how late its joint angles arrive.
    """
    probes = model.forward(trajectory.qs_rad) @ model.T_flange_probe
    line = straight_line(trajectory, probes)
    times = trajectory.times_s
    before = line & (times < trajectory.scan_start_s)
    after = line & (times > trajectory.scan_end_s)
    found: list[Floats] = []
    for side, end_s in ((before, trajectory.scan_start_s), (after, trajectory.scan_end_s)):
        end = int(np.argmin(np.abs(times - end_s)))
        away = np.linalg.norm(probes.translations - probes.translations[end], axis=1)
        near = times[side & (away < CLOCK_MM)]
        if len(near):
            found.append(np.arange(near[0], near[-1], TICK_S))
    return np.concatenate([np.zeros(0), *found])
