"""Where the probe was at each A-scan, its mounting by a gauge plate, and the quick look."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.judge import usable
from rona_core.app.dependencies.references import HeadReference, HeadWatch, head_input
from rona_core.app.dependencies.staleness import capture_input
from rona_core.app.steps.scan.inputs import Passes
from rona_core.app.steps.scan.messages import CalibrateProbeMounting, StartQuickLook
from rona_core.app.steps.setup.capture_parts import BLOCK_PROBE, MODEL, PROBE
from rona_core.calibration.timing.robot_latency import PoseDelay
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.pose import Poses
from rona_core.mapping.probe_poses import ProbePostures, face_poses, pose_delay, probe_postures
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import ScanCapture
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.probe_mounting import (
    ProbeMounting,
    calibrate_mounting,
)
from rona_core.ultrasound.detection.probe_choice import QuickLook, compare
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model

SCAN: Input[ScanCapture] = capture_input("scan")
KNOWN_MOUNTING: Input[ProbeMounting] = Input(
    lambda s: usable("mounting", s),
    "calibrate the mounting (step 8)",
    optional=True,
    part="mounting",
)
HEAD, HEAD_OF_ALL = head_input("scan"), head_input("scan", "second")


@remember(2)  # captures never change, and several views ask
def _delay(capture: ScanCapture, robot: str, probe: ProbeSettings) -> PoseDelay | None:
    if capture.clock_scans is None:
        return None
    model, times_s = robot_model(robot), capture.scans.times_s
    return pose_delay(capture.joints, capture.clock_scans, times_s, model, probe)


@remember(16)
def _postures(capture: ScanCapture, delay_s: float) -> ProbePostures:
    return probe_postures(capture.joints, capture.scans.times_s, delay_s)


@remember(16)  # all scans; what is made of one set of poses is remembered with them
def _poses(
    capture: ScanCapture, delay_s: float, robot: str, offset_mm: float, watch: HeadWatch | None
) -> Poses:
    back = None if watch is None else watch.back(capture.scans.times_s)
    qs_rad = _postures(capture, delay_s).qs_rad
    return face_poses(qs_rad, robot_model(robot), offset_mm, back)


@dataclass(frozen=True, slots=True, eq=False)
class ProbePlaces:
    """Where the probe was in every pass over the bone.

    The face is where the gauge plate found it, or else where it should be. Where the head has moved
    since step 4, the poses are corrected for it. Joint angles are looked up later by the
    delay of the first scan: in further ones the probe leans, and echoes of the approach are weak.
    """

    delay_s: float
    robot: str
    offset_mm: float
    head: HeadReference

    def poses(self, capture: ScanCapture) -> Poses:
        """Return the pose of the probe in ``base`` at each A-scan of a pass."""
        watch = self.head.watch(capture)
        return _poses(capture, self.delay_s, self.robot, self.offset_mm, watch)

    def postures(self, capture: ScanCapture) -> ProbePostures:
        """Return the joint angles at each A-scan of a pass."""
        return _postures(capture, self.delay_s)


def _places(
    delay: PoseDelay | None, robot: str, mounting: ProbeMounting | None, head: HeadReference
) -> ProbePlaces:
    delay_s = 0.0 if delay is None else delay.delay_s
    return ProbePlaces(delay_s, robot, 0.0 if mounting is None else mounting.offset_mm, head)


def _first_poses(capture: ScanCapture, places: ProbePlaces) -> Poses:
    return places.poses(capture)


def _places_of(head: Input[HeadReference]) -> Quantity[ProbePlaces]:
    parts = {"delay": DELAY, "robot": MODEL, "mounting": KNOWN_MOUNTING, "head": head}
    return Quantity(_places, parts)


DELAY: Quantity[PoseDelay] = Quantity(
    _delay, {"capture": SCAN, "robot": MODEL, "probe": PROBE}, optional=True
)
PLACES, PLACES_OF_ALL = _places_of(HEAD), _places_of(HEAD_OF_ALL)
POSES: Quantity[Poses] = Quantity(_first_poses, {"capture": SCAN, "places": PLACES})


def numbers_of(passes: Passes) -> Ints:
    """Return the number of the pass of each A-scan, from 0, one pass after the other."""
    return np.repeat(np.arange(len(passes)), [len(one.scans) for one in passes])


@remember(4)  # what is made of the A-scans is remembered by their identity
def joined_scans(passes: Passes) -> AScanTrack:
    """Return the A-scans of at least one pass, one pass after the other."""
    return AScanTrack.joined([one.scans for one in passes])


def joined_poses(places: ProbePlaces, passes: Passes) -> Poses:
    """Return the pose of the probe in ``base`` at each A-scan of at least one pass.

    Each pass has its own joint angles, clock and motion of the head.
    """
    return _joined(tuple(places.poses(one) for one in passes))


@remember(4)
def _joined(parts: tuple[Poses, ...]) -> Poses:
    return Poses.joined(parts)


@dataclass(frozen=True, slots=True, eq=False)
class GaugeCapture:
    """The probe in its holder, pressed by a gauge plate: a track for each depth."""

    ordinal: int
    setup_digest: str
    tracks: tuple[AScanTrack, ...]
    depths_mm: Floats  # (k,)
    sigma_mm: float  # of the depths, as the gauge's maker states it
    partial: bool = False


GAUGE: Input[GaugeCapture] = capture_input("gauge")


@inputs()
class MountingInputs:
    """What the mounting of the probe is calibrated from."""

    gauge: GaugeCapture = given(GAUGE, "gauge")
    probe: ProbeSettings = given(BLOCK_PROBE, "probe")


def find_mounting(known: MountingInputs, message: CalibrateProbeMounting) -> ProbeMounting:
    """Find where the face of the probe is, and how fast its line, from the A-scans on the gauge."""
    held, probe = known.gauge, known.probe
    return calibrate_mounting(
        held.tracks, held.depths_mm, held.sigma_mm, probe_model(probe), probe.excitation
    )


@dataclass(frozen=True, slots=True, eq=False)
class LookCapture:
    """A-scans of each probe along the same short lines (l), upright first, then tilted (k looks).

    Places are on the bone, axes point into it; ``tracks`` has those of the first probe first.
    """

    ordinal: int
    setup_digest: str
    probes: tuple[ProbeSettings, ...]
    tracks: tuple[AScanTrack, ...]  # of each probe and look, n A-scans each
    places_base: Floats  # (n, 3), line after line
    axes_base: Floats  # (k, n, 3)
    lines: int
    depth_mm: float  # by which the line of the probe is pressed in
    partial: bool = False


LOOKS: Input[LookCapture] = capture_input("looks")


@inputs()
class LookInputs:
    """What the probes are compared by."""

    looks: LookCapture = given(LOOKS, "quick look")


def compare_probes(
    known: LookInputs, message: StartQuickLook, *, progress: Progress, cancel: Cancel
) -> QuickLook:
    """Return what a scan with each probe is expected to cover.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    held = known.looks
    looks = len(held.axes_base)
    standoff_mm = np.full(len(held.places_base), -held.depth_mm)
    probes: list[list[ProbeSurvey]] = []
    for number, probe in enumerate(held.probes):
        tracks = held.tracks[number * looks : (number + 1) * looks]
        surveys = [
            ProbeSurvey(
                track,
                probe_model(probe),
                probe.excitation,
                positions_mm=held.places_base,
                axes=axes,
                known_standoff_mm=standoff_mm,
            )
            for track, axes in zip(tracks, held.axes_base, strict=True)
        ]
        probes.append(surveys)
    return compare(probes, held.lines, progress=progress, cancel=cancel)
