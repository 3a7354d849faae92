"""Faults of an optical tracker: dropped frames, warm-up drift and ghost solutions."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.settings import TrackerSettings
from rona_core.devices.trackers import MarkerGeometry
from rona_core.geometry.arrays import Floats, Ints
from rona_core.virtual.noise import rng

WARM_UP_MIN = 14.0  # time constant: after three of them, 42 minutes, a twentieth is left
CAPTURE_MIN = 3.0  # from the start of one capture to that of the next


def dropped(settings: TrackerSettings, seed: int, ordinal: int, number: int) -> bool:
    """Return whether frame ``number`` of a capture never arrives; the first one always does."""
    share = settings.dropped_share
    if share <= 0.0 or number <= 0:
        return False
    return bool(rng(seed, "tracker-dropped", ordinal, number).random() < share)


def minutes_on(settings: TrackerSettings, ordinal: int, times_s: ArrayLike) -> Floats:
    """Return the minutes (...) the tracker has been on at times (...) of a capture."""
    before = settings.minutes_on + CAPTURE_MIN * max(ordinal - 1, 0)
    return before + np.asarray(times_s, dtype=np.float64) / 60.0


def drift_mm(settings: TrackerSettings, seed: int, ordinal: int, times_s: ArrayLike) -> Floats:
    """Return by how much (..., 3) all that is seen at times (...) is shifted before warm-up ends.

    The direction belongs to the device: random, mostly in depth.
    """
    times = np.asarray(times_s, dtype=np.float64)
    if settings.drift_mm <= 0.0:
        return np.zeros((*times.shape, 3))
    direction = rng(seed, "tracker-drift", 0, 0).normal(0.0, (1.0, 1.0, settings.depth_ratio))
    remaining = np.exp(-minutes_on(settings, ordinal, times) / WARM_UP_MIN)
    return settings.drift_mm * remaining[..., None] * direction / np.linalg.norm(direction)


def swapped_markers(
    settings: TrackerSettings,
    geometry: MarkerGeometry,
    seed: int,
    ordinal: int,
    numbers: Sequence[int] | Ints,
) -> Ints | None:
    """Return two markers (n, 2) that each frame takes for each other, -1 where none; None: never.

    Two markers of a line look the same from both ends: where the third is not matched between the
    cameras, the reversed line fits just as well. 6D tools do not have this ambiguity.
    """
    if geometry.dof != 5 or settings.phantom_share <= 0.0:
        return None
    swapped = np.full((len(numbers), 2), -1, dtype=np.int64)
    for row, number in enumerate(numbers):
        generator = rng(seed, "tracker-phantom", ordinal, int(number))
        if generator.random() < settings.phantom_share:
            swapped[row] = generator.permutation(len(geometry.positions_marker))[:2]
    return swapped
