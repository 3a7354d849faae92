"""Compute how the robot mills the bed of step 10."""

import numpy as np

from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.steps.implant.burr.derivation import known_burr
from rona_core.app.steps.implant.messages import PlanMilling
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.app.steps.implant.view import MillingView, milling_view
from rona_core.devices.protocols import Cancel, Progress
from rona_core.geometry.arrays import readonly
from rona_core.planning.robot_milling.robot_path import (
    RobotPath,
    milling_obstacles,
    robot_path,
)
from rona_core.robot.kinematics.catalog import milling_robot
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan_cutting import CuttingPlanSettings, plan_cutting
from rona_core.session.document import Session
from rona_core.session.memo import Memo

NONE = np.zeros(0)

_PATHS: Memo[RobotPath] = Memo(2)


def derive_milling(
    session: Session, message: PlanMilling, *, progress: Progress, cancel: Cancel
) -> MillingPlan:
    """Judge every roll about the burr; plan, time and verify the milling with the best.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        StaleResultError: it is of other maps.
        CancelledError: somebody cancelled.
    """
    view = milling_view(session)
    path, model = robot_path_of(view).cutting, milling_model(session, view)
    obstacles = milling_obstacles(session_obstacles(session), path)
    settings = CuttingPlanSettings(n_rolls=message.n_rolls, obstacles=obstacles)
    plan = plan_cutting(path, model, settings, progress=progress, cancel=cancel)
    motion = plan.trajectory
    return MillingPlan(
        model=plan.model,
        verdicts=plan.search.verdicts,
        chosen=plan.search.chosen,
        trajectory=motion,
        certificate=plan.certificate,
        layer_ends_s=readonly(NONE if motion is None else path.rest_times_s(motion)[1:]),
        changes_s=readonly(NONE if motion is None else path.change_times_s(motion)),
    )


def robot_path_of(view: MillingView) -> RobotPath:
    """Return the milling path of a bed as a robot is to drive it."""
    return _PATHS.get(
        (view,),
        lambda: robot_path(view.path, view.feeds_mm_per_s, view.placed.T_base_bed, view.surface_mm),
    )


def milling_model(session: Session, view: MillingView) -> RobotModel:
    """Return the robot of a session with the spindle in its hand, its tip as registered."""
    largest_mm = max(burr.radius_mm for burr in view.path.burrs)
    burr = known_burr(session)
    offset = (0.0, 0.0, 0.0) if burr is None else tuple(burr.offset_tip.tolist())
    return milling_robot(session.setup.devices.robot.model, largest_mm, offset)
