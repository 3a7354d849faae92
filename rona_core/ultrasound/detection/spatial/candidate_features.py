"""Likelihood features of a candidate: from its own A-scan, then from those around it.

Log odds are linear in a few plain features. Their weights were fitted to bone whose inner boundary
is known (``benchmarks/tune_evidence.py``), for two probes; others take what lies between.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.single.inner_echo import Candidates
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links
from rona_core.ultrasound.detection.spatial.semi_global_matching import change_sd_mm
from rona_core.ultrasound.detection.spatial.track_before_detect import (
    APART_MM,
    MULTIPLE,
    STACK_FLOOR,
    STACK_SURE,
    Tracks,
    repeats,
)
from rona_core.ultrasound.probe.probe_model import ProbeModel

LOUDEST = 0.5  # log level over which nothing is too loud: bone may lose less than nominal bone
FAINT = 0.2  # level under which it is hardly an inner echo, even of an oblique table:
FAINTER = 6.0  # log odds lost for each time that it is 2.7 times fainter, whoever supports it
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
    counts = later & ~_explained(depth_mm, snr)
    behind = np.where(counts, (support * chance)[:, None, :], 0.0).max(axis=2, initial=0.0)
    counts = later & ~_explained(depth_mm, tracks.snr)
    seen_behind = np.where(counts, tracks.stack[:, None, :], 0.0).max(axis=2, initial=0.0)
    seen_behind = np.clip(seen_behind - STACK_FLOOR, 0.0, STACK_SURE)
    along = np.log(np.maximum(tracks.chance, LEAST_TRACK))
    stack = np.clip(tracks.stack, -1.0, STACKED)
    more = np.stack((behind, seen_behind, support, along, stack), axis=-1)
    return np.concatenate((alone, more), axis=-1)


def _explained(depth_mm: Floats, snr: Floats) -> Bools:
    """Return (n, here, behind) whether what is behind one (n, k) may be an echo of that one."""
    ratio = snr[:, None, :] / np.maximum(snr[:, :, None], 1e-12)
    return repeats(depth_mm[:, :, None], depth_mm[:, None, :], ratio)


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
