"""Where a caliper should be put for the speed of sound, and what the echoes say at such places."""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.arrays import Bools, Floats, Ints, readonly
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.ultrasound.detect import Detection
from rona_core.ultrasound.sound_speed import THIN_MM, TIMING_US

NEAR_MM = 2.0  # A-scans so near to a place tell its time of flight
ALIKE_MM = 0.4  # a place is chosen where its neighbours agree so well
LEAST_NEAR = 3
ROUNDS = 30


def choose_reference_scans(places_base: Floats, detection: Detection, n: int) -> Ints:
    """Return the numbers (n,) of A-scans at which a caliper tells most: spread, thick and sure.

    The places divide the scanned area among them, so that none of it is far from the nearest.

    Args:
        places_base: Where each A-scan enters the bone (m, 3).
        detection: What was found in them.
        n: How many.

    Raises:
        DegenerateGeometryError: too few A-scans are sure of their inner boundary.
    """
    sure: Bools = np.asarray(detection.inner_ok)
    good = np.flatnonzero(sure & (detection.thickness_mm >= THIN_MM))
    steady = np.array([_is_steady(i, places_base, detection, sure) for i in good], dtype=np.bool_)
    good = good[steady]
    if len(good) < n:
        raise DegenerateGeometryError(
            f"{len(good)} A-scans are at least {THIN_MM:g} mm deep and agree with their "
            f"neighbours, {n} are needed: scan another region"
        )
    middles = _divided(places_base[sure], n)
    chosen: list[int] = []
    for middle in middles:
        away = np.linalg.norm(places_base[good] - middle, axis=1)
        away[np.isin(good, chosen)] = np.inf
        chosen.append(int(good[int(np.argmin(away))]))
    return np.array(sorted(chosen), dtype=np.int64)


def lags_at(
    places_base: Floats, scan_places_base: Floats, detection: Detection
) -> tuple[Floats, Floats]:
    """Return the two-way times (n,) through the bone at places (n, 3), and their sigmas in us.

    Each is the median of the sure A-scans around the place.

    Raises:
        InvalidInputError: a place without a sure A-scan near it, by its number.
    """
    sure = np.flatnonzero(detection.inner_ok)
    lag_us = np.asarray(detection.inner_us - detection.outer_us)
    if not len(sure):
        raise InvalidInputError("no A-scan shows an inner boundary that can be trusted")
    tree = KDTree(scan_places_base[sure])
    found, sigma = np.zeros(len(places_base)), np.zeros(len(places_base))
    for i, near in enumerate(tree.query_ball_point(places_base, NEAR_MM)):
        if not near:
            raise InvalidInputError(
                f"reference point {i + 1} has no A-scan with a sure inner boundary within "
                f"{NEAR_MM:g} mm: remove it, or choose another place"
            )
        rows = sure[near]
        found[i] = float(np.median(lag_us[rows]))
        own = float(np.median(detection.inner_sigma_us[rows])) / np.sqrt(len(rows))
        sigma[i] = float(np.hypot(own, TIMING_US))
    return found, sigma


def at_speed(detection: Detection, speed_mm_per_us: Floats | float) -> Detection:
    """Return the detection with its thicknesses at another speed, one or one per A-scan (n,)."""
    speed = np.broadcast_to(np.asarray(speed_mm_per_us, dtype=np.float64), (len(detection),))
    share = speed / detection.sound_speed_mm_per_us
    mean = float(speed.mean()) if len(speed) else detection.sound_speed_mm_per_us
    return replace(
        detection,
        thickness_mm=readonly(detection.thickness_mm * share),
        thickness_sigma_mm=readonly(detection.thickness_sigma_mm * share),
        sound_speed_mm_per_us=mean,
    )


def _is_steady(row: int, places_base: Floats, detection: Detection, sure: Bools) -> bool:
    """Return whether the sure A-scans about one agree with it."""
    away = np.linalg.norm(places_base - places_base[row], axis=1)
    near = np.flatnonzero(sure & (away <= NEAR_MM))
    off = np.abs(detection.thickness_mm[near] - detection.thickness_mm[row])
    return len(near) >= LEAST_NEAR and float(np.median(off)) <= ALIKE_MM


def _divided(points: Floats, n: int) -> Floats:
    """Return the middles (n, 3) of ``n`` parts of points (m, 3), by Lloyd's rule."""
    first = int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    middles = points[[first]]
    while len(middles) < n:  # the farthest point starts the next part
        away = np.linalg.norm(points[:, None] - middles[None], axis=2).min(axis=1)
        middles = np.vstack((middles, points[int(np.argmax(away))]))
    for _ in range(ROUNDS):
        nearest = np.argmin(np.linalg.norm(points[:, None] - middles[None], axis=2), axis=1)
        middles = np.array(
            [
                points[nearest == k].mean(axis=0) if (nearest == k).any() else middles[k]
                for k in range(n)
            ]
        )
    return middles
