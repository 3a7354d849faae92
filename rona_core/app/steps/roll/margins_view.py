"""What is shown of one roll along the path: margins, and the parts that come too close."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.steps.roll.view import shown_roll, shows_chosen
from rona_core.app.steps.setup.clearance import collision_world
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.redundancy.margins import branch_margins
from rona_core.session.document import Session
from rona_core.session.memo import Memo

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
