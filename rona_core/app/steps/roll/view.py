"""What is shown of the rolls of a search: which work and why not, their joints and their poses."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rona_core.app.dependencies.judge import fresh
from rona_core.app.steps.setup.clearance import collision_world
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.kinematics.arm import BRANCHES
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.margins import branch_margins
from rona_core.robot.redundancy.result import RollVerdict
from rona_core.robot.trajectory.scan_timing import ScanSettings, expected_duration_s
from rona_core.session.document import Session
from rona_core.session.memo import Memo

MOST_RANKED = 40  # ways in a table
MOST_DRAWN = 12  # rolls in a fan
REASON_WORDS = {  # reason of a verdict -> what is said of the roll
    "none": "feasible",
    "limit": "joint limit",
    "reach": "out of reach",
    "singularity": "singularity",
    "jump": "joint jump",
    "blocked": "collision",
    "roll rate": "roll rate",
    "no way": "no approach or retract",
}


def expected_duration(session: Session) -> float | None:
    """Return how long the scan will take (s), before it is planned; None without a fresh path."""
    smooth = fresh("smoothing", session)
    if smooth is None:
        return None
    settings = ScanSettings(scan_speed_mm_per_s=session.setup.devices.robot.scan_speed_mm_per_s)
    return expected_duration_s(smooth.path, len(smooth.corners_base), settings)


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
    fails: Bools | None = None  # (k,) where the robot cannot follow; None: nowhere
    variation_deg: float = 0.0  # of a roll that varies along the path


@dataclass(frozen=True, slots=True, eq=False)
class RollStrip:
    """All rolls that were tried at a glance."""

    rolls_deg: Floats  # (rolls,)
    feasible: Bools  # (rolls,)
    node_room: Floats  # (k, rolls) on the best branch at each place; below 0: cannot be reached
    reasons: tuple[str, ...]  # why each roll fails; "none" where it does not
    fails_at: Floats  # (rolls,) share of the path after which each roll fails; 1: it does not
    chosen: int  # -1 where none is, and where the chosen roll varies
    curve_deg: Floats  # (k,) the chosen roll along the path; empty where there is none


@dataclass(frozen=True, slots=True)
class RankedWay:
    """One roll and branch with which the whole path can be followed."""

    index: int
    branch: int
    roll_deg: float
    margin: float  # smallest margin along the path
    label: str  # of the branch
    chosen: bool


def shown_roll(session: Session, wanted: int | None) -> int | None:
    """Return the index of the roll to show: the wanted one, else the chosen.

    Where there is none, the one with the largest margin, or the one that gets furthest.
    """
    searched = session.results.roll
    if searched is None or not searched.value.search.verdicts:
        return None
    search = searched.value.search
    if wanted is not None and 0 <= wanted < len(search.verdicts):
        return wanted
    if search.mode == "none":
        furthest = max(range(len(search.verdicts)), key=lambda i: search.verdicts[i].index)
        return search.ranked[0].index if search.ranked else furthest
    return max(search.chosen, 0)


def shows_varying(plan: RobotPlan, wanted: int | None) -> bool:
    """Return whether the roll to show is the one that varies along the path."""
    return plan.search.mode == "variable" and wanted is None


def shows_chosen(plan: RobotPlan, wanted: int | None) -> bool:
    """Return whether the roll to show is the chosen one, constant or varying."""
    if plan.search.mode == "none":
        return False
    return shows_varying(plan, wanted) or (
        plan.search.mode == "constant" and wanted in (None, plan.search.chosen)
    )


def joint_curves(session: Session, wanted: int | None) -> JointCurves | None:
    """Return the joints along the path for a roll of the search; None before the search."""
    index = shown_roll(session, wanted)
    if index is None or session.results.roll is None:
        return None
    plan = session.results.roll.value
    model, (verdict, curve) = robot_model(plan.model), _shown_curve(plan, index, wanted)
    varies = shows_varying(plan, wanted)
    way = plan.search.path.arc_length_mm()
    percent = 100.0 * way / max(float(way[-1]), 1e-9)
    return JointCurves(
        roll_deg=verdict.roll_deg,
        feasible=verdict.feasible,
        sentence=verdict.sentence,
        path_percent=readonly(percent[plan.search.shown_points]),
        joints_deg=readonly(np.rad2deg(curve.astype(np.float64))),
        lower_deg=readonly(np.rad2deg(model.lower_rad)),
        upper_deg=readonly(np.rad2deg(model.upper_rad)),
        worst_percent=float(percent[min(verdict.index, len(percent) - 1)]),
        worst_joint=verdict.joint,
        fails=None if verdict.feasible else readonly(plan.search.room[index] < 0.0),
        variation_deg=plan.search.roll_variation_deg if varies else 0.0,
    )


def _shown_curve(
    plan: RobotPlan, index: int, wanted: int | None
) -> tuple[RollVerdict, NDArray[np.float32]]:
    """Return the verdict on the roll that is shown, and its joints (k, 6)."""
    verdict, curve = plan.search.verdicts[index], plan.search.curves_rad[index]
    if shows_chosen(plan, wanted):
        verdict, curve = plan.verdict or verdict, plan.search.chosen_curve_rad
    return verdict, curve


def roll_strip(session: Session) -> RollStrip | None:
    """Return all rolls of the search; None before it."""
    searched = session.results.roll
    if searched is None:
        return None
    search = searched.value.search
    way = search.path.arc_length_mm()
    share, verdicts = way / max(float(way[-1]), 1e-9), search.verdicts
    curve = np.zeros(0) if search.mode == "none" else search.rolls_rad[search.shown_points]
    fails_at = [1.0 if verdict.feasible else share[verdict.index] for verdict in verdicts]
    return RollStrip(
        rolls_deg=readonly(np.array([verdict.roll_deg for verdict in verdicts])),
        feasible=readonly(np.array([verdict.feasible for verdict in verdicts], dtype=np.bool_)),
        node_room=readonly(search.node_room.astype(np.float64)),
        reasons=tuple(verdict.reason for verdict in verdicts),
        fails_at=readonly(np.array(fails_at)),
        chosen=search.chosen,
        curve_deg=readonly(np.rad2deg(curve)),
    )


def ranked_ways(session: Session) -> tuple[RankedWay, ...]:
    """Return the ways to follow the path with a constant roll, largest margin first."""
    searched = session.results.roll
    if searched is None:
        return ()
    plan = searched.value
    return tuple(
        RankedWay(
            index=pair.index,
            branch=pair.branch,
            roll_deg=plan.search.verdicts[pair.index].roll_deg,
            margin=pair.margin,
            label=BRANCHES[pair.branch].label,
            chosen=plan.search.mode == "constant"
            and (pair.index, pair.branch) == (plan.search.chosen, plan.search.branch),
        )
        for pair in plan.search.ranked[:MOST_RANKED]
    )


def roll_poses(plan: RobotPlan, places: Ints) -> tuple[tuple[Poses, ...], Bools]:
    """Return the probe at some path points for some of the rolls, and which rolls work.

    Args:
        plan: With its search.
        places: Numbers (k,) of path points.

    Returns:
        For each of at most ``MOST_DRAWN`` rolls the k poses in ``base``, and whether the whole
        path can be followed with it.
    """
    verdicts = plan.search.verdicts
    some = np.linspace(0, len(verdicts), min(MOST_DRAWN, len(verdicts)), endpoint=False)
    drawn = [verdicts[int(number)] for number in some]
    poses = tuple(
        plan.search.path.Ts_base_probe(np.deg2rad(each.roll_deg)).select(places) for each in drawn
    )
    return poses, readonly(np.array([each.feasible for each in drawn], dtype=np.bool_))


def point_at(plan: RobotPlan, place: float) -> int:
    """Return the number of the path point nearest to a share (0 to 1) of the path."""
    way = plan.search.path.arc_length_mm()
    return int(np.argmin(np.abs(way - place * way[-1])))


def place_of_roll(session: Session, wanted: int | None, place: float | None = None) -> float:
    """Return the share of the path (0 to 1) at which the roll that is shown is looked at.

    Without a place it is the middle, or for a roll that fails the path point that fails first.
    """
    if place is not None:
        return min(max(place, 0.0), 1.0)
    curves = joint_curves(session, wanted)
    return 0.5 if curves is None or curves.feasible else 0.01 * curves.worst_percent


def joints_of_roll(
    session: Session, wanted: int | None, place: float | None = None
) -> Floats | None:
    """Return the joint angles (6,) in rad at a place of the path with the roll that is shown.

    Of a roll that fails they are those that it would need, beyond what the robot can do. None
    before the search.

    Args:
        session: Holds the search.
        wanted: Index of the roll, None for the chosen one.
        place: Share of the path, see :func:`place_of_roll`.
    """
    curves = joint_curves(session, wanted)
    if curves is None:
        return None
    at = 100.0 * place_of_roll(session, wanted, place)
    return np.deg2rad(curves.joints_deg[int(np.argmin(np.abs(curves.path_percent - at)))])


def none_works(plan: RobotPlan) -> str:
    """Return why there is no plan at all, and what helps."""
    remedy = "Look below where to put the robot, shorten the path or tilt it less."
    varying = "" if plan.search.varying is None else f" {plan.search.varying.sentence}."
    if plan.search.refused is not None:
        sentence = plan.search.refused.sentence
        varying = f" {sentence[:1].upper()}{sentence[1:]}.{varying}"
    if not plan.search.n_feasible:
        return f"None of {len(plan.search.verdicts)} rolls can be followed.{varying} {remedy}"
    return (
        f"{plan.search.n_feasible} of {len(plan.search.verdicts)} rolls could be followed by the "
        "arm alone, but the best of them have no way there and back on which robot and "
        f"tool keep clear of everything (path colour Collisions, on the right).{varying} {remedy}"
    )


Quantity = Literal["room", "limits", "singularity", "clearance"]

_KNOWN: "Memo[PathMargins]" = Memo(8)


@dataclass(frozen=True, slots=True, eq=False)
class PathMargins:
    """How far the robot stays from each border along the path, with one roll and branch."""

    points_base: Floats  # (k, 3)
    room: Floats  # (k,) least of all but collisions, without unit; below 0: cannot follow
    limit_deg: Floats  # (k,) from the nearest joint limit
    singularity: Floats  # (k,) room to the nearest singularity
    clearance_mm: Floats  # (k,) of any parts that must not touch
    collides: Bools  # (k,) some pair is closer than it must be
    closest: tuple[str, str]  # the pair with the least to spare
    closest_mm: float  # how far apart it is there
    needed_mm: float  # how far apart it must be; below 0: it may be pressed in so far
    closest_at: int  # place, into k

    def values(self, quantity: Quantity) -> Floats:
        """Return one quantity (k,)."""
        return {
            "room": self.room,
            "limits": self.limit_deg,
            "singularity": self.singularity,
            "clearance": self.clearance_mm,
        }[quantity]

    def fails(self, quantity: Quantity) -> Bools:
        """Return where (k,) the robot cannot or must not be, by one quantity."""
        return self.collides if quantity == "clearance" else self.values(quantity) < 0.0


def path_margins(session: Session, wanted: int | None) -> PathMargins | None:
    """Return the margins of the roll that is looked at; None before the search."""
    index, searched = shown_roll(session, wanted), session.results.roll
    if index is None or searched is None:
        return None
    plan, world = searched.value, collision_world(session)
    chosen = shows_chosen(plan, wanted)
    return _KNOWN.get(
        (plan, world),
        lambda: _margins(plan, world, index, chosen=chosen),
        -1 if chosen else index,
    )


def _margins(plan: RobotPlan, world: CollisionWorld, index: int, *, chosen: bool) -> PathMargins:
    verdict, model, shown = (
        plan.search.verdicts[index],
        robot_model(plan.model),
        plan.search.shown_points,
    )
    rolls_rad = plan.search.rolls_rad if chosen else np.deg2rad(verdict.roll_deg)
    branch = plan.search.branch if chosen else verdict.branch
    found = branch_margins(plan.search.path, model, rolls_rad, branch)
    curve = plan.search.chosen_curve_rad if chosen else plan.search.curves_rad[index]
    report = world.report(curve.astype(np.float64))
    at = int(np.argmin(report.room_mm))
    closest = report.closest_pair(at)
    least = [
        readonly(np.minimum.reduceat(values, shown))
        for values in (found.least, found.limit_deg, found.singularity)
    ]
    return PathMargins(
        points_base=readonly(plan.search.path.points_base[shown]),
        room=least[0],
        limit_deg=least[1],
        singularity=least[2],
        clearance_mm=report.clearance_mm,
        collides=readonly(report.room_mm < 0.0),
        closest=(closest.first, closest.second),
        closest_mm=closest.apart_mm,
        needed_mm=closest.least_mm,
        closest_at=at,
    )
