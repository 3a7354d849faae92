"""Faults of an optical tracker: dropped frames, warm-up drift and ghost solutions."""

import numpy as np

from rona_core.devices.marker_geometry import MarkerGeometry
from rona_core.devices.settings import TrackerSettings
from rona_core.geometry.arrays import Vector3, readonly
from rona_core.virtual.noise import rng

WARM_UP_MIN = 14.0  # time constant: after three of them, 42 minutes, a twentieth is left
CAPTURE_MIN = 3.0  # from the start of one capture to that of the next
NO_DRIFT = readonly(np.zeros(3))


def dropped(settings: TrackerSettings, seed: int, ordinal: int, number: int) -> bool:
    """Return whether frame ``number`` of a capture never arrives; the first one always does."""
    share = settings.dropped_share
    if share <= 0.0 or number <= 0:
        return False
    return bool(rng(seed, "tracker-dropped", ordinal, number).random() < share)


def minutes_on(settings: TrackerSettings, ordinal: int, time_s: float) -> float:
    """Return how long the tracker has been on, ``time_s`` into capture number ``ordinal``."""
    return settings.minutes_on + CAPTURE_MIN * max(ordinal - 1, 0) + time_s / 60.0


def drift_mm(settings: TrackerSettings, seed: int, ordinal: int, time_s: float) -> Vector3:
    """Return by how much (3,) all that is seen is shifted while the tracker is not warm yet.

    The direction belongs to the device: random, mostly in depth.
    """
    if settings.drift_mm <= 0.0:
        return NO_DRIFT
    direction = rng(seed, "tracker-drift", 0, 0).normal(0.0, (1.0, 1.0, settings.depth_ratio))
    remaining = np.exp(-minutes_on(settings, ordinal, time_s) / WARM_UP_MIN)
    return settings.drift_mm * remaining * direction / np.linalg.norm(direction)


def swapped_markers(
    settings: TrackerSettings, geometry: MarkerGeometry, seed: int, ordinal: int, number: int
) -> tuple[int, int] | None:
    """Return two markers that this frame takes for each other, or None as it should be.

    Two markers of a line look the same from both ends: where the third is not matched between the
    cameras, the reversed line fits just as well. 6D tools do not have this ambiguity.
    """
    if geometry.dof != 5 or settings.phantom_share <= 0.0:
        return None
    generator = rng(seed, "tracker-phantom", ordinal, number)
    if generator.random() >= settings.phantom_share:
        return None
    first, second = generator.permutation(len(geometry.positions_marker))[:2]
    return int(first), int(second)
