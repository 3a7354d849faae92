"""Messages about the speed of sound, the delay line, and what other probes would do."""

from dataclasses import MISSING
from typing import Any

from rona_core.app.messages.message import Point, message
from rona_core.devices.limits import ROW, like, limited, number, range_of, require, switch
from rona_core.devices.probes import PROBE_DATA
from rona_core.devices.settings import Excitation, ProbeSettings
from rona_core.session.specimen import BoneChoice, BoneKind

MAX_POINTS = 50
MAX_CELLS = 400
PLACES = "`scan` or `place_base_mm`"
AXIS: dict[str, Any] = {"minItems": 1, "maxItems": 20, "rule": f"at most {MAX_CELLS} combinations"}


@message
class AddReferencePoint:
    """Say how thick the bone is at a place, along the probe's axis there; for the speed of sound.

    The place is that of an A-scan of the scan, by its number from 0, or a point in base.
    """

    thickness_mm: float = number(
        MISSING, "Thickness", "mm", 0.5, 30.0, 0.05, hint="Of the bone, by a caliper"
    )
    scan: int | None = number(
        None, "A-scan no.", "", *ROW, 1, hint="At the measured place", rule=f"Give either {PLACES}"
    )
    place_base_mm: Point | None = number(
        None, "Place", "mm", -1e4, 1e4, 1.0, hint="In the robot base", rule=f"Give either {PLACES}"
    )
    sigma_mm: float = number(
        0.1, "Caliper error", "mm", 0.01, 2.0, 0.01, hint="Standard deviation of the thickness"
    )

    def __post_init__(self) -> None:
        require(
            (self.scan is None) != (self.place_base_mm is None),
            "say either which A-scan (scan) or where (place_base_mm)",
        )


@message
class RemoveReferencePoint:
    """Forget a reference point, by its number from 0; without a number, forget all."""

    index: int | None = number(None, "Point no.", "", *ROW, 1, hint="From 0; null: all points")


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
    film_mm: float = number(0.0, "Gel film", "mm", 0.0, 2.0, 0.01, hint="Between line and block")
    use: bool = switch(True, "Use the calibration", "Off: the nominal line")


@message
class StartCaliperMeasurements:
    """Measure the thickness at some places with a caliper; then calibrate the speed of sound.

    The places are those that the program proposes: thick, sure of their echo, and far apart. With
    ``append`` the points there are stay, and the places are those that add most to them.
    """

    n: int = number(3, "Number of points", "", 1, 20, 1, hint="At places chosen by the program")
    append: bool = switch(False, "Append", "Adds to the reference points there are")


@message
class StartDelayLineCapture:
    """Hold the probe on a flat block of steel and record A-scans; then calibrate its delay line.

    Without temperatures it is done at the one that the line has now. Several of them tell how the
    delay changes with it.
    """

    n: int = number(20, "Number of A-scans", "", 3, 200, 1, hint="On the block")
    temperatures_c: tuple[float, ...] = number(
        (),
        "Line temperatures",
        "°C",
        *range_of(ProbeSettings, "line_temperature_c"),
        1.0,
        hint="None: the present one",
        maxItems=8,
    )


@message
class StartProbeSweep:
    """Try probes, excitations and noise levels on virtual plates of bone of some thicknesses.

    Nothing of the specimen goes into it. Every combination is a cell of ``n`` A-scans.
    """

    probes: tuple[str, ...] = limited(tuple(PROBE_DATA), enum=tuple(PROBE_DATA), **AXIS)
    excitations: tuple[Excitation, ...] = limited(("pulse", "chirp"), **AXIS)
    snr_db: tuple[float, ...] = number((30.0, 50.0), "SNR", "dB", 0.0, 90.0, 1.0, **AXIS)
    thickness_mm: tuple[float, ...] = number(
        (3.0, 5.0, 8.0, 11.0), "Thickness", "mm", 1.0, 16.0, 0.5, **AXIS
    )
    bone: BoneKind = like(BoneChoice, "kind")
    n: int = number(40, "Number of A-scans", "", 5, 400, 1, hint="In each combination")

    def __post_init__(self) -> None:
        cells = len(self.probes) * len(self.excitations) * len(self.snr_db)
        cells *= len(self.thickness_mm)
        require(cells <= MAX_CELLS, f"{cells} cells are too many: at most {MAX_CELLS}")
