"""Where to put the robot's base: the search in full, among what stands around, and its outcome."""

from dataclasses import replace
from typing import Literal

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.messages import StartBasePlacement, StartRollSearch
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import RobotSettings
from rona_core.errors import NotReachableError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.candidates import BasePlace, BasePlacement
from rona_core.robot.base_placement.placement import place_base
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_scan import plan_scan
from rona_core.session.document import Session

Which = Literal["best", "smallest"]
STILL_MM, STILL_DEG = 0.5, 0.05  # a base that moves by less stays where it is


def derive_placement(
    session: Session,
    message: StartBasePlacement,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> BasePlacement:
    """Search places of the base; what is suggested is planned and certified among everything."""
    smooth = require_result(session.results.smoothing, "smooth the path").value
    robot = session.setup.devices.robot
    model = robot_model(robot.model)
    settings = plan_settings(session, StartRollSearch())
    around = settings.obstacles

    def planner(path: Path5D, old_in_new: Pose) -> RobotPlan:
        seen = None if around is None else obstacles_from(around, old_in_new)
        return plan_scan(path, model, replace(settings, obstacles=seen), cancel=cancel)

    return place_base(
        smooth.path,
        model,
        robot,
        search=message.search(),
        planner=planner,
        progress=progress,
        cancel=cancel,
    )


def obstacles_from(obstacles: Obstacles, old_in_new: Pose) -> Obstacles:
    """Return what stands around, seen from a new place of the base.

    Args:
        obstacles: In ``base`` as the base stands now.
        old_in_new: Pose of the base as it stands now, in the frame of the base at its new place.
    """
    things = tuple(replace(thing, pose=old_in_new @ thing.pose) for thing in obstacles.things)
    return replace(obstacles, things=things)


def moves(place: BasePlace) -> bool:
    """Return whether a place is another one than where the base stands."""
    return place.moved_mm > STILL_MM or place.turned_deg > STILL_DEG


def advice(placement: BasePlacement) -> str:
    """Return in a sentence where to put the base, or that no place helps."""
    near, best = placement.smallest, placement.best
    if near is None or best is None:
        return f"Change the path: {'; '.join(placement.reasons[1:])}"
    if not moves(near):
        return "The base may stay: a motion from where it stands is certified"
    roomy = "" if best is near else f". With the most room: {best.sentence}"
    return f"Move the robot base. The smallest move that was certified: {near.sentence}{roomy}"


def require_move(session: Session, which: Which) -> RobotSettings:
    """Return the robot's settings with its base at the place that was found.

    Raises:
        NotReachableError: no place was found, or the base stands there already.
    """
    placement = require_result(session.results.placement, "look for a place of the base").value
    place = placement.best if which == "best" else placement.smallest
    if place is None:
        raise NotReachableError(f"the base stays where it is: {placement.reasons[-1]}")
    if not moves(place):
        raise NotReachableError("the base stays where it is: the scan works from there")
    return place.moved(session.setup.devices.robot)
