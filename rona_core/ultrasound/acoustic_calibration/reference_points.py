"""Choice of reference points for a caliper, and the time of flight at such points."""

from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.robust import cauchy_weights, mad_sigma, reweighted_least_squares
from rona_core.ultrasound.acoustic_calibration.speed_calibration import THIN_MM, TIMING_US
from rona_core.ultrasound.detection.detect import Detection

NEAR_MM = 2.0  # A-scans so near to a place tell its time of flight
AROUND_MM = 4.0  # and so near, its surroundings
ALIKE_MM = 0.4  # a place is chosen where its neighbours agree so well
LEAST_NEAR = 6
LEAST_SCATTER_MM = 0.01
LONELY_SLOPE = 0.15  # taken where nobody is around
SLOPE_COSTS_MM = 100.0  # so far away a place may be for a slope less by 1
ROUNDS = 30


def choose_reference_scans(places_base: Floats, detection: Detection, n: int) -> Ints:
    """Return the numbers (n,) of A-scans at which a caliper tells most: spread, thick and sure.

    The places divide the scanned area among them, so that none of it is far from the nearest; of
    those near by, one is taken whose inner boundary is nearly parallel, for its echo tells most.

    Args:
        places_base: Where each A-scan enters the bone (m, 3).
        detection: What was found in them.
        n: How many.

    Raises:
        DegenerateGeometryError: too few A-scans are sure of their inner boundary.
    """
    sure: Bools = np.asarray(detection.inner_ok)
    good = np.flatnonzero(sure & (detection.thickness_mm >= THIN_MM))
    local = _Local(places_base[sure], detection.thickness_mm[sure])
    value, slope, scatter = local.at(places_base[good])
    steady = np.abs(value - detection.thickness_mm[good]) <= ALIKE_MM
    steady &= scatter <= ALIKE_MM
    good, slope = good[steady], slope[steady]
    if len(good) < n:
        raise DegenerateGeometryError(
            f"{len(good)} A-scans are at least {THIN_MM:g} mm deep and agree with their "
            f"neighbours, {n} are needed: scan another region"
        )
    chosen: list[int] = []
    for middle in _divided(places_base[sure], n):
        cost = np.linalg.norm(places_base[good] - middle, axis=1) + SLOPE_COSTS_MM * slope
        cost[np.isin(good, chosen)] = np.inf
        chosen.append(int(good[int(np.argmin(cost))]))
    return np.array(sorted(chosen), dtype=np.int64)


def lags_at(
    places_base: Floats, scan_places_base: Floats, detection: Detection
) -> tuple[Floats, Floats]:
    """Return the two-way times (n,) through the bone at places (n, 3), and their sigmas in us.

    Each is that of a plane through the sure A-scans around the place. Its sigma is their scatter,
    and what the slope of that plane may cost: of a wedge, the nearest part is heard first.

    Raises:
        InvalidInputError: a place without a sure A-scan near it, by its number.
    """
    sure = np.flatnonzero(detection.inner_ok)
    if not len(sure):
        raise InvalidInputError("no A-scan shows an inner boundary that can be trusted")
    away = KDTree(scan_places_base[sure]).query(places_base)[0]
    far = np.flatnonzero(away > NEAR_MM)
    if len(far):
        raise InvalidInputError(
            f"reference point {int(far[0]) + 1} has no A-scan with a sure inner boundary within "
            f"{NEAR_MM:g} mm: remove it, or choose another place"
        )
    local = _Local(scan_places_base[sure], detection.thickness_mm[sure])
    depth, slope, scatter = local.at(places_base)
    sigma_mm = np.hypot(scatter, 0.5 * depth * slope**2)
    to_us = 2.0 / detection.sound_speed_mm_per_us
    return depth * to_us, np.hypot(sigma_mm * to_us, TIMING_US)


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


class _Local:
    """A plane through the thickness of the A-scans around a place."""

    def __init__(self, places: Floats, thickness_mm: Floats) -> None:
        self._places, self._thickness, self._tree = places, thickness_mm, KDTree(places)

    def at(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """Return thickness, slope and scatter (n,) at places (n, 3)."""
        rows = [self._one(place) for place in places]
        table = np.array(rows, dtype=np.float64).reshape(len(places), 3)
        return table[:, 0], table[:, 1], table[:, 2]

    def _one(self, place: Floats) -> tuple[float, float, float]:
        near = np.array(self._tree.query_ball_point(place, AROUND_MM), dtype=np.int64)
        if len(near) < LEAST_NEAR:
            nearest = int(np.asarray(self._tree.query(place)[1]))
            return float(self._thickness[nearest]), LONELY_SLOPE, ALIKE_MM
        away = self._places[near] - place
        flat = np.linalg.svd(away - away.mean(axis=0), full_matrices=False)[2][:2]
        design = np.column_stack((np.ones(len(near)), away @ flat.T))
        depth = self._thickness[near]
        fit = reweighted_least_squares(  # a stray echo among them counts little
            design,
            depth,
            lambda off: cauchy_weights(off, 2.0 * mad_sigma(off, floor=LEAST_SCATTER_MM)),
            rounds=4,
        )
        scatter = mad_sigma(depth - design @ fit, floor=LEAST_SCATTER_MM)
        return float(fit[0]), float(np.hypot(fit[1], fit[2])), scatter


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
