"""Boundary detection and maps, and the plan of a second pass over the gaps."""

from dataclasses import dataclass

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.staleness import input_digests, stale_reason
from rona_core.app.messages.serialization import serialize_arguments
from rona_core.app.steps.acoustics.derivation import first_speed, session_probe, with_known_speed
from rona_core.app.steps.maps.messages import StartGapPlan, StartMapping
from rona_core.app.steps.roll.derivation import plan_settings
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.probe_poses import probe_poses_of
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.errors import StepBlockedError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.build_maps import LocatedDetection, build_maps
from rona_core.mapping.second_pass import plan_second_pass, standoffs_mm
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_scan import plan_scan
from rona_core.session.captures import ScanCapture
from rona_core.session.document import Derived, SecondPass, Session
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.detection.manual_corrections import corrected
from rona_core.ultrasound.probe.probe_model import ProbeSurvey


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """A-scans (n), and where the probe was at each of them, in any frame that stands still."""

    scans: AScanTrack
    poses: Poses  # (n,) of the probe
    known_standoff_mm: Floats | None = None  # (n,) to the outer boundary, see ``ProbeSurvey``


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
            session_probe(session),
            session.setup.devices.probe.excitation,
            positions_mm=survey.poses.translations,
            axes=survey.poses.rotations[:, :, 2],
            known_standoff_mm=survey.known_standoff_mm,
        ),
        method=message.method,
        sound_speed_mm_per_us=first_speed(message.sound_speed_mm_per_us),
        progress=progress,
        cancel=cancel,
    )


def derive_detection(
    session: Session, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find both boundaries in every A-scan, with those around it as witnesses."""
    survey = Survey(require_result(session.captures.scan, "scan").scans, probe_poses(session))
    return detect_survey(session, survey, message, progress=progress, cancel=cancel)


def probe_poses(session: Session, capture: ScanCapture | None = None) -> Poses:
    """Return the pose of the probe in ``base`` at each A-scan, from the robot's joint angles.

    Without a capture it is that of the first pass.
    """
    return require_result(probe_poses_of(session, capture), "scan")


def derive_maps(
    session: Session,
    message: StartMapping,
    *,
    first_only: bool = False,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Maps:
    """Map both boundaries and fuse the outer one with the pointer cloud.

    What the second pass found is mapped as well, and thickness is at the calibrated speed of sound
    where there is one, unless ``first_only``: plans do not wait for a caliper. Boundaries that were
    set by hand take the place of those that were found.
    """
    edits, probe = session.boundary_edits, session_probe(session)
    cloud = require_result(session.results.surface, "sample the surface").value
    detection = require_result(session.results.detection, "detect the boundaries").value
    detection = corrected(detection, edits, "first", probe)
    capture, again = usable_second(session), session.results.second_detection
    second = None
    poses, wanted = probe_poses(session), message.sound_speed_mm_per_us
    if not first_only:
        detection = with_known_speed(detection, poses, session, wanted)
    if not first_only and capture is not None and again is not None:
        second_poses = probe_poses(session, capture)
        edited = corrected(again.value, edits, "second", probe)
        edited = with_known_speed(edited, second_poses, session, wanted)
        second = LocatedDetection(edited, second_poses)
    return build_maps(
        LocatedDetection(detection, poses),
        cloud.points_base,
        second=second,
        cell_mm=message.cell_mm,
        probe=probe,
        progress=progress,
        cancel=cancel,
    )


def derive_second(
    session: Session, message: StartGapPlan, *, progress: Progress, cancel: Cancel
) -> SecondPass:
    """Plan, time and verify a scan of the gaps that the first pass left in the inner map.

    Raises:
        StepBlockedError: there is no gap worth a scan.
    """
    detection = require_result(session.results.detection, "detect the boundaries").value
    way = plan_second_pass(
        derive_maps(session, StartMapping(), first_only=True),
        detection.sound_speed_mm_per_us,
        message,
    )
    if way is None:
        raise StepBlockedError(
            "StartGapPlan is blocked: the first pass left no gap in the inner map"
        )
    plan = plan_scan(
        way.path,
        robot_model(session.setup.devices.robot.model),
        plan_settings(session, StartRollSearch()),
        progress=progress,
        cancel=cancel,
    )
    return SecondPass(way, plan)


def derive_second_detection(
    session: Session, message: StartMapping, *, progress: Progress, cancel: Cancel
) -> Detection:
    """Find the inner boundary in the second pass; the outer one is where the first one saw it."""
    capture = require_result(usable_second(session), "scan the gaps again")
    outer = derive_maps(session, message, first_only=True).outer
    poses = probe_poses(session, capture)
    survey = Survey(capture.scans, poses, standoffs_mm(outer, poses))
    return detect_survey(session, survey, message, progress=progress, cancel=cancel)


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
    if usable_second(session) is None:
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


def usable_second(session: Session) -> ScanCapture | None:
    """Return the capture of the second pass, unless it is of another plan or set-up."""
    capture = session.captures.second
    return None if capture is None or stale_reason("capture second", session) else capture
