"""Boundary detection and maps, of the first pass and of further ones."""

from dataclasses import dataclass, replace
from functools import partial

from rona_core.app.declarations.declarations import Arguments
from rona_core.app.messages.message import message_from
from rona_core.app.steps.acoustics.derivation import with_known_speed
from rona_core.app.steps.maps.inputs import (
    FirstPass,
    FirstSurvey,
    FurtherSurvey,
    MapsInputs,
    TiltInputs,
)
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan
from rona_core.app.steps.path.inputs import require_none_avoided
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.derivation import ProbePlaces, joined_poses, numbers_of
from rona_core.app.steps.scan.inputs import Passes
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build_maps import (
    LocatedDetection,
    OuterMaps,
    add_inner_map,
    build_outer_maps,
)
from rona_core.mapping.tilted_passes import SecondPassPath, plan_along, standoffs_mm, tilted_paths
from rona_core.path.zones import PaintedRegions
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.robot.redundancy.scan_postures import ScanPostures
from rona_core.session.document import SecondPass
from rona_core.session.memo import Memo
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, Detection, detect
from rona_core.ultrasound.detection.manual_corrections import BoundaryEdits, corrected
from rona_core.ultrasound.detection.pass_standoff import standoff_offset_mm
from rona_core.ultrasound.probe.probe_model import ProbeModel, ProbeSurvey

OUTER_MAPS: Memo[OuterMaps] = Memo(2)  # maps, plan of a further pass and its detection share one
MAPS: Memo[Maps] = Memo(1)  # and the plan has the maps as they are where no speed is calibrated


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A-scans (n), and where the probe was at each of them, in any frame that stands still."""

    scans: AScanTrack
    poses: Poses  # (n,) of the probe
    probe: ProbeModel  # as far as it is known
    excitation: Excitation
    known_standoff_mm: Floats | None = None  # (n,) to the outer boundary, see ``ProbeSurvey``
    bone_loss: float | None = None  # over the nominal one; None: to be learned from these A-scans

    def of_probe(self) -> ProbeSurvey:
        """Return what detection looks at."""
        return ProbeSurvey(
            self.scans,
            self.probe,
            self.excitation,
            positions_mm=self.poses.translations,
            axes=self.poses.rotations[:, :, 2],
            known_standoff_mm=self.known_standoff_mm,
        )


def detect_survey(
    survey: Survey, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find both boundaries with all that is known of probe, line, speed and places.

    Raises:
        InvalidInputError: A-scans of another probe, or poses that are not finite.
        CancelledError: ``cancel`` said so.
    """
    return detect(
        survey.of_probe(),
        method=message.method,
        sound_speed_mm_per_us=message.sound_speed_mm_per_us or NOMINAL_SPEED_MM_PER_US,
        bone_loss=survey.bone_loss,
        progress=progress,
        cancel=cancel,
    )


