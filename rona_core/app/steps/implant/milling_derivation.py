"""Compute how the robot mills the bed of step 10."""

from dataclasses import replace

import numpy as np

from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.runtime.free_memory import release_memory
from rona_core.app.steps.implant.burr.inputs import KNOWN_BURR
from rona_core.app.steps.implant.messages import PlanMilling
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.app.steps.implant.view import MillingView, milling_view
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import readonly
from rona_core.planning.milling.feeds import duration_s
from rona_core.planning.rehearsal.depth_correction import raised_path
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
        CancelledError: ``cancel`` returned True.
    """
    release_memory()
    settings = CuttingPlanSettings(n_rolls=message.n_rolls)
    return plan_view(session, milling_view(session), settings, progress=progress, cancel=cancel)


def plan_view(
    session: Session,
    view: MillingView,
    settings: CuttingPlanSettings,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> MillingPlan:
    """Return how the robot of a session mills a bed, or why it cannot.

    Args:
        session: With the robot and its surroundings.
        view: The milling path of the bed.
        settings: Rolls to try; the surroundings are those of the session.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked during the search.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    path, model = robot_path_of(view).cutting, milling_model(session, view)
    settings = replace(settings, obstacles=milling_obstacles(session_obstacles(session), path))
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


def raised_view(view: MillingView, pause: int, ceiling_mm: float) -> MillingView | None:
    """Return a bed with what is left of its milling path, see ``raised_path``; None: nothing.

    The fit of the implant stays that of the planned bed.
    """
    raised = raised_path(view.path, pause, ceiling_mm, view.surface_mm)
    if raised is None:
        return None
    path, rows = raised
    feeds = readonly(view.feeds_mm_per_s[rows])
    return replace(view, path=path, feeds_mm_per_s=feeds, duration_s=duration_s(path, feeds))


def robot_path_of(view: MillingView) -> RobotPath:
    """Return the milling path of a bed as a robot is to drive it."""
    return _PATHS.get(
        (view,),
        lambda: robot_path(view.path, view.feeds_mm_per_s, view.placed.T_base_bed, view.surface_mm),
    )


def milling_model(session: Session, view: MillingView) -> RobotModel:
    """Return the robot of a session with the spindle in its hand, its tip as registered."""
    largest_mm = max(burr.radius_mm for burr in view.path.burrs)
    burr = KNOWN_BURR.read(session)
    offset = (0.0, 0.0, 0.0) if burr is None else tuple(burr.offset_tip.tolist())
    return milling_robot(session.setup.devices.robot.model, largest_mm, offset)
