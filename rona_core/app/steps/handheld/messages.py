"""What can be asked of the SonoPointer: the ultrasound probe in the hand, tracked, no robot."""

from rona_core.app.messages.message import message, within
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.devices.limits import require

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

    cone_deg: float = within(1.0, 60.0, default=30.0)
    pivot_s: float = within(1.0, 120.0, default=15.0)
    half_turn_deg: float = within(1.0, 85.0, default=70.0)
    spin_s: float = within(1.0, 120.0, default=15.0)


@message
class StartHandheldScan:
    """Slide the SonoPointer over the region in lines by hand while it fires ``rate_hz`` times."""

    duration_s: float = within(5.0, 600.0, default=60.0, rule=SHOTS)
    spacing_mm: float = within(0.5, 10.0, default=2.0)
    rate_hz: float = within(1.0, 100.0, default=25.0, rule=SHOTS)

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