def find_boundaries(
    known: FirstSurvey, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find both boundaries in every A-scan, with those around it as witnesses."""
    survey = Survey(known.scan.scans, known.poses, known.probe, known.settings.excitation)
    return detect_survey(survey, message, progress=progress, cancel=cancel)


def find_inner_boundary(
    known: FurtherSurvey, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find the inner boundary in the further passes.

    The outer boundary is that of the first pass, and so is the attenuation of the bone.
    """
    first, excitation = known.first, known.settings.excitation
    return detect_again(
        first, known.passes, known.places, excitation, message, progress=progress, cancel=cancel
    )


def detect_again(
    first: FirstPass,
    passes: Passes,
    places: ProbePlaces,
    excitation: Excitation,
    message: StartMapping,
    *,
    progress: Progress,
    cancel: Cancel,
) -> Detection:
    """Find the inner boundary in further passes; arguments as of `FurtherSurvey`."""
    maps = outer_maps(first, message.cell_mm)
    parts: list[Detection] = []
    for number, one in enumerate(passes):
        poses = places.poses(one)
        known_mm = standoffs_mm(maps.outer, poses) + maps.late_mm
        survey = Survey(one.scans, poses, first.probe, excitation, known_mm, first.found.bone_loss)
        here_mm = known_mm + standoff_offset_mm(survey.of_probe(), known_mm)
        survey = replace(survey, known_standoff_mm=here_mm)
        share = partial(_share, progress, number / len(passes), 1.0 / len(passes))
        found = detect_survey(survey, message, progress=share, cancel=cancel)
        # poses and outer map belong together: the inner boundary is placed below the map
        parts.append(replace(found, standoff_mm=readonly(known_mm)))
    return Detection.joined(parts)


def _share(progress: Progress, start: float, width: float, share: float) -> None:
    progress(start + width * share)


def build_maps(
    known: MapsInputs, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Maps:
    """Map both boundaries and fuse the outer one with the pointer cloud.

    What further passes found is mapped as well, and thickness is at the calibrated speed of sound
    where there is one. Boundaries that were set by hand take the place of those that were found.
    """
    first, wanted = known.first, message.sound_speed_mm_per_us
    outer = outer_maps(first, message.cell_mm, progress=progress, cancel=cancel)
    further = further_detection(first, known.passes, known.places, known.again, known.edits)
    found = _at_known_speed(LocatedDetection(first.detection, first.poses), known.speed, wanted)
    if further is not None:
        further = _at_known_speed(further, known.speed, wanted)
    return both_maps(outer, found, further)


def further_detection(
    first: FirstPass,
    passes: Passes,
    places: ProbePlaces,
    again: Detection | None,
    edits: BoundaryEdits,
) -> LocatedDetection | None:
    """Return the boundaries of further passes as detected, or as set by hand; None without any."""
    if not passes or again is None:
        return None
    edited = corrected(again, edits, "second", first.probe)
    return LocatedDetection(edited, joined_poses(places, passes), numbers_of(passes))


def both_maps(outer: OuterMaps, found: LocatedDetection, further: LocatedDetection | None) -> Maps:
    """Return the maps of both boundaries: the outer map, and the inner one of all passes."""
    values = outer, found.detection, found.Ts_base_probe, further
    return MAPS.get(values, lambda: add_inner_map(outer, found, further))


def _at_known_speed(
    found: LocatedDetection, speed: SpeedCalibration | None, wanted: float | None
) -> LocatedDetection:
    """Return a detection whose thickness is at the calibrated speed of sound, or the wanted one."""
    poses = found.Ts_base_probe
    known = with_known_speed(found.detection, poses, speed, wanted)
    return replace(found, detection=known)


def outer_maps(
    first: FirstPass, cell_mm: float, *, progress: Progress = silent, cancel: Cancel = never
) -> OuterMaps:
    """Return the outer boundary of the first pass, by ultrasound and together with the cloud."""

    def build() -> OuterMaps:
        return build_outer_maps(
            LocatedDetection(first.detection, first.poses),
            first.cloud.points_base,
            prior=first.prior,
            cell_mm=cell_mm,
            probe=first.probe,
            progress=progress,
            cancel=cancel,
        )

    values = first.detection, first.poses, first.cloud
    return OUTER_MAPS.get(values, build, (cell_mm, first.probe, first.prior))


def plan_tilts(
    known: TiltInputs, message: StartTiltPlan, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan, time and verify scans with the probe tilted, over the whole path or along given lines.

    Raises:
        InvalidInputError: a line leaves the outer map.
    """
    if message.rows:
        maps = maps_so_far(known, progress=progress, cancel=cancel)
        speed, painted = known.first.found.sound_speed_mm_per_us, known.painted or PaintedRegions()
        way = plan_along(maps, message.rows, speed, message.tilt_deg)
        require_none_avoided(painted, way.path.points_base)
        return plan_further_pass(known, way, progress=progress, cancel=cancel)
    ways = tilted_paths(known.searched.search.path, message)
    passes = [plan_further_pass(known, w, progress=progress, cancel=cancel) for w in ways]
    return replace(passes[0], following=tuple(passes[1:]))


def plan_tilts_again(
    known: TiltInputs, arguments: Arguments, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan again, with the passes that there were when it was planned."""
    n = len(known.passes) if known.planned is None else known.planned.n_before
    again = known.again if n == len(known.passes) else None
    before = replace(known, passes=known.passes[:n], again=again)
    message = message_from(StartTiltPlan.__name__, arguments)
    return plan_tilts(before, message, progress=progress, cancel=cancel)


def maps_so_far(known: TiltInputs, *, progress: Progress, cancel: Cancel) -> Maps:
    """Return the maps that a further pass is planned on: of all passes that were scanned.

    They are at the speed of sound that the boundaries were detected with: plans do not wait for a
    caliper.
    """
    first, asked, again = known.first, StartMapping(), known.again
    if known.passes and again is None:
        excitation = known.settings.excitation
        again = detect_again(
            first, known.passes, known.places, excitation, asked, progress=progress, cancel=cancel
        )
    further = further_detection(first, known.passes, known.places, again, known.edits)
    outer = outer_maps(first, asked.cell_mm)
    return both_maps(outer, LocatedDetection(first.detection, first.poses), further)


def plan_further_pass(
    known: TiltInputs, way: SecondPassPath, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Return a pass along a way, timed and verified for the robot.

    In the posture of the scan where there is a way: in another one the links of the robot err
    otherwise, so that what the passes find would not fit together.
    """
    scanned = ScanPostures(known.first.poses.translations, known.places.postures(known.scan).qs_rad)
    plan = plan_scan(
        way.path,
        robot_model(known.driven.robot),
        replace(plan_settings(known.driven, StartRollSearch()), preferred=scanned),
        progress=progress,
        cancel=cancel,
    )
    return SecondPass(way, plan, len(known.passes))
