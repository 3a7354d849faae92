"""What the graphs and the replay show of a session: the planned motion, while it is not stale.

Of further passes it is one motion after the other. Those that were scanned before the last one was
planned are replayed as the robot reported them: their plans have given way to the last.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.scan.captures import fire_times
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.devices.settings import DeviceSettings
from rona_core.geometry.arrays import Floats, readonly
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Session
from rona_core.session.memo import remember


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """A motion to be replayed, or several one after the other; times in s from its start."""

    times_s: Floats  # (m,)
    qs_rad: Floats  # (m, 6)
    fired_s: Floats  # (n,) when each A-scan was taken
    start_s: float  # of the scan, the first of several
    end_s: float  # and of the last


def plan_of(session: Session, *, second: bool = False) -> RobotPlan | None:
    """Return the plan of the scan, or of the next further pass or the last; None before one."""
    if second:
        again = session.results.second
        if again is None:
            return None
        return (again.value.next_pass(usable_second(session)) or again.value.passes[-1]).plan
    return None if session.results.roll is None else session.results.roll.value


@remember(4)  # sessions never change, and the replay asks many times a second
def motion_stale(session: Session, *, second: bool = False) -> str | None:
    """Return why the planned motion counts no more, None while it does: then it may be drawn."""
    return stale_reason("second" if second else "roll", session)


def planned_scans(session: Session) -> int:
    """Return how many A-scans the planned motion has places for; 0 before there is one."""
    plan = plan_of(session)
    if plan is None or plan.trajectory is None:
        return 0
    return len(fire_times(plan.trajectory, session.setup.devices.probe.pitch_mm))


def motion_times(session: Session, *, second: bool = False) -> tuple[float, float, float] | None:
    """Return duration, start and end of the scan of the planned motion in s; None before."""
    motion = replayed(session, second=second)
    return None if motion is None else (float(motion.times_s[-1]), motion.start_s, motion.end_s)


def joints_at(session: Session, share: float, *, second: bool = False) -> Floats | None:
    """Return the joint angles (6,) in rad at a share (0 to 1) of the planned motion."""
    motion = replayed(session, second=second)
    if motion is None:
        return None
    time_s = share * float(motion.times_s[-1])
    return np.array([np.interp(time_s, motion.times_s, q) for q in motion.qs_rad.T])


def replayed(session: Session, *, second: bool = False) -> Replayed | None:
    """Return the planned motion, and of further passes those before it; None before a plan.

    In contact the robot may lag behind: where A-scans were taken is what the plan says.
    """
    if not second:
        plan, held = plan_of(session), session.captures.scan
        if plan is None or plan.trajectory is None:
            return None
        return _replayed((), (plan.trajectory,), (held,), session.setup.devices)
    made, passes = session.results.second, usable_second(session)
    if made is None:
        return None
    planned, n_before = made.value, made.value.n_before
    count = max(len(passes) - n_before, 1)
    made_of = [one.plan.trajectory for one in planned.passes[:count]]
    motions = tuple(motion for motion in made_of if motion is not None)
    if len(motions) < len(made_of):
        return None
    after = passes[n_before : n_before + len(motions)] or (None,)
    return _replayed(passes[:n_before], motions, after, session.setup.devices)


@remember(4)  # sessions never change, and the cursor asks often
def _replayed(
    before: tuple[ScanCapture, ...],
    motions: tuple[Trajectory, ...],
    after: tuple[ScanCapture | None, ...],
    devices: DeviceSettings,
) -> Replayed:
    """Return passes scanned before others were planned, then the motion of each one after."""
    parts = [_reported(capture) for capture in before]
    for motion, capture in zip(motions, after, strict=True):
        fired = fire_times(motion, devices.probe.pitch_mm)
        # of a plan that is no longer the one that was executed there may be too few
        rows = np.minimum(np.arange(0 if capture is None else len(capture.scans)), len(fired) - 1)
        start_s, end_s = float(motion.scan_start_s), float(motion.scan_end_s)
        parts.append(Replayed(motion.times_s, motion.qs_rad, fired[rows], start_s, end_s))
    starts_s = np.cumsum([0.0, *(part.times_s[-1] for part in parts)])
    shifted = list(zip(parts, starts_s.tolist(), strict=False))
    return Replayed(
        times_s=readonly(np.concatenate([part.times_s + at_s for part, at_s in shifted])),
        qs_rad=readonly(np.concatenate([part.qs_rad for part in parts])),
        fired_s=readonly(np.concatenate([part.fired_s + at_s for part, at_s in shifted])),
        start_s=parts[0].start_s,
        end_s=shifted[-1][1] + parts[-1].end_s,
    )


def _reported(capture: ScanCapture) -> Replayed:
    """Return the motion of a scan as the robot reported it while A-scans came."""
    joints, fired = capture.joints, capture.scans.times_s - capture.joints.times_s[0]
    times_s = joints.times_s - joints.times_s[0]
    return Replayed(times_s, joints.qs_rad, fired, float(fired[0]), float(fired[-1]))


def path_percent_at(session: Session, share: float) -> float | None:
    """Return how far along the scan path (0 to 100) the planned motion is at a share of it."""
    searched = session.results.roll
    if searched is None or searched.value.trajectory is None:
        return None
    motion = searched.value.trajectory
    at_mm = float(np.interp(share * motion.times_s[-1], motion.times_s, motion.path_mm))
    return 100.0 * at_mm / max(float(motion.path_mm[-1]), 1e-9)
