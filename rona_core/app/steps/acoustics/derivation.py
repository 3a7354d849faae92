"""Compute speed of sound and delay line from their captures, and use them where they are known."""

from rona_core.app.steps.acoustics.inputs import LineInputs, SpeedInputs
from rona_core.app.steps.acoustics.messages import CalibrateDelayLine, CalibrateSoundSpeed
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import boundary_points
from rona_core.ultrasound.acoustic_calibration.delay_line import (
    DelayLine,
    calibrate_delay_line,
)
from rona_core.ultrasound.acoustic_calibration.reference_points import (
    at_speed,
    lags_at,
    speed_prior_for,
)
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    calibrate_speed,
    speed_at,
)
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, Detection
from rona_core.ultrasound.probe.probe_model import probe_model


def compare_with_caliper(known: SpeedInputs, message: CalibrateSoundSpeed) -> SpeedCalibration:
    """Compare the caliper with the time of flight at the reference points.

    Raises:
        InvalidInputError: a point without a sure A-scan near it, or values that no bone has.
    """
    references, detection = known.references, known.detection
    places, entries = references.places_base, boundary_points(detection, known.poses)[0]
    lag_us, sigma_us = lags_at(places, entries, detection)
    return calibrate_speed(
        references.thickness_mm,
        lag_us,
        thickness_sigma_mm=references.sigma_mm,
        lag_sigma_us=sigma_us,
        positions_mm=places,
        region_mm=entries[detection.inner_ok],
        prior=speed_prior_for(detection, known.probe.centre_mhz),
    )


def find_line_delay(known: LineInputs, message: CalibrateDelayLine) -> DelayLine:
    """Find the delay of the line in the A-scans on the block."""
    block, probe = known.block, known.probe
    temperatures = [float(value) for value in block.temperatures_c]
    return calibrate_delay_line(
        block.tracks, temperatures, probe_model(probe), probe.excitation, film_mm=message.film_mm
    )


def first_speed(wanted: float | None) -> float:
    """Return the speed that echoes are looked for with: as wanted, else the published one."""
    return NOMINAL_SPEED_MM_PER_US if wanted is None else wanted


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
