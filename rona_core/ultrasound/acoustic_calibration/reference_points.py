"""Choice of reference points for a caliper, and the time of flight at such points."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.robust import cauchy_weights, mad_sigma, reweighted_least_squares
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    CALIPER_MM,
    THIN_MM,
    SpeedCalibration,
    speed_covariance,
    uncalibrated,
)
from rona_core.ultrasound.acoustic_calibration.speed_prior import (
    PUBLISHED,
    TIMING_US,
    SpeedPrior,
)
from rona_core.ultrasound.detection.detect import Detection

NEAR_MM = 2.0  # A-scans so near to a place tell its time of flight
AROUND_MM = 4.0  # and so near, its surroundings
ALIKE_MM = 0.4  # a place is chosen where its neighbours agree so well
CONFIDENT = 0.95  # and where its inner boundary is so likely to be the right one
LEAST_NEAR = 6
LEAST_SCATTER_MM = 0.01
LONELY_SLOPE = 0.15  # taken where there is no neighbour
STEEPEST_SLOPE = 0.5  # of an inner table; a plane through a few A-scans on one line may be steeper
# mean probability of the sure echoes, below which most of them may have taken another wave alike
LEAST_MEAN_QUALITY = 0.955
CYCLE_SLIP_PROBABILITY = 3 / 7  # of the simulated patients below it, three of seven had
MOST_OF_REGION, MOST_CHOICES = 200, 400  # A-scans that stand for all


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceProposal:
    """Places for a caliper, and what the speed of sound will cost a thickness with them.

    The two standard deviations (RMS over the sure A-scans) are in mm, by the speed alone.
    """

    rows: Ints  # (n,) of the depths
    now_mm: float
    then_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class EchoDepths:
    """Depths of the inner boundary below the outer one, of n A-scans that can be trusted."""

    scans: Ints  # (n,) numbers of the A-scans, those of further passes after those of the first
    places_base: Floats  # (n, 3) on the outer boundary, above the echo
    axes_base: Floats  # (n, 3) into the bone, which depths are along
    depth_mm: Floats  # (n,)
    quality: Floats  # (n,) probability that the echo is that of the inner boundary
    sound_speed_mm_per_us: float  # that depths are at
    common_sigma_mm: float = 0.0  # standard deviation of what all depths are off together

    def __len__(self) -> int:
        return len(self.depth_mm)


def propose_references(
    depths: EchoDepths, n: int, known: SpeedCalibration | None = None
) -> ReferenceProposal:
    """Return the A-scans at which a caliper is most informative of the thickness everywhere.

    One after the other, each the place that lowers the expected squared error of all thicknesses
    most (greedy A-optimal design, Krause 2008). It prefers thick places, where a caliper's error
    counts little, echoes that agree with all around them, and places far from those before.

    Args:
        depths: Of all A-scans that can be trusted (m).
        n: How many.
        known: Calibration at earlier points, which stay; None: there are none.

    Raises:
        DegenerateGeometryError: too few A-scans are sure of their inner boundary.
    """
    calibration = uncalibrated() if known is None else known
    places, nominal = depths.places_base, depths.sound_speed_mm_per_us
    good = np.flatnonzero((depths.quality >= CONFIDENT) & (depths.depth_mm >= THIN_MM))
    good = good[:: -(-max(len(good), 1) // MOST_CHOICES)]
    depth, slope, scatter = _Local(depths).at(places[good])
    steady = np.abs(depth - depths.depth_mm[good]) <= ALIKE_MM
    steady &= scatter <= ALIKE_MM
    steady &= _apart(places[good], calibration)
    good, depth, slope, scatter = good[steady], depth[steady], slope[steady], scatter[steady]
    if len(good) < n:
        raise DegenerateGeometryError(
            f"{len(good)} A-scans are at least {THIN_MM:g} mm deep, sure of their echo, agree with "
            f"their neighbours and lie apart from the points there are, {n} are needed: scan "
            "another region"
        )
    some = np.arange(0, len(depths), -(-len(depths) // MOST_OF_REGION))
    weight = depths.depth_mm[some]
    covariance = speed_covariance(calibration, places[np.concatenate((good, some))])
    # of a speed that is measured there
    timing_mm = calibration.prior.timing_us * nominal / 2.0
    noise_mm = np.sqrt(CALIPER_MM**2 + _sigma_mm(depth, slope, scatter) ** 2 + timing_mm**2)
    noise = (nominal * noise_mm / depth) ** 2
    chosen: list[int] = []

    def cost_mm() -> float:
        share = np.diag(covariance)[len(good) :] / nominal**2
        return float(np.sqrt(np.mean(weight**2 * share)))

    now_mm = cost_mm()
    for _ in range(n):
        total = np.diag(covariance)[: len(good)] + noise
        gain = ((covariance[: len(good), len(good) :] * weight) ** 2).sum(axis=1) / total
        gain[chosen] = -1.0
        best = int(np.argmax(gain))
        chosen.append(best)
        known_by = covariance[:, best] / np.sqrt(total[best])
        covariance = covariance - np.outer(known_by, known_by)
    return ReferenceProposal(np.sort(good[chosen]), now_mm, cost_mm())


def _apart(places_base: Floats, known: SpeedCalibration) -> Bools:
    """Return which places (m,) no caliper has been at: its lag would be the same once more."""
    if known.positions_mm is None or not len(known.positions_mm):
        return np.ones(len(places_base), dtype=np.bool_)
    return np.asarray(KDTree(known.positions_mm).query(places_base)[0] > NEAR_MM)


def lags_at(places_base: Floats, depths: EchoDepths) -> tuple[Floats, Floats]:
    """Return the two-way times (n,) through the bone at places (n, 3), and their sigmas in us.

    Each is that of a plane through the depths around the place. Its sigma is their scatter, and
    what the slope of that plane may cost: of a wedge, the nearest part echoes first. What all lags
    have in common is not in it.

    Raises:
        InvalidInputError: a place without a sure A-scan near it, by its number.
    """
    if not len(depths):
        raise InvalidInputError("no A-scan shows an inner boundary that can be trusted")
    away = KDTree(depths.places_base).query(places_base)[0]
    far = np.flatnonzero(away > NEAR_MM)
    if len(far):
        raise InvalidInputError(
            f"reference point {int(far[0]) + 1} has no A-scan with a sure inner boundary within "
            f"{NEAR_MM:g} mm: remove it, or choose another place"
        )
    depth, slope, scatter = _Local(depths).at(places_base)
    to_us = 2.0 / depths.sound_speed_mm_per_us
    return depth * to_us, _sigma_mm(depth, slope, scatter) * to_us


def speed_prior_for(depths: EchoDepths, centre_mhz: float) -> SpeedPrior:
    """Return the prior of a calibration by lags of these depths, with what they share.

    Waves of an echo look alike, a period apart, and only neighbours tell them apart. Where the sure
    echoes are less likely than usual, most may have taken the same wrong wave (a cycle slip), and
    reference points with them.
    """
    common_us = 2.0 * depths.common_sigma_mm / depths.sound_speed_mm_per_us
    if len(depths) and depths.quality.mean() < LEAST_MEAN_QUALITY:
        common_us = np.hypot(common_us, np.sqrt(CYCLE_SLIP_PROBABILITY) / centre_mhz)
    return replace(PUBLISHED, timing_us=float(np.hypot(TIMING_US, common_us)))


def _sigma_mm(depth: Floats, slope: Floats, scatter: Floats) -> Floats:
    return np.hypot(scatter, 0.5 * depth * slope**2)


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

    def __init__(self, depths: EchoDepths) -> None:
        self._places, self._thickness = depths.places_base, depths.depth_mm
        self._tree = KDTree(self._places)

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
        slope = min(float(np.hypot(fit[1], fit[2])), STEEPEST_SLOPE)
        return float(fit[0]), slope, scatter
