"""Poses that a tracker repeats while it sees nothing new."""

import numpy as np

from rona_core.geometry.arrays import Bools, readonly
from rona_core.geometry.pose import Poses

# Two measured poses differ by more, because a tracker has noise; the same pose may differ by this
# once it was printed with six digits, or converted.
SAME_MM = 5e-3
SAME_RAD = 5e-5


def repeated_poses(Ts_a_b: Poses) -> Bools:
    """Return which poses (n,) say again what the pose before them said.

    A run of equal poses is one measurement, however many rows it has: all but its first are True.
    """
    turned = np.abs(np.diff(Ts_a_b.rotations, axis=0)).max(axis=(1, 2), initial=0.0)
    moved = np.abs(np.diff(Ts_a_b.translations, axis=0)).max(axis=1, initial=0.0)
    same = (turned <= SAME_RAD) & (moved <= SAME_MM)
    return readonly(np.concatenate((np.zeros(min(len(Ts_a_b), 1), dtype=np.bool_), same)))
