"""What can be asked of the SonoPointer: the ultrasound probe in the hand, tracked, no robot."""

from rona_core.app.messages.message import message
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.devices.limits import like, number, require

MOST_SHOTS = 16_000  # of one scan by hand: some 60 MB
SHOTS = f"`duration_s` times `rate_hz` is at most {MOST_SHOTS}"


@message
class CalibrateHandheldProbe:
    """Find the face and the axis of the probe from its pivoting and its turning."""


@message
class StartHandheldCalibration:
    """Pivot the SonoPointer with a calibration point, turn it in a bush; then calibrate it.

    ``half_turn_deg`` is how far it turns either way; the tracker loses it beyond about 60 degrees.
    """

    cone_deg: float = like(StartPointerCapture, "cone_deg")
    pivot_s: float = number(15.0, "Pivoting", "s", 1.0, 120.0, 1.0, hint="Duration of the pivoting")
    half_turn_deg: float = number(
        70.0, "Half turn", "deg", 1.0, 85.0, 1.0, hint="Rotation about the axis, either way"
    )
    spin_s: float = number(15.0, "Turning", "s", 1.0, 120.0, 1.0, hint="Duration of the rotation")


@message
class StartHandheldScan:
    """Slide the SonoPointer over the region in lines by hand while it fires ``rate_hz`` times."""

    duration_s: float = number(
        60.0, "Duration", "s", 5.0, 600.0, 5.0, hint="Length of the recording", rule=SHOTS
    )
    spacing_mm: float = number(
        2.0, "Line spacing", "mm", 0.5, 10.0, 0.5, hint="Distance between two lines"
    )
    rate_hz: float = number(
        25.0, "Pulse rate", "Hz", 1.0, 100.0, 1.0, hint="A-scans in a second", rule=SHOTS
    )

    def __post_init__(self) -> None:
        require(
            self.duration_s * self.rate_hz <= MOST_SHOTS,
            f"duration_s times rate_hz must be at most {MOST_SHOTS} A-scans, "
            f"not {self.duration_s * self.rate_hz:.0f}",
        )


@message
class StartHandheldMapping(StartMapping):
    """Detect both boundaries in the A-scans of the hand-held probe, and map them.

    Without a speed of sound it is the calibrated one, if the maps are in base, else the published.
    """
