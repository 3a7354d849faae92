"""Fit test: whether an implant goes into a milled bed, and how much room is below it."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant

MOST_OVERLAP_MM = 0.05


@dataclass(frozen=True, slots=True)
class Fit:
    """How an implant lies in a bed, over the cells below it."""

    overlap_mm: float  # most that it would be stuck in the bone; 0 if it goes in
    gap_min_mm: float  # least room below it; 0 where it is stuck
    gap_mean_mm: float

    @property
    def goes_in(self) -> bool:
        """Return whether the implant goes in."""
        return self.overlap_mm <= MOST_OVERLAP_MM


def fit(implant: Implant, bed: Bed) -> Fit:
    """Return how an implant goes straight down into a bed; neither has an undercut.

    Raises:
        InvalidInputError: the grid of the bed does not reach round the implant.
    """
    outline = np.vstack(implant.outline())
    low, high = outline.min(axis=0), outline.max(axis=0)
    first, last = (bed.x_mm[0], bed.y_mm[0]), (bed.x_mm[-1], bed.y_mm[-1])
    require(
        bool((low >= first).all() and (high <= last).all()),
        f"the bed is known from {first[0]:g}, {first[1]:g} to {last[0]:g}, {last[1]:g} mm, which "
        f"does not reach round {implant.name}: compute it over a larger grid",
    )
    needed = implant.depth_mm(bed.x_mm, bed.y_mm)
    below = needed > 0.0
    gaps = bed.depth_mm[below] - needed[below]
    return Fit(
        overlap_mm=max(0.0, -float(gaps.min())),
        gap_min_mm=max(0.0, float(gaps.min())),
        gap_mean_mm=float(np.maximum(gaps, 0.0).mean()),
    )
