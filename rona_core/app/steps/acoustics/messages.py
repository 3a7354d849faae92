"""Messages about the speed of sound, the delay line, and what other probes would do."""

from typing import Annotated

from rona_core.app.messages.lengths import Length
from rona_core.app.messages.message import Point, message, within
from rona_core.devices.settings import PROBE_LIMITS, Excitation, ProbeName, require
from rona_core.session.specimen import BoneKind

MAX_POINTS = 50
CALIPER_MM = (0.01, 2.0)  # standard deviation
MAX_CELLS = 400
MAX_TEMPERATURES = 8


@message
class AddReferencePoint:
    """Say how thick the bone is at a place, along the probe's axis there; for the speed of sound.

    The place is that of an A-scan of the scan, by its number from 0, or a point in base.
    """

    thickness_mm: float = within(0.5, 30.0)
    scan: int | None = None
    place_base_mm: Point | None = None
    sigma_mm: float = within(*CALIPER_MM, default=0.1)

    def __post_init__(self) -> None:
        require(
            (self.scan is None) != (self.place_base_mm is None),
            "say either which A-scan (scan) or where (place_base_mm)",
        )
        require(self.scan is None or self.scan >= 0, "A-scans are numbered from 0")


@message
class RemoveReferencePoint:
    """Forget a reference point, by its number from 0; without a number, forget all."""

    index: int | None = None

    def __post_init__(self) -> None:
        require(self.index is None or self.index >= 0, "reference points are numbered from 0")


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
    temperatures_c: Annotated[tuple[float, ...], Length(0, MAX_TEMPERATURES)] = within(
        *PROBE_LIMITS["line_temperature_c"], default=()
    )

    def __post_init__(self) -> None:
        count = len(self.temperatures_c)
        require(count <= MAX_TEMPERATURES, f"at most {MAX_TEMPERATURES} temperatures, please")


@message
class StartProbeSweep:
    """Try probes, excitations and noise levels on virtual plates of bone of some thicknesses.

    Nothing of the specimen goes into it. Every combination is a cell of ``n`` A-scans.
    """

    probes: Annotated[tuple[ProbeName, ...], Length(1, MAX_CELLS)] = ("2.25MHz", "1MHz")
    excitations: Annotated[tuple[Excitation, ...], Length(1, MAX_CELLS)] = ("pulse", "chirp")
    snr_db: Annotated[tuple[float, ...], Length(1, MAX_CELLS)] = within(
        0.0, 90.0, default=(30.0, 50.0)
    )
    thickness_mm: Annotated[tuple[float, ...], Length(1, MAX_CELLS)] = within(
        1.0, 16.0, default=(3.0, 5.0, 8.0, 11.0)
    )
    bone: BoneKind = "normal"
    n: int = within(5, 400, default=40)

    def __post_init__(self) -> None:
        axes = (self.probes, self.excitations, self.snr_db, self.thickness_mm)
        require(all(len(axis) for axis in axes), "each axis of the sweep needs a value")
        cells = len(self.probes) * len(self.excitations) * len(self.snr_db)
        cells *= len(self.thickness_mm)
        require(cells <= MAX_CELLS, f"{cells} cells are too many: at most {MAX_CELLS}")
