"""Timed motion of the burr, as the removal of bone along it needs it."""

from dataclasses import dataclass

from rona_core.geometry.arrays import Floats, Ints


@dataclass(frozen=True, slots=True, eq=False)
class MillingMotion:
    """Where the burr is at n times; between them its tip goes straight and its axis evenly."""

    times_s: Floats  # (n,) from the start of the motion
    tips_base: Floats  # (n, 3) where the burr meets its own axis
    axes_base: Floats  # (n, 3) into the bone
    places: Ints  # (n,) place of the milling path at which the move under way ends
