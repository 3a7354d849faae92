"""Correction of the times of oblique inner echoes: where outer and inner boundary are not parallel.

Where the inner boundary is oblique, one side of the beam receives its echo before the other. That
dulls the echo, puts a null into its band and delays what is left, so that a template of a parallel
plate fits best a whole cycle off, and so it does at the next place, which is as oblique. Here every
time is weighed with every slope that the beam may see, and the level of the echo then selects the
right pair: a parallel boundary would have to reflect far too little.

The fit of a parallel boundary (``time_of_flight.py``) is as exact as noise allows. The correction
moves its time by steps, and only where slope or neighbours ask for it: the less oblique the
boundary, the less other times than that one count.

Cycle slips: the chance that the time of an inner echo is a whole cycle off. Neighbours that
slipped, too, hold an echo at the wrong cycle; its own evidence decides: where the time is right,
the cycle before and the one behind explain the echo far worse.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import erf

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.single.candidates import BLOCK, Echoes
from rona_core.ultrasound.detection.single.front_echo import standoff_mm
from rona_core.ultrasound.detection.single.inner_echo import InnerEchoes
from rona_core.ultrasound.detection.spatial.detectability import detectability
from rona_core.ultrasound.detection.spatial.neighbours import (
    LEAST_NEIGHBOURS,
    SCATTER_FLOOR,
    Links,
    LocalPlanes,
    plane_axes,
)
from rona_core.ultrasound.detection.spatial.slope_likelihoods import Singles, Weighed, weigh_slopes
from rona_core.ultrasound.probe.materials import GEL, Material
from rona_core.ultrasound.probe.probe_model import ProbeModel, ProbeSurvey

SAME_CYCLES = 0.3  # within which a time counts as the one that was found
OTHER_CYCLES = 0.6, 1.3  # how far off the cycle before and the one behind lie
# odds of a slip where another cycle explains the echo as well, for a sigma of one cycle; a wide
# first fit has more slips. 3.4 % of the sure A-scans slip on the seeds 21000 to 21023
SLIP_ODDS = 0.3
EVIDENCE = 0.5  # what a log likelihood ratio counts: the clutter of two cycles is the same
LEAST_RATIO, MOST_RATIO = -12.0, 6.0  # further out a ratio adds no evidence


def slip_chances(
    log_likelihood: Floats,
    offsets_us: Floats,
    found_us: Floats,
    first_sigma_us: Floats,
    period_us: float,
) -> Floats:
    """Return the chance (n,) that a time is a whole cycle off.

    Args:
        log_likelihood: Of every A-scan by itself, at each offset (n, t).
        offsets_us: From the start time (t,).
        found_us: Offset of the time that was found (n,).
        first_sigma_us: Sigma of the start time (n,).
        period_us: Length of a cycle.
    """
    away = np.abs(offsets_us - found_us[:, None]) / period_us
    here = _best(log_likelihood, away <= SAME_CYCLES)
    low, high = OTHER_CYCLES
    other = _best(log_likelihood, (away >= low) & (away <= high))
    ratio = np.clip(other - here, LEAST_RATIO, MOST_RATIO)
    odds = SLIP_ODDS * first_sigma_us / period_us * np.exp(EVIDENCE * ratio)
    return odds / (1.0 + odds)


def _best(log_likelihood: Floats, which: Bools) -> Floats:
    return np.where(which, log_likelihood, -np.inf).max(axis=1)


LEVEL_SD = 0.45  # natural logarithm of the level about that of the survey
HELD_CYCLES = 0.3  # how far off a time may be that was fitted for a parallel boundary,
FLAT = 0.3  # if the slope is under this share of the steepest one
WITNESS = 0.5  # confidence from which on an echo is a witness for those beside it
ROUNDS = 4
OUTER_SD_MM = 0.03
EXPECTED_SD_US = 0.1  # of a time about the plane through its neighbours
SLOPE_SD = 0.05  # of a slope in us per mm about that of this plane
UNKNOWN_SD = 0.08  # where the slope is not known
NEIGHBOUR_WEIGHT = 1.5  # how much neighbours can weigh against the echo itself
BEND_PER_MM = 0.01  # where a boundary is oblique it also bends, by so much of its slope,
BEND_US_PER_MM2 = 4e-4  # and a little everywhere: the wider the beam, the less one time says
STRUCTURE_CYCLES = 0.035  # what the boundary itself adds: roughness, bend, layers,
TILTED_CYCLES = 0.11  # and with the outer boundary taken from a map


@dataclass(frozen=True, slots=True, eq=False)
class _Settled:
    """What the A-scans (n,) come to."""

    lag_us: Floats  # (n,)
    sigma_us: Floats  # (n,)
    level: Floats  # (n,) natural logarithm
    slopes: Floats  # (n, 2) of the inner time, us per mm
    slip_chance: Floats  # (n,)


def correct_oblique_echoes(
    echoes: Echoes, found: InnerEchoes, bone: Material, survey: ProbeSurvey, links: Links
) -> InnerEchoes:
    """Return the inner echoes with times and sigmas corrected for an oblique inner boundary.

    Without positions they are returned as they are. Without axes the probe counts as
    perpendicular to the outer boundary, unless that was not measured but known from elsewhere.

    Args:
        echoes: Of the survey.
        found: Which echoes are the inner ones; their times may be some cycle off.
        bone: Nominal bone.
        survey: Where the probe was.
        links: Who is around whom.
    """
    rows = np.flatnonzero(found.detected & (found.confidence > WITNESS))
    if survey.positions_mm is None or len(rows) <= LEAST_NEIGHBOURS:
        return found
    upright = survey.known_standoff_mm is None
    weighed = weigh_slopes(echoes, found.lag_us, rows, bone)
    probe, to_plane = echoes.template.probe, plane_axes(survey.positions_mm[rows])
    places = survey.positions_mm[rows] @ to_plane
    around = LocalPlanes(places)
    outer_slope = np.zeros((len(rows), 2))
    if survey.axes is not None:
        standoff = standoff_mm(echoes.fronts.delay_us[rows], probe)
        outer_slope = _outer_slope(places, standoff, survey.axes[rows] @ to_plane, around)
    slope_known = around.known & (upright or survey.axes is not None)
    start = found.lag_us[rows], found.sigma_us[rows]
    settled = _settled(weighed, start, around, outer_slope, slope_known, probe)
    times, sigmas = found.lag_us.copy(), found.sigma_us.copy()
    width_mm = 2.0 * probe.aperture_radius_mm
    bent = width_mm**2 * np.hypot(BEND_US_PER_MM2, BEND_PER_MM * np.hypot(*settled.slopes.T))
    cycles = STRUCTURE_CYCLES if upright else TILTED_CYCLES
    structure = np.hypot(bent, cycles / probe.centre_mhz)
    times[rows], sigmas[rows] = settled.lag_us, np.hypot(settled.sigma_us, structure)
    slipped = found.slip_chance.copy()
    slipped[rows] = settled.slip_chance
    # a time that is known better makes no echo more certain than it was
    surer = _within(sigmas, bone) / np.maximum(_within(found.sigma_us, bone), 1e-12)
    confidence = found.confidence / np.maximum(surer, 1.0)
    confidence[rows] *= detectability(settled.level, settled.lag_us, rows, links, probe, bone)
    return replace(found, lag_us=times, sigma_us=sigmas, confidence=confidence, slip_chance=slipped)


def _settled(
    weighed: Weighed,
    start: tuple[Floats, Floats],
    around: LocalPlanes,
    outer_slope: Floats,
    slope_known: Bools,
    probe: ProbeModel,
) -> _Settled:
    """Return times, and with them what is known of them.

    Each round weighs times and slopes by what the neighbours came to in the one before.

    Args:
        weighed: Likelihoods of the A-scans by themselves.
        start: The times that the offsets count from (n,), and how far off they may be (n,).
        around: Planes through the neighbours.
        outer_slope: What the outer boundary adds to the slope (n, 2).
        slope_known: Where the slope is known from the neighbours (n,).
        probe: Its centre frequency gives the length of a cycle.
    """
    start_us, sigma_us = start
    lag, sd = start_us, np.maximum(sigma_us, SCATTER_FLOOR)
    level, slopes = np.zeros(len(lag)), np.zeros((len(lag), 2))
    shape = len(lag), len(weighed.offsets_us)
    alone, shares, together = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    held = _held(weighed, probe)
    slope_sd = np.where(slope_known, SLOPE_SD, UNKNOWN_SD)[:, None]
    for turn in range(ROUNDS):
        expected, slopes, scatter = around.planes(lag, sd)
        slope = np.where(slope_known, np.hypot(*(slopes + outer_slope).T), 0.0)
        unlike = 0.5 * ((weighed.slopes - slope[:, None]) / slope_sd) ** 2
        usual = _usual_level(weighed, slope)
        if turn:
            off = (start_us - expected)[:, None] + weighed.offsets_us
            residual = off / np.hypot(scatter, EXPECTED_SD_US)[:, None]  # standardised
            together = -NEIGHBOUR_WEIGHT * np.log1p(0.5 * residual**2)
            together[~around.known] = 0.0
        for first in range(0, len(lag), BLOCK):  # all at once would be the largest arrays here
            some = slice(first, first + BLOCK)
            chances = _chances(weighed, some, unlike[some], usual)
            if turn == ROUNDS - 1:
                alone[some] = _over_slopes(chances)
            chances -= held
            chances += together[some, None, :]
            shares[some], level[some] = _over_times(chances, weighed.level[some])
        lag, sd = _mean(weighed.offsets_us, shares, start_us)
    period_us = 1.0 / probe.centre_mhz
    slipped = slip_chances(alone, weighed.offsets_us, lag - start_us, sigma_us, period_us)
    return _Settled(lag, sd, level, slopes, slipped)


def _chances(weighed: Weighed, some: slice, unlike: Floats, usual: float) -> Floats:
    """Return the logarithms of the chances (n, s, t) of A-scans by themselves.

    Args:
        weighed: Likelihoods of the survey.
        some: Which A-scans (n) are meant.
        unlike: How unlikely each slope is (n, s) by what the neighbours say.
        usual: Logarithm of the level of an echo.
    """
    alone = weighed.likelihood[some] - 0.5 * ((weighed.level[some] - usual) / LEVEL_SD) ** 2
    return np.asarray(alone - unlike[:, :, None], dtype=np.float64)  # now in double precision


def _over_slopes(log_chance: Floats) -> Floats:
    """Return the logarithm of the chance (n, t) of a time with any slope."""
    most = log_chance.max(axis=1)
    over = log_chance - most[:, None, :]
    return np.asarray(most + np.log(np.exp(over, out=over).sum(axis=1)))


def _held(weighed: Weighed, probe: ProbeModel) -> Singles:
    """Return how unlikely offsets are (s, t) from a time that was fitted for a parallel boundary.

    The flatter the boundary, the more that time counts.
    """
    cycles = weighed.offsets_us * probe.centre_mhz
    flat = np.exp(-((weighed.slopes / (FLAT * weighed.slopes[-1])) ** 2))
    return np.multiply.outer(flat, 0.5 * (cycles / HELD_CYCLES) ** 2).astype(np.float32)


def _within(sigma_us: Floats, bone: Material) -> Floats:
    """Return the chance (n,) that a boundary with this sigma of its time is right to 1 mm."""
    sigma_mm = np.maximum(sigma_us * bone.speed_mm_per_us / 2.0, 1e-9)
    return np.asarray(erf(1.0 / sigma_mm / np.sqrt(2.0)))


def _usual_level(weighed: Weighed, slope: Floats) -> float:
    """Return the logarithm of the median level of the echoes of this survey, at these slopes."""
    nearest = np.abs(weighed.slopes - slope[:, None]).argmin(axis=1)
    rows = np.arange(len(nearest))
    best = weighed.likelihood[rows, nearest].argmax(axis=1)
    return float(np.median(weighed.level[rows, nearest, best]))


def _over_times(chances: Floats, level: Singles) -> tuple[Floats, Floats]:
    """Return the share (n, t) of each time, and the mean of the levels (n, s, t).

    The logarithms of the chances (n, s, t) are lost: there is no room for one more such array.
    """
    share = np.subtract(chances, chances.max(axis=(1, 2), keepdims=True), out=chances)
    np.exp(share, out=share)
    share /= share.sum(axis=(1, 2), keepdims=True)
    return share.sum(axis=1), (share * level).sum(axis=(1, 2))


def _mean(offsets_us: Floats, shares: Floats, middle_us: Floats) -> tuple[Floats, Floats]:
    """Return mean and standard deviation (n,) of the times, given the share (n, t) of each."""
    mean = shares @ offsets_us
    spread = (shares * (offsets_us - mean[:, None]) ** 2).sum(axis=1)
    return middle_us + mean, np.sqrt(spread)


def _outer_slope(places: Floats, standoff_mm: Floats, axes: Floats, around: LocalPlanes) -> Floats:
    """Return how the time to the outer boundary rises (n, 2) across each probe, in us per mm.

    All coordinates are those of the plane of the survey, its normal last.
    """
    points = places + standoff_mm[:, None] * axes
    _, slope, _ = around.planes(points[:, 2], np.full(len(points), OUTER_SD_MM))
    return 2.0 / GEL.speed_mm_per_us * (axes[:, :2] + axes[:, 2:] * slope)
