"""Compute speed of sound and delay line from their captures, and use them where they are known."""

from rona_core.app.declarations.declarations import Input
from rona_core.app.dependencies.inputs import require_result
from rona_core.app.dependencies.judge import usable
from rona_core.app.steps.acoustics.messages import CalibrateDelayLine, CalibrateSoundSpeed
from rona_core.app.steps.scan.probe_mounting import known_mounting
from rona_core.app.steps.scan.probe_poses import probe_poses_of
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.mapping.build_maps import boundary_points
from rona_core.session.document import Session
from rona_core.ultrasound.acoustic_calibration.delay_line import (
    DelayLine,
    calibrate_delay_line,
    calibrated_probe,
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
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model


def derive_speed(session: Session, message: CalibrateSoundSpeed) -> SpeedCalibration:
    """Compare the caliper with the time of flight at the reference points.

    Raises:
        InvalidInputError: a point without a sure A-scan near it, or values that no bone has.
    """
    references = require_result(session.captures.references, "measure reference points (step 9)")
    detection = require_result(session.results.detection, "detect the boundaries (step 9)").value
    places, entries = references.places_base, entry_points(session, detection)
    lag_us, sigma_us = lags_at(places, entries, detection)
    return calibrate_speed(
        references.thickness_mm,
        lag_us,
        thickness_sigma_mm=references.sigma_mm,
        lag_sigma_us=sigma_us,
        positions_mm=places,
        region_mm=entries[detection.inner_ok],
        prior=speed_prior_for(detection, robot_probe(session).centre_mhz),
    )


def entry_points(session: Session, detection: Detection) -> Floats:
    """Return where the probe's axis enters the bone (n, 3) at each A-scan, in ``base``."""
    return boundary_points(detection, require_result(probe_poses_of(session), "scan"))[0]


def derive_line(session: Session, message: CalibrateDelayLine) -> DelayLine:
    """Find the delay of the line in the A-scans on the block."""
    block = require_result(session.captures.block, "take A-scans on the block (step 1)")
    probe = session.setup.devices.probe
    temperatures = [float(value) for value in block.temperatures_c]
    return calibrate_delay_line(
        block.tracks, temperatures, probe_model(probe), probe.excitation, film_mm=message.film_mm
    )


def session_probe(session: Session) -> ProbeModel:
    """Return the probe as it is known: with its calibrated delay line, where there is one."""
    settings = session.setup.devices.probe
    probe, line = probe_model(settings), usable_line(session)
    if line is None:
        return probe
    return calibrated_probe(probe, line, settings.line_temperature_c)


def robot_probe(session: Session) -> ProbeModel:
    """Return the probe at the robot: what the gauge plate said of its line comes before the block.

    It was asked as warm as the line is in the scan.
    """
    mounting = known_mounting(session)
    if mounting is None:
        return session_probe(session)
    return probe_model(session.setup.devices.probe).with_line_delay(mounting.line_delay_us)


def first_speed(wanted: float | None) -> float:
    """Return the speed that echoes are looked for with: as wanted, else the published one."""
    return NOMINAL_SPEED_MM_PER_US if wanted is None else wanted


def with_known_speed(
    detection: Detection, poses: Poses, session: Session, wanted: float | None
) -> Detection:
    """Return the detection at the speed of each place, if it is calibrated and none was wanted.

    Args:
        detection: What was found at one speed for all.
        poses: Of the probe in ``base`` (n,).
        session: Holds the calibration.
        wanted: A speed that was asked for in words; it wins.
    """
    known = usable_speed(session)
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


def usable_line(session: Session) -> DelayLine | None:
    """Return the calibrated delay line, unless it is stale or bad."""
    return usable("line", session)


def usable_speed(session: Session) -> SpeedCalibration | None:
    """Return the calibrated speed of sound, unless it is stale or bad."""
    return usable("speed", session)


KNOWN_LINE = Input(usable_line, "calibrate the delay line (step 1)", optional=True)
KNOWN_SPEED = Input(usable_speed, "calibrate the speed (step 9)", optional=True)
