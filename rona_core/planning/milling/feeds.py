"""Feed of the burr: slower where less bone is left below it."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require, require_within
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.planning.milling.milling_path import MillingPath, Move


@dataclass(frozen=True, slots=True)
class FeedSettings:
    """How fast the burr moves; all values are assumed."""

    full_mm_per_s: float = 4.0  # where the bone is thick
    thin_mm_per_s: float = 1.0  # where it is thin
    thin_mm: float = 1.0  # residual bone from which on it is thin
    thick_mm: float = 3.0  # and from which on it is thick; between them the feed is even
    air_mm_per_s: float = 20.0  # of moves in the air

    def __post_init__(self) -> None:
        require_within("full_mm_per_s", self.full_mm_per_s, 0.1, 20.0)
        require_within("thin_mm_per_s", self.thin_mm_per_s, 0.1, self.full_mm_per_s)
        require_within("thin_mm", self.thin_mm, 0.0, 10.0)
        require_within("thick_mm", self.thick_mm, 0.0, 20.0)
        require_within("air_mm_per_s", self.air_mm_per_s, 0.1, 100.0)
        require(
            self.thick_mm > self.thin_mm,
            f"thick_mm must be more than thin_mm {self.thin_mm:g}, not {self.thick_mm:g}",
        )


def feeds_mm_per_s(
    path: MillingPath, residual_mm: Floats, settings: FeedSettings | None = None
) -> Floats:
    """Return the feed (n,) of each move: that of the thinner of its two ends.

    Dillon 2016 plans the speed from the bone in the same way.

    Args:
        path: Of n places.
        residual_mm: Bone left below each place (n,), as the maps say.
        settings: Speeds, and what is thin.

    Raises:
        InvalidInputError: not as many residuals as places, or values that are not finite.
    """
    settings = settings or FeedSettings()
    residual = as_floats(residual_mm, name="residual_mm")
    require(
        residual.shape == (len(path),),
        f"residual_mm must have shape ({len(path)},), one for each place, not {residual.shape}",
    )
    thinner = np.minimum(residual, np.concatenate((residual[:1], residual[:-1])))
    feeds = np.interp(
        thinner,
        (settings.thin_mm, settings.thick_mm),
        (settings.thin_mm_per_s, settings.full_mm_per_s),
    )
    return readonly(np.where(path.moves == Move.RETRACT, settings.air_mm_per_s, feeds))


def duration_s(path: MillingPath, feeds: Floats) -> float:
    """Return how long a path lasts at the feeds (n,) of its moves, in mm/s."""
    steps = np.linalg.norm(np.diff(path.tips_bed, axis=0), axis=1)
    return float((steps / feeds[1:]).sum())
