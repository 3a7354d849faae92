"""Boundary detection and maps, of the first pass and of further ones."""

from dataclasses import dataclass

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.messages.serialization import serialize_arguments
from rona_core.app.steps.acoustics.derivation import first_speed, robot_probe, with_known_speed
from rona_core.app.steps.maps.accuracy.probe_place import cloud_prior
from rona_core.app.steps.maps.further_passes import (
    joined_poses,
    joined_scans,
    usable_second,
)
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.probe_poses import probe_poses_of
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build_maps import (
    LocatedDetection,
    OuterMaps,
    add_inner_map,
    build_outer_maps,
)
from rona_core.mapping.second_pass import (
    standoffs_mm,
)
from rona_core.session.document import Derived, Session
from rona_core.session.memo import Memo
from rona_core.ultrasound.detection.detect import Detection, detect, doubted, has_inner_echoes
from rona_core.ultrasound.detection.manual_corrections import corrected
from rona_core.ultrasound.probe.probe_model import ProbeModel, ProbeSurvey

OUTER_MAPS: Memo[OuterMaps] = Memo(2)  # maps, plan of a further pass and its detection share one
MAPS: Memo[Maps] = Memo(1)  # and the plan has the maps as they are where no speed is calibrated


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A-scans (n), and where the probe was at each of them, in any frame that stands still."""

    scans: AScanTrack
    poses: Poses  # (n,) of the probe
    probe: ProbeModel  # as far as it is known
    known_standoff_mm: Floats | None = None  # (n,) to the outer boundary, see ``ProbeSurvey``
    bone_loss: float | None = None  # over the nominal one; None: to be learned from these A-scans


def detect_survey(
    session: Session,
    survey: Survey,
    message: StartMapping,
    *,
    progress: Progress,
    cancel: Cancel,
) -> Detection:
    """Find both boundaries with all that the session knows of probe, line, speed and places.

    Raises:
        InvalidInputError: A-scans of another probe, or poses that are not finite.
        CancelledError: ``cancel`` said so.
    """
    return detect(
        ProbeSurvey(
            survey.scans,
            survey.probe,
            session.setup.devices.probe.excitation,
            positions_mm=survey.poses.translations,
            axes=survey.poses.rotations[:, :, 2],
            known_standoff_mm=survey.known_standoff_mm,
        ),
        method=message.method,
        sound_speed_mm_per_us=first_speed(message.sound_speed_mm_per_us),
        bone_loss=survey.bone_loss,
        progress=progress,
        cancel=cancel,
    )


def derive_detection(
    session: Session, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find both boundaries in every A-scan, with those around it as witnesses."""
    scans = require_result(session.captures.scan, "scan").scans
    survey = Survey(scans, probe_poses(session), robot_probe(session))
    return detect_survey(session, survey, message, progress=progress, cancel=cancel)


def probe_poses(session: Session) -> Poses:
    """Return the pose of the probe in ``base`` at each A-scan of the first pass."""
    return require_result(probe_poses_of(session), "scan")


