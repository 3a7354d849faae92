"""Track before detect: likelihood of the inner echo at every depth, before any peak is picked.

Where the echo is hardly louder than the noise no peak stands out, and picking peaks throws away
what many A-scans know together. Here every depth keeps its likelihood ratio, that of a magnitude
with an echo of uncertain loudness against one of noise and clutter alone (Rice against Rayleigh),
and neighbours add up what none of them shows by itself.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.single.inner_echo import STEP_MM
from rona_core.ultrasound.detection.spatial.neighbours import Links

CHANGE_MM = 0.3  # rms difference in thickness, as seen 1 mm apart,
CHANGE_POWER = 0.58  # and how it grows with the distance
LEAST_CHANGE = 0.5  # of that, at any distance
LINKED = 0.85  # share of neighbours that continue the same boundary
DISTANCES_MM = (0.7, 1.2, 1.8, 2.6, 3.7, 5.0)  # links are sorted into these
PLACED_SD_MM = 0.15  # of a peak about the boundary that caused it
SHARED = 0.6  # log odds count for this where neighbours see partly the same clutter
NEIGHBOURS_SHARE = 0.7  # and the message of the neighbours for this: the odds know part of it
TRACK_CHANGE_MM, TRACK_LINKED = 0.1, 0.95  # CHANGE_MM and LINKED of a track
APART_MM = 0.9  # a later boundary is at least this far behind
# times the depth, where echoes of the echo come, and how loud they are at most over it
MULTIPLES = (2.0, 0.4), (3.0, 0.1), (4.0, 0.03)
MULTIPLE = 0.08, 0.3  # share and mm about those
REVERBERATES = 1.6, 0.3  # within the tables: up to this many times the depth, this loud at most
SIDE_LOBES = (3.0, 0.17), (5.0, 0.1)  # mm behind an echo, and what is weaker there may be its own
# mean log likelihood ratio from which on there is a boundary, and is sure
STACK_FLOOR, STACK_SURE = 0.25, 1.5
LAST = 5.0  # log likelihood that a boundary loses for each unit of one behind it
SLOPE_STEPS = 2  # of the grid, by which a boundary may differ from that of a neighbour
NEAR_MM = 0.5  # about a depth, its chance is summed over this much either way


def change_sd_mm(apart_mm: Floats, change_mm: float = CHANGE_MM) -> Floats:
    """Return by how much the thickness of a skull changes over a distance, rms."""
    return change_mm * np.maximum(LEAST_CHANGE, apart_mm**CHANGE_POWER)


def neighbour_density(
    own: Floats, links: Links, *, change_mm: float = CHANGE_MM, linked: float = LINKED
) -> Floats:
    """Return the density (n, m) of each depth given all other A-scans, 1 on average.

    Args:
        own: Likelihood (n, m) of what each A-scan shows, for each depth of a grid.
        links: The neighbours of each.
        change_mm: RMS difference in thickness, 1 mm apart.
        linked: Share of neighbours that continue the same boundary.
    """
    n, m = own.shape
    log_prior = np.zeros((n, m))
    bins = np.searchsorted(DISTANCES_MM[:-1], links.apart_mm)
    kernels = [_kernel(m, float(d), change_mm, linked) for d in DISTANCES_MM]
    for sources, rounds, kinds in zip(links.sources, links.rounds, bins, strict=True):
        message = np.ones((n, m))
        for group in _by_round(rounds):
            sent = own[sources[group]] * message[sources[group]]
            sent /= sent.sum(axis=1, keepdims=True)
            for kind in np.unique(kinds[group]):
                chosen = kinds[group] == kind
                message[group[chosen]] = sent[chosen] @ kernels[kind]
        log_prior += np.log(message)
    prior = np.exp(log_prior - log_prior.max(axis=1, keepdims=True, initial=-np.inf))
    return prior / prior.mean(axis=1, keepdims=True) if n else prior


def _kernel(m: int, apart_mm: float, change_mm: float, linked: float) -> Floats:
    """Return the chance (m, m) of a depth beside a depth, times m."""
    index = np.arange(m)
    sd = float(change_sd_mm(np.array(apart_mm), change_mm))
    gap = (index[:, None] - index[None, :]) * STEP_MM / sd
    bell = np.exp(-0.5 * gap**2)
    bell /= bell.sum(axis=1, keepdims=True)
    return m * linked * bell + (1.0 - linked)


def _by_round(rounds: Ints) -> list[Ints]:
    """Return the A-scans of round 1, of round 2 and so on."""
    order = np.argsort(rounds, kind="stable")
    bounds = np.searchsorted(rounds[order], np.arange(1, rounds.max(initial=0) + 2))
    return [order[a:b] for a, b in pairwise(bounds)]


def candidate_probabilities(
    odds: Floats, depth_mm: Floats, exists: Bools, grid_mm: Floats, links: Links
) -> Floats:
    """Return the probability (n, k + 1) of each candidate, and last that none is right.

    Args:
        odds: Log odds (n, k) of each candidate against none, from its own A-scan.
        depth_mm: Where it would put the boundary (n, k).
        exists: Which candidates there are (n, k).
        grid_mm: Depths (m,).
        links: The neighbours of each A-scan.
    """
    near = _bells(depth_mm, grid_mm)  # (n, k, m), mean 1 over the grid
    own = 1.0 + np.einsum("nk,nkm->nm", np.where(exists, np.exp(SHARED * odds), 0.0), near)
    prior = neighbour_density(own, links)
    expected = np.einsum("nkm,nm->nk", near, prior) / len(grid_mm)
    weight = np.where(exists, np.exp(odds) * expected**NEIGHBOURS_SHARE, 0.0)
    total = 1.0 + weight.sum(axis=1)
    return np.column_stack((weight, np.ones(len(odds)))) / total[:, None]


def _bells(depth_mm: Floats, grid_mm: Floats) -> Floats:
    bells: Floats = depth_mm[:, :, None] - grid_mm[None, None, :]
    bells /= PLACED_SD_MM
    np.square(bells, out=bells)  # in place: they are the largest array of the detection
    bells *= -0.5
    np.exp(bells, out=bells)
    bells /= PLACED_SD_MM * np.sqrt(2.0 * np.pi) / STEP_MM / len(grid_mm)
    return bells


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """What all A-scans together show at depths (n, k)."""

    chance: Floats  # that the last boundary runs near it
    stack: Floats  # mean log likelihood ratio for a boundary
    snr: Floats  # mean level over the noise
    behind: Floats  # that another boundary is behind, with a peak of its own: 0 to STACK_SURE


def stacked(log_likelihood: Floats, links: Links) -> Floats:
    """Return the mean log likelihood ratio (n, m) of each A-scan and its neighbours, by depth.

    Unlike the chances of tracks this is no contest: two boundaries, one behind the other, both
    have it. Where there is nothing it is about 0.
    """
    wide = maximum_filter1d(log_likelihood, 2 * SLOPE_STEPS + 1, axis=1, mode="nearest")
    return _mean_around(log_likelihood, wide, links)


def _mean_around(own: Floats, others: Floats, links: Links) -> Floats:
    total, count = own.copy(), np.ones((len(own), 1))
    for sources in links.around:
        rows = np.flatnonzero(sources >= 0)
        total[rows] += others[sources[rows]]
        count[rows] += 1.0
    mean: Floats = total / count
    return mean


def seen_behind(stack: Floats, snr: Floats, grid_mm: Floats) -> Floats:
    """Return how sure another boundary lies behind each depth, 0 to ``STACK_SURE``, as ``stack``.

    Args:
        stack: Mean log likelihood ratio for a boundary (n, m), or several of them (s, n, m).
        snr: Mean level over the noise (n, m): a multiple or a side lobe does not count.
        grid_mm: Depths (m,).
    """
    # depths first: what is compared lies side by side
    sure = np.clip(np.moveaxis(stack, -1, 0) - STACK_FLOOR, 0.0, STACK_SURE, order="C")
    level = np.ascontiguousarray(snr.T)
    behind = np.zeros(sure.shape)
    most = loudest_repeat(grid_mm[:, None], grid_mm)
    for i, first in enumerate(np.searchsorted(grid_mm, grid_mm + APART_MM)):
        if first >= len(grid_mm):
            break
        counts = level[first:] >= most[i, first:, None] * np.maximum(level[i], 1e-12)
        counts = counts.reshape(len(counts), *(1,) * (sure.ndim - 2), -1)
        np.max(np.where(counts, sure[first:], 0.0), axis=0, out=behind[i])
    return np.ascontiguousarray(np.moveaxis(behind, 0, -1))


def _summits(snr: Floats) -> Bools:
    """Return where levels (n, m) are highest within 0.5 mm: not on the flank of an echo."""
    reach = 2 * round(NEAR_MM / STEP_MM) + 1
    return np.asarray(snr >= maximum_filter1d(snr, reach, axis=1, mode="nearest"))


def loudest_repeat(depth_mm: float | Floats, behind_mm: Floats) -> Floats:
    """Return the level over that of an echo below which something behind it may come from it.

    It may be a multiple, or a side lobe.

    Args:
        depth_mm: Of the echo.
        behind_mm: Of what is behind it.
    """
    times, most = REVERBERATES
    (near, high), (far, low) = SIDE_LOBES
    level = np.interp(behind_mm - depth_mm, (near, far), (high, low))
    level = np.maximum(level, np.where(behind_mm < times * depth_mm, most, 0.0))
    for times, most in MULTIPLES:
        off = np.abs(behind_mm - times * depth_mm)
        multiple = off < MULTIPLE[0] * behind_mm + MULTIPLE[1]
        level = np.maximum(level, np.where(multiple, most, 0.0))
    return np.asarray(level)


def at_depths(values: Floats, grid_mm: Floats, depth_mm: Floats) -> Floats:
    """Return what a grid of depths has (n, m) at depths (n, k)."""
    at = np.clip(np.rint((depth_mm - grid_mm[0]) / STEP_MM).astype(np.int64), 0, len(grid_mm) - 1)
    return np.asarray(np.take_along_axis(values, at, axis=1), dtype=np.float64)


def track_chances(
    log_likelihood: Floats, grid_mm: Floats, depth_mm: Floats, links: Links
) -> Floats:
    """Return how likely (n, k) the boundary runs near depths (n, k), all A-scans together.

    Args:
        log_likelihood: Of each A-scan for each depth (n, m).
        grid_mm: Those depths (m,).
        depth_mm: What is asked for (n, k).
        links: Who is beside whom.
    """
    if not len(log_likelihood):
        return np.zeros(depth_mm.shape)
    density = neighbour_density(
        np.exp(log_likelihood), links, change_mm=TRACK_CHANGE_MM, linked=TRACK_LINKED
    )
    odds = np.log(density) + log_likelihood
    chance = np.exp(odds - odds.max(axis=1, keepdims=True))
    total = np.cumsum(chance / chance.sum(axis=1, keepdims=True), axis=1)
    total = np.column_stack((np.zeros(len(total)), total))
    at = np.rint((depth_mm - grid_mm[0]) / STEP_MM).astype(np.int64)
    reach = round(NEAR_MM / STEP_MM)
    rows = np.arange(len(total))[:, None]
    first = np.clip(at - reach, 0, len(grid_mm))
    after = np.clip(at + reach + 1, 0, len(grid_mm))
    return np.asarray(total[rows, after] - total[rows, first], dtype=np.float64)


def along_tracks(
    log_likelihood: Floats, snr: Floats, grid_mm: Floats, depth_mm: Floats, links: Links
) -> Tracks:
    """Return what all A-scans together say of depths (n, k).

    Args:
        log_likelihood: Of each A-scan for each depth (n, m).
        snr: Level over the noise (n, m).
        grid_mm: Those depths (m,).
        depth_mm: What is asked for (n, k).
        links: Who is beside whom.
    """
    stack, mean = stacked(log_likelihood, links), _mean_around(snr, snr, links)
    both = np.stack((stack, np.where(_summits(mean), stack, 0.0)))
    behind, peaks = seen_behind(both, mean, grid_mm)
    return Tracks(
        track_chances(log_likelihood - LAST * behind, grid_mm, depth_mm, links),
        at_depths(stack, grid_mm, depth_mm),
        at_depths(mean, grid_mm, depth_mm),
        at_depths(peaks, grid_mm, depth_mm),
    )
