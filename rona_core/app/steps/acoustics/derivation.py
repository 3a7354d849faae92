"""Compute speed of sound and delay line from their captures, and use them where they are known."""

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.judge import usable
from rona_core.app.dependencies.staleness import capture_input, result_input, stale_reason
from rona_core.app.steps.acoustics.messages import CalibrateDelayLine, CalibrateSoundSpeed
from rona_core.app.steps.scan.derivation import (
    KNOWN_MOUNTING,
    PLACES_OF_ALL,
    SCAN,
    ProbePlaces,
    joined_poses,
    numbers_of,
)
from rona_core.app.steps.scan.inputs import ANY_PASSES, Passes
from rona_core.app.steps.setup.capture_parts import BLOCK_PROBE, HAND_PROBE, PROBE
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import LocatedDetection, boundary_points
from rona_core.mapping.echo_depths import echo_depths
from rona_core.session.captures import BlockCapture, ReferenceCapture, ScanCapture
from rona_core.session.memo import remember
from rona_core.ultrasound.acoustic_calibration.delay_line import (
    DelayLine,
    calibrate_delay_line,
    calibrated_probe,
)
from rona_core.ultrasound.acoustic_calibration.probe_mounting import ProbeMounting
from rona_core.ultrasound.acoustic_calibration.reference_points import (
    EchoDepths,
    at_speed,
    lags_at,
    speed_prior_for,
)
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    calibrate_speed,
    speed_at,
)
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model

BLOCK: Input[BlockCapture] = capture_input("block")
REFERENCES: Input[ReferenceCapture] = capture_input("references")
DETECTION: Input[Detection] = result_input("detection")
AGAIN: Input[Detection] = result_input("second_detection")
ANY_AGAIN: Input[Detection] = Input(
    lambda s: None if stale_reason("second_detection", s) else AGAIN.read(s),
    "detect the boundaries",
    optional=True,
    counts=AGAIN.read,
    part="second_detection",
)
KNOWN_LINE: Input[DelayLine] = Input(
    lambda s: usable("line", s), "calibrate the delay line (step 1)", optional=True, part="line"
)
KNOWN_SPEED: Input[SpeedCalibration] = Input(
    lambda s: usable("speed", s), "calibrate the speed (step 9)", optional=True, part="speed"
)


def probe_with_line(settings: ProbeSettings, line: DelayLine | None) -> ProbeModel:
    """Return the probe with its calibrated delay line, where there is one."""
    probe = probe_model(settings)
    return probe if line is None else calibrated_probe(probe, line, settings.line_temperature_c)


def probe_at_robot(
    settings: ProbeSettings, line: DelayLine | None, mounting: ProbeMounting | None
) -> ProbeModel:
    """Return the probe at the robot: the delay by the gauge plate counts before that by the block.

    It was measured with the line as warm as it is in the scan.
    """
    if mounting is None:
        return probe_with_line(settings, line)
    return probe_model(settings).with_line_delay(mounting.line_delay_us)


HELD_PROBE: Quantity[ProbeModel] = Quantity(
    probe_with_line, {"probe": HAND_PROBE, "line": KNOWN_LINE}
)
ROBOT_PROBE: Quantity[ProbeModel] = Quantity(
    probe_at_robot, {"probe": PROBE, "line": KNOWN_LINE, "mounting": KNOWN_MOUNTING}
)


@inputs()
class LineInputs:
    """What the delay line is calibrated from."""

    block: BlockCapture = given(BLOCK, "block")
    probe: ProbeSettings = given(BLOCK_PROBE, "probe")


@remember(2)  # step 9 shows the places for a caliper whenever anything changes
def _depths(
    first: Detection, poses: Poses, again: Detection, passes: Passes, further: Poses
) -> EchoDepths:
    tilted = LocatedDetection(again, further, numbers_of(passes))
    return echo_depths(LocatedDetection(first, poses), tilted)


@remember(2)
def _depths_of_one(first: Detection, poses: Poses) -> EchoDepths:
    return echo_depths(LocatedDetection(first, poses))


def _echo_depths(
    first: Detection,
    scan: ScanCapture,
    places: ProbePlaces,
    passes: Passes,
    again: Detection | None,
) -> EchoDepths:
    poses = places.poses(scan)
    if not passes or again is None:
        return _depths_of_one(first, poses)
    return _depths(first, poses, again, passes, joined_poses(places, passes))


ECHO_DEPTHS: Quantity[EchoDepths] = Quantity(
    _echo_depths,
    {
        "detection": DETECTION,
        "capture": SCAN,
        "places": PLACES_OF_ALL,
        "second": ANY_PASSES,
        "second_detection": ANY_AGAIN,
    },
)


@inputs(implied=("probe", "line", "mounting", "head"))
class SpeedInputs:
    """What the speed of sound is calibrated from."""

    references: ReferenceCapture = given(REFERENCES, "references")
    depths: EchoDepths = given(ECHO_DEPTHS)
    probe: ProbeModel = given(ROBOT_PROBE)


def compare_with_caliper(known: SpeedInputs, message: CalibrateSoundSpeed) -> SpeedCalibration:
    """Compare the caliper with the time of flight at the reference points.

    Raises:
        InvalidInputError: a point without a sure A-scan near it, or values that no bone has.
    """
    references, depths = known.references, known.depths
    places = references.places_base
    lag_us, sigma_us = lags_at(places, depths)
    return calibrate_speed(
        references.thickness_mm,
        lag_us,
        thickness_sigma_mm=references.sigma_mm,
        lag_sigma_us=sigma_us,
        positions_mm=places,
        region_mm=depths.places_base,
        prior=speed_prior_for(depths, known.probe.centre_mhz),
    )


def find_line_delay(known: LineInputs, message: CalibrateDelayLine) -> DelayLine:
    """Find the delay of the line in the A-scans on the block."""
    block, probe = known.block, known.probe
    temperatures = [float(value) for value in block.temperatures_c]
    return calibrate_delay_line(
        block.tracks, temperatures, probe_model(probe), probe.excitation, film_mm=message.film_mm
    )


def with_known_speed(
    detection: Detection, poses: Poses, known: SpeedCalibration | None, wanted: float | None
) -> Detection:
    """Return the detection at the speed of each place, if it is calibrated and none was wanted.

    Args:
        detection: What was found at one speed for all.
        poses: Of the probe in ``base`` (n,).
        known: The calibration.
        wanted: A speed that is set by hand; it wins.
    """
    if known is None or wanted is not None or not len(detection):
        return detection
    places = boundary_points(detection, poses)[0]
    return at_speed(detection, speed_at(known, places)[0])


def require_point(detection: Detection, scan: int) -> None:
    """Raise InvalidInputError unless an A-scan has an inner boundary that can be trusted."""
    if scan >= len(detection):
        raise InvalidInputError(f"there are {len(detection)} A-scans, numbered from 0: {scan}")
    if not detection.inner_ok[scan]:
        raise InvalidInputError(
            f"A-scan {scan} shows no inner boundary that can be trusted: choose another"
        )
