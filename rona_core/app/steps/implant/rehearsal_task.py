"""What a rehearsal of the milling starts from: way, maps as they may be, and how it listens."""

from dataclasses import replace

import numpy as np

from rona_core.app.dependencies.staleness import required
from rona_core.app.steps.acoustics.derivation import DETECTION, KNOWN_SPEED, ROBOT_PROBE
from rona_core.app.steps.implant.bed_milling import burr_way_of, raised_view
from rona_core.app.steps.implant.derivation import mapped_bone
from rona_core.app.steps.implant.inputs import BED, EXECUTION
from rona_core.app.steps.implant.milling_derivation import plan_view
from rona_core.app.steps.implant.milling_motion import milling_model, require_certified
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.app.steps.implant.view import milling_view
from rona_core.app.steps.maps.accuracy import TERMS
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.inputs import DRIVEN
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.setup.capture_parts import OBSTACLES, PROBE
from rona_core.devices.protocols import Cancel, never
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.evaluate import depths_along_axis, residuals
from rona_core.planning.placement.problem import PlacementLimits, PlacementProblem
from rona_core.planning.rehearsal.milled_floor import FloorDetector, FloorLine
from rona_core.planning.rehearsal.rehearse import MillingTask, PlanFloorScan, RaiseWay
from rona_core.planning.rehearsal.site import BurrWay, ProbeWay
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_motion import CuttingPlanSettings, plan_scan
from rona_core.session.document import Session

FLOOR_ROLLS = 24  # of the probe: the floor is small, so a roll works over all of it or nowhere


def milling_task(session: Session, raised: RaiseWay, floor_scan: PlanFloorScan) -> MillingTask:
    """Return what is to be rehearsed: the certified motion over the maps.

    ``raised`` plans what is left of it anew, ``floor_scan`` how its floor is scanned.

    Raises:
        StepBlockedError: there is no bed, or no certified motion.
        StaleResultError: something has changed since.
    """
    _, motion = require_certified(session)
    view = milling_view(session)
    way = burr_way_of(view, motion)
    return task_along(session, way, raised, floor_scan)


def task_along(
    session: Session, way: BurrWay, raised: RaiseWay, floor_scan: PlanFloorScan
) -> MillingTask:
    """Return what is to be rehearsed along a way, see ``milling_task``."""
    bone, held = mapped_bone(required(MAPS, session), TERMS.read(session)), required(BED, session)
    limits = PlacementLimits(held.limit_mm, held.required)
    problem = PlacementProblem(bone, required(EXECUTION, session), limits)
    T_map_bed: Pose = bone.outer.T_base_map.inv() @ way.T_base_bed
    normal_map = T_map_bed.rotation[:, 2]
    probe = required(ROBOT_PROBE, session)

    def mapped(places_bed: Floats) -> tuple[Floats, Floats]:
        drawn, found = residuals(problem, T_map_bed, T_map_bed @ places_bed)
        return found, drawn

    def along_axis(places_bed: Floats) -> tuple[Floats, Floats]:
        drawn, found = depths_along_axis(problem, T_map_bed, T_map_bed @ places_bed)
        return found, drawn

    def outer_mm(places_bed: Floats) -> Floats:
        places = T_map_bed @ places_bed
        above = places[:, 2] - bone.outer.heights(places)
        return places_bed[:, 2] - above / normal_map[2]

    return MillingTask(
        way=way,
        mapped=mapped,
        along_axis=along_axis,
        outer_mm=outer_mm,
        raised=raised,
        floor_scan=floor_scan,
        limit_mm=held.limit_mm,
        probability=held.required,
        face_radius_mm=probe.aperture_radius_mm,
        resolved_mm=probe.min_thickness_mm,
    )


class RaisedMilling:
    """Planner of the layers that are left once their depth was corrected; a ``RaiseWay``.

    Attributes:
        plan: What it planned last; None before that, and where nothing was left to be milled.
    """

    def __init__(self, session: Session, roll_deg: float, cancel: Cancel = never) -> None:
        """Plan for the robot of a session; only where this roll fails are all others tried."""
        self._session, self._roll_deg, self._cancel = session, roll_deg, cancel
        self.plan: MillingPlan | None = None

    def __call__(self, pause: int, ceiling_mm: float) -> BurrWay | None:
        """Return the way after a layer, nothing of it below a height of ``bed``, if certified.

        Raises:
            CancelledError: ``cancel`` returned True.
        """
        self.plan, session = None, self._session
        view = raised_view(milling_view(session), pause, ceiling_mm)
        if view is None:
            return None
        model, every = (
            milling_model(session, view),
            CuttingPlanSettings(obstacles=required(OBSTACLES, session)),
        )
        same = replace(every, n_rolls=1, roll_from_deg=self._roll_deg)
        self.plan = plan_view(view, model, same, cancel=self._cancel)
        if not self.plan.may_move:
            self.plan = plan_view(view, model, every, cancel=self._cancel)
        motion = self.plan.certified_motion
        if motion is None:
            return None
        return burr_way_of(view, motion)


class FloorScan:
    """Planner of the scan of a floor; a ``PlanFloorScan``.

    Attributes:
        plan: What it planned last, by the line as the path; None before that.
    """

    def __init__(self, session: Session, cancel: Cancel = never) -> None:
        """Plan for the robot of a session, with the probe in its hand."""
        self._session, self._cancel = session, cancel
        self._T_base_bed = milling_view(session).placed.T_base_bed
        self.plan: RobotPlan | None = None

    def __call__(self, line: FloorLine) -> ProbeWay | None:
        """Return where the probe is pressed on along a line, upright, if that is certified.

        Raises:
            CancelledError: ``cancel`` returned True.
        """
        session, T_base_bed = self._session, self._T_base_bed
        axes = np.tile(-T_base_bed.rotation[:, 2], (len(line.points_bed), 1))
        path = Path5D(T_base_bed @ line.points_bed, axes)
        asked = StartRollSearch(n_rolls=FLOOR_ROLLS, mode="constant")
        model = robot_model(session.setup.devices.robot.model)
        self.plan = plan_scan(
            path, model, plan_settings(required(DRIVEN, session), asked), cancel=self._cancel
        )
        motion = self.plan.trajectory
        if motion is None or not self.plan.may_move:
            return None
        scans = slice(*np.searchsorted(motion.times_s, (motion.scan_start_s, motion.scan_end_s)))
        ways_mm, stops_mm = motion.path_mm[scans], path.arc_length_mm()[line.stops]
        return ProbeWay(
            line.places_bed,
            np.column_stack([np.interp(stops_mm, ways_mm, q) for q in motion.qs_rad[scans].T]),
            np.interp(stops_mm, ways_mm, motion.times_s[scans]),
        )


def floor_detector(session: Session, T_base_bed: Pose) -> FloorDetector:
    """Return the detector of the bone below a bed, with the probe as the session knows it."""
    probe, excitation = required(ROBOT_PROBE, session), required(PROBE, session).excitation
    loss = required(DETECTION, session).bone_loss
    return FloorDetector(T_base_bed, probe, excitation, loss, KNOWN_SPEED.read(session))
