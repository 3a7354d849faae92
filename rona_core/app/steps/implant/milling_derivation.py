"""Compute how the robot mills the bed of step 10."""

from dataclasses import replace

import numpy as np

from rona_core.app.runtime.process_pool import release_memory
from rona_core.app.steps.implant.bed_milling import MillingView, bed_milling, robot_path_of
from rona_core.app.steps.implant.burr.inputs import BurrRegistration
from rona_core.app.steps.implant.inputs import MillingInputs
from rona_core.app.steps.implant.messages import PlanMilling
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.geometry.arrays import readonly
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.robot_milling import milling_obstacles
from rona_core.robot.kinematics.catalog import milling_robot
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan_motion import CuttingPlanSettings, plan_cutting

NONE = np.zeros(0)


def plan_bed_milling(
    known: MillingInputs, message: PlanMilling, *, progress: Progress, cancel: Cancel
) -> MillingPlan:
    """Judge every roll about the burr; plan, time and verify the milling with the best.

    Raises:
        StepBlockedError: the bed does not lie wholly in the maps.
        CancelledError: ``cancel`` returned True.
    """
    release_memory()
    view = bed_milling(known.bed, known.maps)
    model = spindle_model(known.robot, view.path, known.burr)
    settings = CuttingPlanSettings(n_rolls=message.n_rolls, obstacles=known.obstacles)
    return plan_view(view, model, settings, progress=progress, cancel=cancel)


def plan_view(
    view: MillingView,
    model: RobotModel,
    settings: CuttingPlanSettings,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> MillingPlan:
    """Return how a robot mills a bed, or why it cannot.

    Args:
        view: The milling path of the bed.
        model: The robot with the spindle.
        settings: Rolls to try, and what stands around: the burr may enter the head.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked during the search.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    path = robot_path_of(view).cutting
    settings = replace(settings, obstacles=milling_obstacles(settings.obstacles, path))
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


def spindle_model(robot: str, path: MillingPath, burr: BurrRegistration | None) -> RobotModel:
    """Return a robot with the spindle for a path in its hand, its tip as registered."""
    largest_mm = max(one.radius_mm for one in path.burrs)
    offset = (0.0, 0.0, 0.0) if burr is None else tuple(burr.offset_tip.tolist())
    return milling_robot(robot, largest_mm, offset)
