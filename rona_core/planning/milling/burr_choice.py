"""The burr that a bed is milled with: the largest ball that goes into it, or the one asked for."""

from rona_core.errors import InvalidInputError
from rona_core.planning.implants.implant import Implant
from rona_core.planning.milling.burr import ball
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.milling.settings import BALL_2, MillingSettings

BURRS_MM = (5.0, 4.0, 3.0, 2.0)  # balls, the largest that goes into the bed is taken


def milling_settings(implant: Implant, burr_mm: float | None) -> MillingSettings:
    """Return how a bed is milled: with a ball of this diameter, else the largest that goes in.

    Raises:
        InvalidInputError: no burr goes into the bed.
    """
    *larger, last = BURRS_MM if burr_mm is None else (burr_mm,)
    for size_mm in larger:
        try:
            return _settings(implant, size_mm)
        except InvalidInputError:
            continue  # a smaller one may go in
    return _settings(implant, last)


def _settings(implant: Implant, burr_mm: float) -> MillingSettings:
    """Return how a bed is milled with a ball; raise InvalidInputError where it does not go in."""
    settings = MillingSettings(
        burr=ball(burr_mm),
        rim_burr=BALL_2 if burr_mm > BALL_2.diameter_mm else None,
        layer_mm=min(0.5, 0.25 * burr_mm),
    )
    planned_bed(implant, settings, cell_mm=1.0)
    return settings
