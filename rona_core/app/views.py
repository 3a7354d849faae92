"""What the graphs and the replay show of a session: joint curves and the planned motion."""

from dataclasses import dataclass

import numpy as np

from rona_core.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.model import robot_model
from rona_core.robot.plan import RobotPlan
from rona_core.session.document import Session


@dataclass(frozen=True, slots=True, eq=False)
class JointCurves:
    """The six joints along the path for one roll, and where it fails (Figure 8 of the paper)."""

    roll_deg: float
    feasible: bool
    sentence: str
    path_percent: Floats  # (k,)
    joints_deg: Floats  # (k, 6)
    lower_deg: Floats  # (6,)
    upper_deg: Floats  # (6,)
    worst_percent: float  # place on the path that fails, or where the room is smallest
    worst_joint: int  # 1 to 6, or 0 where no single joint is to blame


@dataclass(frozen=True, slots=True, eq=False)
class RollStrip:
    """All rolls that were tried at a glance."""

    rolls_deg: Floats  # (rolls,)
    feasible: Bools  # (rolls,)
    room: Floats  # (rolls, k) along the path; negative where the robot cannot follow
    sentences: tuple[str, ...]
    chosen: int  # -1 where none is


def shown_roll(session: Session, wanted: int | None) -> int | None:
    """Return the index of the roll to show: the wanted one, else the chosen, else the first."""
    searched = session.results.roll
    if searched is None or not searched.value.verdicts:
        return None
    plan = searched.value
    if wanted is not None and 0 <= wanted < len(plan.verdicts):
        return wanted
    return max(plan.chosen, 0)


def shows_varying(plan: RobotPlan, wanted: int | None) -> bool:
    """Return whether the roll to show is the one that varies along the path."""
    return plan.mode == "variable" and wanted is None


def joint_curves(session: Session, wanted: int | None) -> JointCurves | None:
    """Return the joints along the path for a roll of the search; None before the search."""
    index = shown_roll(session, wanted)
    if index is None or session.results.roll is None:
        return None
    plan = session.results.roll.value
    verdict, model = plan.verdicts[index], robot_model(plan.model)
    curve = plan.curves_rad[index]
    if shows_varying(plan, wanted):
        verdict, curve = plan.varying or verdict, plan.chosen_curve_rad
    way = plan.path.arc_length_mm()
    percent = 100.0 * way / max(float(way[-1]), 1e-9)
    return JointCurves(
        roll_deg=verdict.roll_deg,
        feasible=verdict.feasible,
        sentence=verdict.sentence,
        path_percent=readonly(percent[plan.shown_points]),
        joints_deg=readonly(np.rad2deg(curve.astype(np.float64))),
        lower_deg=readonly(np.rad2deg(model.lower_rad)),
        upper_deg=readonly(np.rad2deg(model.upper_rad)),
        worst_percent=float(percent[min(verdict.index, len(percent) - 1)]),
        worst_joint=verdict.joint,
    )


def roll_strip(session: Session) -> RollStrip | None:
    """Return all rolls of the search; None before it."""
    searched = session.results.roll
    if searched is None:
        return None
    plan = searched.value
    return RollStrip(
        rolls_deg=readonly(np.array([v.roll_deg for v in plan.verdicts])),
        feasible=readonly(np.array([v.feasible for v in plan.verdicts], dtype=np.bool_)),
        room=readonly(plan.room.astype(np.float64)),
        sentences=tuple(v.sentence for v in plan.verdicts),
        chosen=plan.chosen,
    )


def roll_poses(session: Session, every: int, most: int = 12) -> tuple[Poses, Bools, Ints] | None:
    """Return the probe at the middle of the path for some rolls, and which of them work."""
    searched = session.results.roll
    if searched is None or not searched.value.verdicts:
        return None
    plan = searched.value
    index = np.unique(np.linspace(0, len(plan.verdicts) - 1, most).round().astype(np.int64))
    index = index if every <= 1 else index[::every]
    middle, poses = len(plan.path) // 2, []
    for i in index:
        turned = plan.path.Ts_base_probe(np.deg2rad(plan.verdicts[int(i)].roll_deg))
        poses.append(turned[middle])
    works = np.array([plan.verdicts[int(i)].feasible for i in index], dtype=np.bool_)
    return Poses.stack(poses), readonly(works), readonly(index)


def plan_of(session: Session, *, second: bool = False) -> RobotPlan | None:
    """Return the plan of the scan, or of the second pass; None before there is one."""
    if second:
        again = session.results.second
        return None if again is None else again.value.plan
    return None if session.results.roll is None else session.results.roll.value


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


def joints_of_roll(session: Session, wanted: int | None) -> Floats | None:
    """Return the joint angles (6,) in rad at the middle of the path with the roll that is shown.

    None before the search, and for a roll with which the robot cannot follow the path.
    """
    index = shown_roll(session, wanted)
    if index is None or session.results.roll is None:
        return None
    plan = session.results.roll.value
    varying = shows_varying(plan, wanted)
    if not varying and not plan.verdicts[index].feasible:
        return None
    curve = (plan.chosen_curve_rad if varying else plan.curves_rad[index]).astype(np.float64)
    return curve[len(curve) // 2]


def path_percent_at(session: Session, share: float) -> float | None:
    """Return how far along the scan path (0 to 100) the planned motion is at a share of it."""
    searched = session.results.roll
    if searched is None or searched.value.trajectory is None:
        return None
    motion = searched.value.trajectory
    at_mm = float(np.interp(share * motion.times_s[-1], motion.times_s, motion.path_mm))
    return 100.0 * at_mm / max(float(motion.path_mm[-1]), 1e-9)
