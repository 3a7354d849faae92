"""What a rehearsal of the milling starts from: way, maps as they may be, and how it listens."""

import numpy as np

from rona_core.app.dependencies.inputs import require_result, required
from rona_core.app.steps.acoustics.derivation import first_speed
from rona_core.app.steps.acoustics.inputs import KNOWN_SPEED, ROBOT_PROBE
from rona_core.app.steps.implant.derivation import execution_error, mapped_bone
from rona_core.app.steps.implant.milling_derivation import plan_view, raised_view, robot_path_of
from rona_core.app.steps.implant.milling_motion import require_certified
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.app.steps.implant.view import MillingView, boundary_heights, milling_view
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.inputs import DRIVEN
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.devices.protocols import Cancel, never
from rona_core.devices.samples import AScanTrack
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.residuals import depths_along_axis, residuals
from rona_core.planning.placement.settings import PlacementLimits
from rona_core.planning.rehearsal.floor_line import FloorLine
from rona_core.planning.rehearsal.rehearse import MillingTask, PlanFloorScan, RaiseWay
from rona_core.planning.rehearsal.site import BurrWay, ProbeWay
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_cutting import CuttingPlanSettings
from rona_core.robot.planning.plan_scan import plan_scan
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.reference_points import at_speed
from rona_core.ultrasound.acoustic_calibration.speed_calibration import speed_at, uncalibrated
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey

STEP_MM = 0.25  # between places of the way at which force is felt
FINE_MM = 0.1  # between those they are taken from: the tip may go further than the ball
# relative sigma of the speed in what is left against that in the whole bone: of what is left none
# to all is diploe (two sigmas to either side), which is 15 to 20 % slower than the tables
MIXED_SHARE = 0.25 * 0.175
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
    way = burr_way(view, motion.path_mm, motion.qs_rad, motion.times_s)
    return task_along(session, way, raised, floor_scan)


def task_along(
    session: Session, way: BurrWay, raised: RaiseWay, floor_scan: PlanFloorScan
) -> MillingTask:
    """Return what is to be rehearsed along a way, see ``milling_task``."""
    bone, held = mapped_bone(session), require_result(session.results.get("bed"), "bed").value
    problem = PlacementProblem(
        bone, execution_error(session), PlacementLimits(held.limit_mm, held.required)
    )
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
        above = places[:, 2] - boundary_heights(bone.outer, places)
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


def burr_way(view: MillingView, ways_mm: Floats, qs_rad: Floats, times_s: Floats) -> BurrWay:
    """Return the places at which the burr cuts, evenly along its way.

    Args:
        view: The bed and its milling path.
        ways_mm: Along the path of the robot (k,), never falling.
        qs_rad: Postures there (k, 6).
        times_s: When the robot is there (k,).
    """
    path = robot_path_of(view)
    cutting = path.cutting
    ways = np.arange(0.0, float(cutting.way_mm()[-1]), FINE_MM)
    moves = cutting.moves_at(ways)
    cuts = ~cutting.in_air[moves]
    ways, moves = ways[cuts], moves[cuts]
    bottoms = cutting.at(ways).bottoms_bed
    gone = np.cumsum(np.linalg.norm(np.diff(bottoms, axis=0, prepend=bottoms[:1]), axis=1))
    kept = np.diff(np.floor(gone / STEP_MM), prepend=-1.0) > 0.0
    ways, moves = ways[kept], moves[kept]
    qs = [np.interp(ways, ways_mm, q) for q in qs_rad.T]
    return BurrWay(
        T_base_bed=cutting.T_base_bed,
        bottoms_bed=bottoms[kept],
        radii_mm=cutting.radii_mm[moves],
        qs_rad=np.column_stack(qs),
        times_s=np.interp(ways, ways_mm, times_s),
        feeds_mm_per_s=cutting.feeds_mm_per_s[moves],
        layers=view.path.layers[path.places[moves]],
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
        same = CuttingPlanSettings(n_rolls=1, roll_from_deg=self._roll_deg)
        self.plan = plan_view(session, view, same, cancel=self._cancel)
        if not self.plan.may_move:
            self.plan = plan_view(session, view, CuttingPlanSettings(), cancel=self._cancel)
        motion = self.plan.certified_motion
        if motion is None:
            return None
        return burr_way(view, motion.path_mm, motion.qs_rad, motion.times_s)


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


class FloorDetector:
    """Detector of the inner boundary below a floor, with the probe as the session knows it."""

    def __init__(self, session: Session, T_base_bed: Pose) -> None:
        """Measure below a bed."""
        self._session, self._T_base_bed = session, T_base_bed

    def __call__(
        self, track: AScanTrack, places_bed: Floats
    ) -> tuple[Floats, Floats, Bools, float]:
        """Return thickness, sigma and whether it is sure (m,), and the speed's relative sigma."""
        session, places = self._session, self._T_base_bed @ places_bed
        axis = -self._T_base_bed.rotation[:, 2]
        first: Detection = require_result(
            session.results.detection, "detect the boundaries (step 9)"
        ).value
        found = detect(
            ProbeSurvey(
                track,
                required(ROBOT_PROBE, session),
                session.setup.devices.probe.excitation,
                positions_mm=places,
                axes=np.tile(axis, (len(places), 1)),
            ),
            sound_speed_mm_per_us=first_speed(None),
            bone_loss=first.bone_loss,
        )
        known = KNOWN_SPEED.read(session)
        speeds, sigmas = speed_at(uncalibrated() if known is None else known, places)
        found = at_speed(found, speeds)
        share = float(np.hypot(MIXED_SHARE, (sigmas / speeds).mean()))
        return found.thickness_mm, found.thickness_sigma_mm, found.inner_ok, share
