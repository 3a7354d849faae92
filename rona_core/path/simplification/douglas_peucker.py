"""Ramer-Douglas-Peucker simplification: split at the farthest point until the bound holds.

Source: Ramer 1972, Douglas and Peucker 1973; here with the distance from the segment, not from
the infinite line, and all pieces of one depth at a time.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.path.simplification.error_bound import ShortcutTest
from rona_core.path.simplification.segment_distance import distances_to_segment

SPLIT_RULE = "split at the farthest point, the first among equals, until the bound holds"


def douglas_peucker(columns: Floats, fixed: Bools, test: ShortcutTest) -> Ints:
    """Return the indices (k,) of the points at which the path was split, ends included.

    Args:
        columns: The path as (m, n), one row per dimension.
        fixed: Mask (n,) of the points that must stay, ends included.
        test: Decides which segments may replace a piece.
    """
    kept = fixed.copy()
    stays = np.flatnonzero(fixed)
    starts, ends = stays[:-1], stays[1:]
    while len(starts):
        broken = ~test.holds(columns, starts, ends)
        starts, ends = starts[broken], ends[broken]
        at = np.array(
            [_farthest(columns, a, b) for a, b in zip(starts, ends, strict=True)], dtype=np.int64
        )
        kept[at] = True
        starts, ends = np.concatenate((starts, at)), np.concatenate((at, ends))
    return np.flatnonzero(kept)


def _farthest(columns: Floats, start: int, end: int) -> int:
    inner = columns[:, start + 1 : end].T
    distances = distances_to_segment(inner, columns[:, start], columns[:, end])
    return start + 1 + int(distances.argmax())
