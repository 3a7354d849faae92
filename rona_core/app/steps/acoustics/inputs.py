"""Inputs that results take from calibrations of sound: speed of sound, delay line, the probe."""

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.judge import usable
from rona_core.app.dependencies.staleness import capture_input, result_input
from rona_core.app.steps.scan.inputs import KNOWN_MOUNTING, POSES
from rona_core.app.steps.setup.inputs import BLOCK_PROBE, HAND_PROBE, PROBE
from rona_core.devices.settings import ProbeSettings
from rona_core.geometry.pose import Poses
from rona_core.session.captures import BlockCapture, ReferenceCapture
from rona_core.ultrasound.acoustic_calibration.delay_line import DelayLine, calibrated_probe
from rona_core.ultrasound.acoustic_calibration.probe_mounting import ProbeMounting
from rona_core.ultrasound.acoustic_calibration.speed_calibration import SpeedCalibration
from rona_core.ultrasound.detection.detect import Detection
from rona_core.ultrasound.probe.probe_model import ProbeModel, probe_model

BLOCK: Input[BlockCapture] = capture_input("block")
REFERENCES: Input[ReferenceCapture] = capture_input("references")
DETECTION: Input[Detection] = result_input("detection")
KNOWN_LINE: Input[DelayLine] = Input(
    lambda s: usable("line", s), "calibrate the delay line (step 1)", optional=True
)
KNOWN_SPEED: Input[SpeedCalibration] = Input(
    lambda s: usable("speed", s), "calibrate the speed (step 9)", optional=True
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


@inputs(implied=("probe", "line", "mounting", "head"))
class SpeedInputs:
    """What the speed of sound is calibrated from."""

    references: ReferenceCapture = given(REFERENCES, "references")
    detection: Detection = given(DETECTION, "detection")
    poses: Poses = given(POSES)
    probe: ProbeModel = given(ROBOT_PROBE)
