"""What the graphs and the replay show of a session: the planned motion, while it is not stale."""

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.scan.captures import fire_times
from rona_core.geometry.arrays import Floats
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.document import Session
from rona_core.session.memo import remember


def plan_of(session: Session, *, second: bool = False) -> RobotPlan | None:
    """Return the plan of the scan, or of the second pass; None before there is one."""
    if second:
        again = session.results.second
        return None if again is None else again.value.plan
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
    plan = plan_of(session, second=second)
    if plan is None or plan.trajectory is None:
        return None
    motion = plan.trajectory
    return float(motion.times_s[-1]), float(motion.scan_start_s), float(motion.scan_end_s)


def joints_at(session: Session, share: float, *, second: bool = False) -> Floats | None:
    """Return the joint angles (6,) in rad at a share (0 to 1) of the planned motion."""
    plan = plan_of(session, second=second)
    if plan is None or plan.trajectory is None:
        return None
    motion = plan.trajectory
    time_s = share * float(motion.times_s[-1])
    return np.array([np.interp(time_s, motion.times_s, q) for q in motion.qs_rad.T])


def path_percent_at(session: Session, share: float) -> float | None:
    """Return how far along the scan path (0 to 100) the planned motion is at a share of it."""
    searched = session.results.roll
    if searched is None or searched.value.trajectory is None:
        return None
    motion = searched.value.trajectory
    at_mm = float(np.interp(share * motion.times_s[-1], motion.times_s, motion.path_mm))
    return 100.0 * at_mm / max(float(motion.path_mm[-1]), 1e-9)
