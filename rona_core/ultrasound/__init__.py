"""A-mode ultrasound: probe, echo model, and detection of the skull boundaries."""

from rona_core.ultrasound.acoustic_calibration.delay_line import calibrate_delay_line
from rona_core.ultrasound.acoustic_calibration.speed_calibration import calibrate_speed
from rona_core.ultrasound.detection.detect import Detection, detect
from rona_core.ultrasound.probe.probe_model import probe_model
from rona_core.ultrasound.recorded.plate_detector import detect_recorded

__all__ = [
    "Detection",
    "calibrate_delay_line",
    "calibrate_speed",
    "detect",
    "detect_recorded",
    "probe_model",
]
