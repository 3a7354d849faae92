"""How late the samples of the tracker are, as the tool motion tells; and what is done about it."""

from rona_core.calibration.timing.time_offset import TimeOffset, estimate_time_offset
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.session.captures import ToolCapture

TOLD_SIGMAS = 3.0  # a delay smaller than this cannot be told from none, and is not corrected


def tracker_delay(capture: ToolCapture, model: RobotModel) -> TimeOffset | None:
    """Return how late the tracker is behind the robot; None where the motion does not tell.

    The robot's way of the tool marker is compared with the tracker's, each in its own frame.
    """
    Ts_base_toolmarker = model.forward(capture.joints.qs_rad) @ model.T_flange_toolmarker
    track = capture.marker
    try:
        return estimate_time_offset(
            capture.joints.times_s,
            Ts_base_toolmarker.translations,
            track.times_s,
            track.Ts_tracker_marker.translations,
        )
    except (InvalidInputError, DegenerateGeometryError):
        return None


def measured_times_s(capture: ToolCapture, model: RobotModel) -> Floats:
    """Return when the tracker measured each sample (k,) of its track, by the robot's clock."""
    delay, arrived_s = tracker_delay(capture, model), capture.marker.times_s
    if delay is None or abs(delay.offset_s) <= TOLD_SIGMAS * delay.sigma_s:
        return arrived_s
    return arrived_s - delay.offset_s


def delay_words(delay: TimeOffset) -> tuple[str, str]:
    """Return who is behind whom and by how much, as people read it; a delay is never negative."""
    sigma_ms = max(1e3 * delay.sigma_s, 0.1)
    if abs(delay.offset_s) <= TOLD_SIGMAS * delay.sigma_s:
        return "Robot-tracker latency", f"none, ± {sigma_ms:.1f} ms"
    words = f"{1e3 * abs(delay.offset_s):.1f} ± {sigma_ms:.1f} ms"
    late = "Tracker" if delay.offset_s > 0.0 else "Robot joint"
    return f"{late} latency (compensated)", words
