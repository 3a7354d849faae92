"""Feed of the burr: slower where less bone is left below it."""

import numpy as np

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Floats, as_floats, readonly
from rona_core.planning.milling.milling_path import MillingPath, Move

# all assumed
FULL_MM_PER_S, THIN_MM_PER_S = 4.0, 1.0  # feed where the bone is thick, and where it is thin
THIN_MM, THICK_MM = 1.0, 3.0  # residual bone; between them the feed is interpolated
AIR_MM_PER_S = 20.0  # of moves in the air


def feeds_mm_per_s(path: MillingPath, residual_mm: Floats) -> Floats:
    """Return the feed (n,) of each move: that of the thinner of its two ends.

    Dillon 2016 plans the speed from the bone in the same way.

    Args:
        path: Of n places.
        residual_mm: Bone left below each place (n,), as the maps say.

    Raises:
        InvalidInputError: not as many residuals as places, or values that are not finite.
    """
    residual = as_floats(residual_mm, name="residual_mm")
    require(
        residual.shape == (len(path),),
        f"residual_mm must have shape ({len(path)},), one for each place, not {residual.shape}",
    )
    thinner = np.minimum(residual, np.concatenate((residual[:1], residual[:-1])))
    feeds = np.interp(thinner, (THIN_MM, THICK_MM), (THIN_MM_PER_S, FULL_MM_PER_S))
    return readonly(np.where(path.moves == Move.RETRACT, AIR_MM_PER_S, feeds))


def duration_s(path: MillingPath, feeds: Floats) -> float:
    """Return how long a path lasts at the feeds (n,) of its moves, in mm/s."""
    steps = np.linalg.norm(np.diff(path.tips_bed, axis=0), axis=1)
    return float((steps / feeds[1:]).sum())
