"""A rehearsal of the milling: its task, how a session holds it, and what to say of it."""

from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.app.declarations.figures import FIGURES, percent
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import required
from rona_core.app.runtime.process_pool import release_memory
from rona_core.app.steps.acoustics.derivation import DETECTION, KNOWN_SPEED, ROBOT_PROBE
from rona_core.app.steps.implant.derivation import BED, EXECUTION, mapped_bone
from rona_core.app.steps.implant.messages import RehearseMilling
from rona_core.app.steps.implant.milling import burr_way_of, plan_view, raised_view
from rona_core.app.steps.implant.milling_plan import MillingPlan, why_no_milling
from rona_core.app.steps.implant.view import milling_model, milling_view, require_certified
from rona_core.app.steps.maps.inputs import MAPS, TERMS
from rona_core.app.steps.roll.certificate_view import why_no_plan
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.inputs import DRIVEN
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.setup.capture_parts import OBSTACLES, PROBE
from rona_core.devices.protocols import Cancel, Progress, never
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.planning.placement.evaluate import depths_along_axis, residuals
from rona_core.planning.placement.problem import PlacementLimits, PlacementProblem
from rona_core.planning.rehearsal.milled_floor import FloorDetector, FloorLine
from rona_core.planning.rehearsal.rehearse import MillingTask, PlanFloorScan, RaiseWay, rehearse
from rona_core.planning.rehearsal.site import BurrWay, MillingSite, ProbeWay
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan import RobotPlan
from rona_core.robot.planning.plan_motion import CuttingPlanSettings, plan_scan
from rona_core.session.codec import OMIT_EMPTY
from rona_core.session.document import Session
from rona_core.session.memo import remember

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


LEFT, RAISED = FIGURES["rehearsal_residual_mm"], FIGURES["rehearsal_raised_mm"]


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsal:
    """Outcome of a rehearsal, from force and A-scans; nothing of it is the truth."""

    number: int
    limit_mm: float  # of bone, that was asked for
    required: float  # probability of that
    pause: int  # last layer before the floor was scanned again; -1: it was not
    ceiling_mm: float | None  # height in ``bed`` that was not to be passed after that
    steps: int  # done of the corrected way
    stopped: bool  # by the force
    asked: int  # places of the floor that were scanned
    scans: Ints  # (m,) those of them that counted
    places_bed: Floats  # (m, 3)
    measured_mm: Floats  # (m,) bone below them, by the probe
    mapped_mm: Floats  # (m,) and by the maps
    raised_mm: float  # by which the floor is higher than planned
    residual_mm: float  # least bone that is thought to be left
    probability: float  # that it is as much as was asked for
    duration_s: float  # of cutting
    most_n: float  # cutting force
    # the layers that were left, planned anew at their corrected depth; None: as planned before,
    # nothing was left, or a file of a version that did not plan them
    raised_plan: MillingPlan | None = field(default=None, metadata=OMIT_EMPTY)
    # how the probe scans the floor; None: no place for it, or a file of a version that did not plan
    floor_plan: RobotPlan | None = field(default=None, metadata=OMIT_EMPTY)


def derive_rehearsal(
    session: Session,
    message: RehearseMilling,
    site: MillingSite,
    *,
    progress: Progress,
    cancel: Cancel,
) -> Rehearsal:
    """Rehearse the planned milling at a site.

    Raises:
        StepBlockedError: there is no certified motion.
        StaleResultError: it is of another bed, robot or surroundings.
        CancelledError: ``cancel`` returned True.
    """
    release_memory()
    planned, _ = require_certified(session)
    raised = RaisedMilling(session, planned.verdicts[planned.chosen].roll_deg, cancel)
    floor_scan = FloorScan(session, cancel)
    task = milling_task(session, raised, floor_scan)
    detector = floor_detector(session, task.way.T_base_bed)
    outcome = rehearse(task, site, detector, progress=progress, cancel=cancel)
    measured = outcome.measured
    return Rehearsal(
        number=message.number,
        limit_mm=task.limit_mm,
        required=task.probability,
        pause=outcome.pause,
        ceiling_mm=None if np.isneginf(outcome.ceiling_mm) else outcome.ceiling_mm,
        steps=outcome.steps,
        stopped=outcome.stopped,
        asked=outcome.asked,
        scans=readonly(np.zeros(0, dtype=np.int64) if measured is None else measured.scans),
        places_bed=readonly(np.zeros((0, 3)) if measured is None else measured.places_bed),
        measured_mm=readonly(np.zeros(0) if measured is None else measured.residual_mm),
        mapped_mm=readonly(np.zeros(0) if measured is None else measured.mapped_mm),
        raised_mm=outcome.raised_mm,
        residual_mm=outcome.residual_mm,
        probability=outcome.probability,
        duration_s=outcome.duration_s,
        most_n=outcome.most_n,
        raised_plan=raised.plan,
        floor_plan=floor_scan.plan,
    )


@remember(4)  # sessions never change
def rehearsal_stale(session: Session) -> str | None:
    """Return why the rehearsal counts no more, None while it does."""
    found = judge_part("rehearsal", session)
    return found.reason if found.state == "stale" else None


def rehearsal_verdict(found: Rehearsal) -> str:
    """Return in one sentence how a rehearsal went."""
    if found.stopped:
        return (
            "Rehearsed: by force and maps the burr may have been through, and the milling was "
            f"stopped with {LEFT.words(found.residual_mm)} of bone thought to be left."
        )
    return (
        f"Rehearsed: {_floor(found)}; {_depth(found)}, and {found.limit_mm:g} mm of bone stay with "
        f"{percent(found.probability)}."
    )


def _floor(found: Rehearsal) -> str:
    """Return what the re-scan of the floor measured, or why there was none."""
    plan = found.floor_plan
    if not found.asked:
        why = None if plan is None else why_no_plan(plan)
        because = f", as no motion of the probe over it is certified: {why}" if why else ""
        return f"the floor could not be scanned again{because}"
    certified = ""
    if plan is not None and plan.trajectory is not None:
        certified = f" in a certified motion of {plan.trajectory.duration_s:.0f} s"
    return (
        f"the floor, scanned again at {found.asked} places{certified}, was measured at "
        f"{len(found.scans)}"
    )


def _depth(found: Rehearsal) -> str:
    """Return how deep was milled, and what became of the plan of the raised layers."""
    if found.ceiling_mm is None:
        return "the bed was milled as deep as planned"
    higher, plan = f"{RAISED.words(found.raised_mm)} higher than planned", found.raised_plan
    ended = f"milling ended with the last finished layer, {higher}"
    if not found.steps:
        ended = "nothing was milled"
    if plan is None:
        return ended
    motion = plan.certified_motion
    if motion is None:
        return (
            "the last layers had to end higher, but the robot cannot mill them so: "
            f"{why_no_milling(plan)}; {ended}"
        )
    minutes, seconds = divmod(round(motion.duration_s), 60)
    return (
        f"the last layers, planned anew and certified ({minutes} min {seconds:02d} s), ended "
        f"{higher}"
    )


def rehearsal_ok(found: Rehearsal) -> bool:
    """Return whether all went as planned, as surely as was asked."""
    return not found.stopped and bool(len(found.scans)) and found.ceiling_mm is None
