"""Selection of the inner echo among the candidates of each A-scan, and its time of flight.

The candidates of each A-scan are judged by their own features and by those of the A-scans around
it (``candidate_selection.py``, ``track_before_detect.py``), and the one selected is timed
(``time_of_flight.py``). The runner-up is kept with its probability.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.single.candidates import BLOCK, Echoes
from rona_core.ultrasound.detection.single.inner_echo import (
    Candidates,
    InnerEchoes,
    inner_grid_mm,
)
from rona_core.ultrasound.detection.single.matched_filter import joined, rows_of
from rona_core.ultrasound.detection.single.time_of_flight import (
    EnvelopePeaks,
    InnerFits,
    choose_cycles,
    fit_inner,
)
from rona_core.ultrasound.detection.spatial.neighbours import Links, predict_lags
from rona_core.ultrasound.detection.spatial.track_before_detect import (
    APART_MM,
    MULTIPLE,
    STACK_FLOOR,
    STACK_SURE,
    Tracks,
    along_tracks,
    candidate_probabilities,
    change_sd_mm,
    loudest_repeat,
)
from rona_core.ultrasound.probe.materials import Material
from rona_core.ultrasound.probe.probe_model import ProbeModel

LOUDEST = 0.5  # log level over which nothing is too loud: bone may lose less than nominal bone
FAINT = 0.2  # level under which it is hardly an inner echo, even of an oblique table:
FAINTER = 6.0  # log odds lost for each time that it is 2.7 times fainter, whatever its support
LOUD_SNR = 5.0  # more does not make it more certain
OVER_CLUTTER = 7.0  # phase counts up to this
LATE_NOISE, LATE_ECHO = 4.0, 0.1  # what may follow: noise, and echoes of the echo
LATEST = 12.0
MULTIPLE_LEVEL = 0.25  # of an echo: its multiple is not louder
STACKED = 2.0  # mean log likelihood ratio counts up to this
LEAST_TRACK = 1e-3  # a track of the boundary is never less likely than that
ENOUGH = 5.0  # neighbours, from which on their support counts in full
FITTED_MHZ = (1.0, 2.25)
LEVEL = 1  # where the features say it
# As fitted, but for multiples and for boundaries behind: known from acoustics, rare in the fit.
ALONE = (  # constant, level, loudness, noise, later peak, earlier peak, sign, multiple
    (1.82, 2.47, 0.00, 1.46, -1.59, -1.56, 0.92, -2.00),
    (-0.86, 1.20, -4.56, 3.07, -1.27, 0.00, 0.17, -2.00),
)
TOGETHER = (  # the same; a boundary behind it, its likelihood, support, track, stack
    (-2.10, 0.38, 0.00, 1.04, -0.89, -1.16, 0.94, -1.00, -0.59, -0.17, 3.04, 0.01, 1.31),
    (-1.30, 0.00, -1.41, 1.30, -0.20, 0.00, 0.00, -1.00, -0.50, -0.79, 1.70, 0.29, 2.72),
)
SAME_MM = 0.5  # candidates this close are the same boundary
RAYLEIGH = np.log(2.0)  # median over mean of the power of noise
DOUBT = 1.25, 3.0  # a boundary behind makes no choice surer than this line
LIKELY = 0.5  # chance from which on an inner echo is a witness for those beside it
CYCLE_ROUNDS = 6  # of asking neighbours which cycle is meant
EXPECTED_SD_MM = 0.2  # of thickness about the plane through those around
MOVED_CYCLES = 1.0  # by which those around may move a time; further off, they show another
MOVED = 0.5  # boundary, and it is as likely as not that this is the right one
OBLIQUE = (
    0.016  # sigma over rise times squared width of the aperture, 1 / mm; the rise in us per mm
)
STEEPEST = 1.0  # is no larger than this over the speed: a boundary oblique by 27 degrees
SPARE_NOISE = 1.5  # what part of the noise's power counts as clutter by chance


def features(candidates: Candidates) -> Floats:
    """Return the features of candidates from their own A-scans, shape (n, k, 8)."""
    snr = np.maximum(candidates.level / np.maximum(candidates.noise, 1e-12), 1e-2)
    level = np.log(np.maximum(candidates.level, 1e-4))
    over = candidates.level / np.maximum(candidates.clutter, 1e-12)
    later = candidates.after * snr / (LATE_NOISE + LATE_ECHO * snr)
    columns: tuple[Floats, ...] = (
        np.ones(level.shape),
        level,
        np.clip(level, 0.0, LOUDEST),
        np.log(np.minimum(snr, LOUD_SNR)),
        np.log(np.clip(later, 1.0, LATEST)),
        np.log(np.clip(candidates.before, 1.0, 100.0)),
        np.cos(candidates.phase_rad) * np.log(np.clip(over, 1.0, OVER_CLUTTER)),
        _repeated(candidates, snr),
    )
    stacked: Floats = np.stack(columns, axis=-1)
    return stacked


def _repeated(candidates: Candidates, snr: Floats) -> Floats:
    """Return which candidates (n, k) a much louder one at half the depth explains, as 0 or 1."""
    lag = candidates.lag_us
    ahead = lag[:, None, :]  # (n, here, ahead)
    off = np.abs(lag[:, :, None] - 2.0 * ahead)
    louder = snr[:, None, :] * MULTIPLE_LEVEL > snr[:, :, None]
    found: Bools = (off < MULTIPLE[0] * lag[:, :, None]) & louder & candidates.exists[:, None, :]
    return np.asarray(found.any(axis=2), dtype=np.float64)


def joint_features(
    alone: Floats,
    odds: Floats,
    depth_mm: Floats,
    candidates: Candidates,
    tracks: Tracks,
    links: Links,
) -> Floats:
    """Return the features (n, k, 13) that the A-scans around add.

    The inner boundary is the last one: a boundary behind a candidate that neighbours see as well,
    and that is no multiple of it, speaks against it.

    Args:
        alone: Features (n, k, 8).
        odds: Log odds (n, k) from the A-scans alone.
        depth_mm: Of the candidates (n, k).
        candidates: The candidates.
        tracks: What all A-scans together say of them, see ``track_before_detect.py``.
        links: Who is beside whom.
    """
    chance = np.where(candidates.exists, 1.0 / (1.0 + np.exp(-np.clip(odds, -30.0, 30.0))), 0.0)
    support = _support(chance, depth_mm, links)
    gap = depth_mm[:, None, :] - depth_mm[:, :, None]  # (n, here, behind)
    later = (gap > APART_MM) & candidates.exists[:, None, :]
    snr = candidates.level / np.maximum(candidates.noise, 1e-12)
    most = loudest_repeat(depth_mm[:, :, None], depth_mm[:, None, :])
    counts = later & (_ratio(snr) >= most)
    behind = np.where(counts, (support * chance)[:, None, :], 0.0).max(axis=2, initial=0.0)
    counts = later & (_ratio(tracks.snr) >= most)
    seen_behind = np.where(counts, tracks.stack[:, None, :], 0.0).max(axis=2, initial=0.0)
    seen_behind = np.clip(seen_behind - STACK_FLOOR, 0.0, STACK_SURE)
    along = np.log(np.maximum(tracks.chance, LEAST_TRACK))
    stack = np.clip(tracks.stack, -1.0, STACKED)
    more = np.stack((behind, seen_behind, support, along, stack), axis=-1)
    return np.concatenate((alone, more), axis=-1)


def _ratio(snr: Floats) -> Floats:
    """Return the level over the noise (n, k) of each candidate over that of each (n, each, k)."""
    return snr[:, None, :] / np.maximum(snr[:, :, None], 1e-12)


def log_odds(values: Floats, weights: tuple[tuple[float, ...], ...], probe: ProbeModel) -> Floats:
    """Return the log odds (n, k) of features (n, k, f), weighted as fits the probe.

    Faint echoes ahead of an inner one that is lost in noise come from within the bone. They go on
    from scan to scan as inner boundaries do, so neighbours are no evidence that they are one.
    """
    low, high = np.log(FITTED_MHZ)
    share = float(np.clip((np.log(probe.centre_mhz) - low) / (high - low), 0.0, 1.0))
    odds = values @ ((1.0 - share) * np.array(weights[0]) + share * np.array(weights[1]))
    return odds + FAINTER * np.minimum(values[..., LEVEL] - np.log(FAINT), 0.0)


def neighbour_weight(links: Links) -> Floats:
    """Return the weight (n, 1), 0 to 1, of the A-scans around: few of them count little."""
    return np.minimum((links.beside >= 0).sum(axis=0) / ENOUGH, 1.0)[:, None]


def _support(chance: Floats, depth_mm: Floats, links: Links) -> Floats:
    """Return how well (n, k), 0 to 1, the A-scans around continue each candidate."""
    total, count = np.zeros(depth_mm.shape), np.zeros(len(depth_mm))
    for sources, apart in zip(links.beside, links.beside_mm, strict=True):
        rows = np.flatnonzero(sources >= 0)
        beside = sources[rows]
        gap = depth_mm[beside][:, None, :] - depth_mm[rows][:, :, None]
        sd = change_sd_mm(apart[rows])[:, None, None]
        continued = chance[beside][:, None, :] * np.exp(-0.5 * (gap / sd) ** 2)
        total[rows] += continued.max(axis=2, initial=0.0)
        count[rows] += 1.0
    return total / np.maximum(count, 1.0)[:, None]


def select_inner_echoes(echoes: Echoes, bone: Material, links: Links) -> InnerEchoes:
    """Return the inner echo of each A-scan of a survey.

    Args:
        echoes: Fronts and candidates.
        bone: Nominal bone.
        links: Who is beside whom.
    """
    found, template = echoes.candidates, echoes.template
    depth = found.lag_us * bone.speed_mm_per_us / 2.0
    probability, behind = inner_probabilities(echoes, depth, bone, links)
    rows, best = np.arange(len(depth)), np.argmax(probability[:, :-1], axis=1)
    same: Bools = np.abs(depth - depth[rows, best][:, None]) < SAME_MM
    confidence = np.sum(probability[:, :-1] * same, axis=1)
    others = np.where(same, 0.0, probability[:, :-1])
    second = np.argmax(others, axis=1)
    fits = _fitted(echoes, best, bone)
    lag, sigma = _timed(fits, confidence, bone, template.probe, links)
    doubted = np.clip(DOUBT[0] - DOUBT[1] * behind[rows, best], 0.0, 1.0)
    moved = np.abs(lag - fits.envelope_us) > MOVED_CYCLES * fits.period_us
    confidence = np.where(moved, MOVED, 1.0) * np.minimum(confidence, doubted)
    return InnerEchoes(
        lag_us=lag,
        confidence=confidence,
        detected=np.asarray(probability[:, -1] < 0.5),
        sigma_us=sigma,
        # which echo it is and which of its cycles are doubted for the same reasons
        slip_chance=1.0 - confidence,
        alternative_us=found.lag_us[rows, second],
        alternative_confidence=others[rows, second],
    )


def inner_probabilities(
    echoes: Echoes, depth_mm: Floats, bone: Material, links: Links
) -> tuple[Floats, Floats]:
    """Return the probability (n, k + 1) of each candidate, and last that none is right.

    The second array (n, k) is how sure a boundary is behind each that is no multiple of it.
    """
    found, probe = echoes.candidates, echoes.template.probe
    grid = inner_grid_mm(probe, bone)
    single = features(found)
    alone = log_odds(single, ALONE, probe)
    tracks = along_tracks(echoes.log_likelihood, echoes.snr, grid, depth_mm, links)
    values = joint_features(single, alone, depth_mm, found, tracks, links)
    share = neighbour_weight(links)
    odds = share * log_odds(values, TOGETHER, probe) + (1.0 - share) * alone
    probability = candidate_probabilities(odds, depth_mm, found.exists, grid, links)
    return probability, share * tracks.behind


def _timed(
    fits: InnerFits, confidence: Floats, bone: Material, probe: ProbeModel, links: Links
) -> tuple[Floats, Floats]:
    """Return the lags (n,) and sigmas, the cycle resolved with the A-scans around."""
    lag, sigma = choose_cycles(fits)
    floor = 2.0 * EXPECTED_SD_MM / bone.speed_mm_per_us
    steep = np.zeros(len(lag))
    for _ in range(CYCLE_ROUNDS):
        expected, sd, steep = predict_lags(lag, sigma, confidence > LIKELY, links)
        lag, sigma = choose_cycles(fits, expected, np.hypot(sd, floor))
    rise = np.minimum(steep, STEEPEST / bone.speed_mm_per_us)
    return lag, np.hypot(sigma, OBLIQUE * (2.0 * probe.aperture_radius_mm) ** 2 * rise)


def _fitted(echoes: Echoes, best: Ints, bone: Material) -> InnerFits:
    """Return the chosen candidates (n,) as fitted by envelope and by phase."""
    found, rows = echoes.candidates, np.arange(len(best))
    lag, level = found.lag_us[rows, best], found.level[rows, best]
    noise, median = found.noise[rows, best], found.clutter[rows, best]
    clutter = np.sqrt(np.maximum(median**2 / RAYLEIGH - SPARE_NOISE * noise**2, 0.0))
    peaks = EnvelopePeaks(lag, level, clutter)
    blocks = [slice(start, start + BLOCK) for start in range(0, max(len(best), 1), BLOCK)]
    return joined(
        [
            fit_inner(
                echoes.aligned[block],
                rows_of(echoes.fronts, block),
                echoes.noise[block],
                rows_of(peaks, block),
                echoes.template,
                bone,
            )
            for block in blocks
        ]
    )
