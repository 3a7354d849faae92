"""Compute how the robot mills the bed of step 10."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rona_core.app.runtime.process_pool import release_memory
from rona_core.app.steps.implant.burr.derivation import BurrRegistration
from rona_core.app.steps.implant.derivation import ImplantBed, MillingInputs, PlacedBed
from rona_core.app.steps.implant.messages import PlanMilling
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import StepBlockedError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.mapping.boundary_map import Maps
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant, implant_named
from rona_core.planning.milling.milling_path import MillingPath, duration_s, feeds_mm_per_s
from rona_core.planning.milling.plan_milling import milling_settings, plan_milling
from rona_core.planning.milling.removal import Fit, fit, planned_bed
from rona_core.planning.milling.tool_regions import MOST_SURFACE_MM
from rona_core.planning.rehearsal.milled_floor import raised_path
from rona_core.planning.rehearsal.rehearse import burr_way
from rona_core.planning.rehearsal.site import BurrWay
from rona_core.planning.robot_milling import RobotPath, milling_obstacles, robot_path
from rona_core.robot.kinematics.catalog import milling_robot
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan_motion import CuttingPlanSettings, plan_cutting
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.session.memo import remember


@dataclass(frozen=True, slots=True, eq=False)
class MillingView:
    """How a bed would be milled, by the robot or by hand."""

    implant: Implant
    placed: PlacedBed
    bed: Bed
    surface_mm: float  # that the bone within the outline rises above z = 0 of ``bed``
    path: MillingPath
    feeds_mm_per_s: Floats  # (n,)
    duration_s: float
    fit: Fit

    def implant_base(self) -> Mesh:
        """Return the implant in its bed, in ``base``."""
        solid: Any = self.implant.mesh()
        points = self.placed.T_base_bed @ np.asarray(solid.vertices, dtype=np.float64)
        return Mesh(points, np.asarray(solid.faces, dtype=np.int64))

    def tips_base(self) -> Floats:
        """Return the path of the burr's tip (n, 3) in ``base``."""
        return self.placed.T_base_bed @ self.path.tips_bed


@remember(2)  # beds and maps never change
def bed_milling(held: ImplantBed, maps: Maps) -> MillingView:
    """Return how a bed in the maps would be milled.

    Raises:
        StepBlockedError: it does not lie wholly in them.
    """
    placed = held.placed
    if placed is None or placed.residual_mm is None:
        raise StepBlockedError(
            f"there is no bed to mill: {held.refusal or 'it is not mapped'}: choose another place "
            "or implant (step 10)"
        )
    implant = implant_named(held.implant).lifted(held.lift_mm)
    settings = milling_settings(implant, held.burr_mm)
    T_map_bed = maps.outer.T_base_map.inv() @ placed.T_base_bed
    bed = planned_bed(implant, settings)
    i, j = np.nonzero(bed.cut())
    seat_map = T_map_bed @ np.column_stack((bed.x_mm[i], bed.y_mm[j], np.zeros(len(i))))
    above_mm = float((seat_map[:, 2] - maps.outer.heights(seat_map)).min())
    surface_mm = min(max(-above_mm, 0.0), MOST_SURFACE_MM)
    path = plan_milling(implant, settings, surface_mm)
    bottoms_map = T_map_bed @ path.bottoms_bed()
    residual_mm = bottoms_map[:, 2] - maps.inner.heights(bottoms_map)
    feeds = feeds_mm_per_s(path, readonly(residual_mm))
    return MillingView(
        implant, placed, bed, surface_mm, path, feeds, duration_s(path, feeds), fit(implant, bed)
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


@remember(2)
def robot_path_of(view: MillingView) -> RobotPath:
    """Return the milling path of a bed as a robot is to drive it."""
    return robot_path(view.path, view.feeds_mm_per_s, view.placed.T_base_bed, view.surface_mm)


def burr_way_of(view: MillingView, motion: Trajectory) -> BurrWay:
    """Return the places at which the burr cuts in a motion that mills a bed."""
    path, layers = robot_path_of(view), view.path.layers
    return burr_way(path, layers, motion.path_mm, motion.qs_rad, motion.times_s)


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