def derive_maps(
    session: Session,
    message: StartMapping,
    *,
    calibrated: bool = True,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Maps:
    """Map both boundaries and fuse the outer one with the pointer cloud.

    What further passes found is mapped as well, and thickness is at the calibrated speed of sound
    where there is one, unless not ``calibrated``: plans do not wait for a caliper. Boundaries that
    were set by hand take the place of those that were found.
    """
    edits, probe = session.boundary_edits, robot_probe(session)
    detection, poses = _first_detection(session), probe_poses(session)
    outer = _outer_maps(session, message, progress=progress, cancel=cancel)
    passes, again = usable_second(session), session.results.second_detection
    further = None
    if passes and again is not None:
        edited = corrected(again.value, edits, "second", probe)
        further = LocatedDetection(edited, joined_poses(session, passes))
    first = LocatedDetection(detection, poses)
    if calibrated:
        first = _at_known_speed(first, session, message)
        further = None if further is None else _at_known_speed(further, session, message)
    values = outer, first.detection, poses, further
    return MAPS.get(values, lambda: add_inner_map(outer, first, further))


def _at_known_speed(
    found: LocatedDetection, session: Session, message: StartMapping
) -> LocatedDetection:
    """Return what was detected, its thickness at the speed of sound that is known or asked for."""
    wanted, poses = message.sound_speed_mm_per_us, found.Ts_base_probe
    return LocatedDetection(with_known_speed(found.detection, poses, session, wanted), poses)


def _first_detection(session: Session) -> Detection:
    """Return the boundaries of the first pass as detected, or as set by hand."""
    detection = require_result(session.results.detection, "detect the boundaries").value
    return corrected(detection, session.boundary_edits, "first", robot_probe(session))


def _outer_maps(
    session: Session, message: StartMapping, *, progress: Progress = silent, cancel: Cancel = never
) -> OuterMaps:
    """Return the outer boundary of the first pass, by ultrasound and together with the cloud."""
    cloud = require_result(session.results.surface, "sample the surface").value
    detection = _first_detection(session)
    probe, poses, prior = robot_probe(session), probe_poses(session), cloud_prior(session)

    def build() -> OuterMaps:
        return build_outer_maps(
            LocatedDetection(detection, poses),
            cloud.points_base,
            prior=prior,
            cell_mm=message.cell_mm,
            probe=probe,
            progress=progress,
            cancel=cancel,
        )

    return OUTER_MAPS.get((detection, poses, cloud), build, (message.cell_mm, probe, prior))


def maps_so_far(session: Session, *, progress: Progress = silent, cancel: Cancel = never) -> Maps:
    """Return the maps that a further pass is planned on: of all passes that were scanned.

    They are at the speed of sound that the boundaries were detected with, whatever a caliper says.
    """
    asked = StartMapping()
    if usable_second(session):
        held = session.results.second_detection
        if held is None or stale_reason("second_detection", session) is not None:
            again = derive_second_detection(session, asked, progress=progress, cancel=cancel)
            session = _with_result(session, "second_detection", again)
    return derive_maps(session, asked, calibrated=False)


def derive_second_detection(
    session: Session, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find the inner boundary in the further passes; the outer one is where the first one heard it.

    The bone is as lossy as the first pass found it. Bone in which that heard no inner boundary at
    all is not heard by a probe that leans: the few echoes of a further pass are steps within it.
    """
    passes = require_result(usable_second(session), "scan the gaps again")
    maps = _outer_maps(session, message)
    poses = joined_poses(session, passes)
    first = require_result(session.results.detection, "detect the boundaries").value
    survey = Survey(
        joined_scans(passes),
        poses,
        robot_probe(session),
        standoffs_mm(maps.outer, poses) + maps.late_mm,
        first.bone_loss,
    )
    found = detect_survey(session, survey, message, progress=progress, cancel=cancel)
    return found if has_inner_echoes(first) else doubted(found, found.inner_ok)


def derive_mapping(
    session: Session, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> dict[str, object]:
    """Return the results of step 9: the boundaries are detected, then mapped.

    Where only the maps are out of date, because boundaries were set by hand or the gaps scanned
    again, what was detected with the same settings is taken as it is.
    """

    def part(start: float, end: float) -> Progress:
        return lambda share: progress(start + (end - start) * share)

    kept = _kept("detection", session, message)
    again = _kept("second_detection", session, message)
    found = kept or derive_detection(session, message, progress=part(0.0, 0.5), cancel=cancel)
    session = _with_result(session, "detection", found)
    if not usable_second(session):
        again = None
    elif again is None:
        again = derive_second_detection(session, message, progress=part(0.5, 0.7), cancel=cancel)
    session = _with_result(session, "second_detection", again)
    maps = derive_maps(session, message, progress=part(0.7, 1.0), cancel=cancel)
    return {"detection": found, "second_detection": again, "maps": maps}


def _kept(name: str, session: Session, message: StartMapping) -> Detection | None:
    """Return a detection that need not be made again: one that is fresh beneath stale maps."""
    derived = session.results.get(name)
    if derived is None or stale_reason(name, session) is not None:
        return None
    if session.results.maps is not None and stale_reason("maps", session) is None:
        return None  # nothing has changed: somebody wants all of it anew
    wanted = serialize_arguments(message)
    same = all(derived.arguments.get(k) == v for k, v in wanted.items() if k != "cell_mm")
    return derived.value if same else None


def _with_result(session: Session, name: str, value: object) -> Session:
    """Return the session with a result that later parts of the same computation look up."""
    made = None
    if value is not None:  # with its inputs, so that what follows from it is known to be fresh
        made = Derived(value, StartMapping.__name__, {}, input_digests(name, session))
    return session.with_result(name, made)
