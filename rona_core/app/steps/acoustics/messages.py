"""Messages about the speed of sound, the delay line, and what other probes would do."""

from rona_core.app.messages.message import Point, message, within
from rona_core.devices.limits import ROW, limited, range_of, require
from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.settings import Excitation, ProbeSettings
from rona_core.session.specimen import BoneKind

MAX_POINTS = 50
CALIPER_MM = (0.01, 2.0)  # standard deviation
MAX_CELLS = 400
AXIS = {"minItems": 1, "maxItems": 20, "rule": f"at most {MAX_CELLS} combinations"}


@message
class AddReferencePoint:
    """Say how thick the bone is at a place, along the probe's axis there; for the speed of sound.

    The place is that of an A-scan of the scan, by its number from 0, or a point in base.
    """

    thickness_mm: float = within(0.5, 30.0)
    scan: int | None = limited(None, **ROW, rule="give either `scan` or `place_base_mm`")
    place_base_mm: Point | None = within(-1e4, 1e4, default=None)  # of the robot base
    sigma_mm: float = within(*CALIPER_MM, default=0.1)

    def __post_init__(self) -> None:
        require(
            (self.scan is None) != (self.place_base_mm is None),
            "say either which A-scan (scan) or where (place_base_mm)",
        )


@message
class RemoveReferencePoint:
    """Forget a reference point, by its number from 0; without a number, forget all."""

    index: int | None = limited(None, **ROW)


@message
class CalibrateSoundSpeed:
    """Compute the speed of sound in the bone, and how it varies, from the reference points."""


@message
class CalibrateDelayLine:
    """Compute the delay of the probe's line from the A-scans taken on the block.

    ``film_mm`` is gel between line and block that lifts the line, taken off. Without ``use`` an
    earlier calibration is forgotten: detection takes the nominal line again.
    """

    # a line that is pressed on gives way by the film that remains
    film_mm: float = within(0.0, 2.0, default=0.0)
    use: bool = True


@message
class StartCaliperMeasurements:
    """Measure the thickness at some places with a caliper; then calibrate the speed of sound.

    The places are those that the program proposes: thick, sure of their echo, and far apart. With
    ``append`` the points there are stay, and the places are those that add most to them.
    """

    n: int = within(1, 20, default=3)
    append: bool = False


@message
class StartDelayLineCapture:
    """Hold the probe on a flat block of steel and record A-scans; then calibrate its delay line.

    Without temperatures it is done at the one that the line has now. Several of them tell how the
    delay changes with it.
    """

    n: int = within(3, 200, default=20)
    temperatures_c: tuple[float, ...] = within(
        *range_of(ProbeSettings, "line_temperature_c"), default=(), maxItems=8
    )


@message
class StartProbeSweep:
    """Try probes, excitations and noise levels on virtual plates of bone of some thicknesses.

    Nothing of the specimen goes into it. Every combination is a cell of ``n`` A-scans.
    """

    probes: tuple[str, ...] = limited(tuple(PROBE_DATA), enum=tuple(PROBE_DATA), **AXIS)
    excitations: tuple[Excitation, ...] = limited(("pulse", "chirp"), **AXIS)
    snr_db: tuple[float, ...] = within(0.0, 90.0, default=(30.0, 50.0), **AXIS)
    thickness_mm: tuple[float, ...] = within(1.0, 16.0, default=(3.0, 5.0, 8.0, 11.0), **AXIS)
    bone: BoneKind = "normal"
    n: int = within(5, 400, default=40)

    def __post_init__(self) -> None:
        cells = len(self.probes) * len(self.excitations) * len(self.snr_db)
        cells *= len(self.thickness_mm)
        require(cells <= MAX_CELLS, f"{cells} cells are too many: at most {MAX_CELLS}")
