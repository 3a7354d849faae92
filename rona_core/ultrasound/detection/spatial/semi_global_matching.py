"""Semi-global matching of neighbouring A-scans, with probabilities (Hirschmüller 2008).

Every A-scan has a thickness on a grid of depths. Its own likelihood says how probable each is; from
eight directions it receives messages of the scans on that side, each of them with the message of
the next one that way. Eight lines that meet in a scan form a tree, on which summing is exact; the
summing counterpart of the truncated quadratic of Hirschmueller is a bell with a floor.
"""

from itertools import pairwise

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.detection.single.depth_likelihood import STEP_MM
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links

CHANGE_MM = 0.3  # rms difference in thickness, as seen 1 mm apart,
CHANGE_POWER = 0.58  # and how it grows with the distance
LEAST_CHANGE = 0.5  # of that, at any distance
LINKED = 0.85  # share of neighbours that continue the same boundary
DISTANCES_MM = (0.7, 1.2, 1.8, 2.6, 3.7, 5.0)  # links are sorted into these
PLACED_SD_MM = 0.15  # of a peak about the boundary that caused it
SHARED = 0.6  # log odds count for this where neighbours see partly the same clutter
NEIGHBOURS_SHARE = 0.7  # and the message of the neighbours for this: the odds know part of it


def change_sd_mm(apart_mm: Floats, change_mm: float = CHANGE_MM) -> Floats:
    """Return by how much the thickness of a skull changes over a distance, rms."""
    return change_mm * np.maximum(LEAST_CHANGE, apart_mm**CHANGE_POWER)


def neighbour_density(
    own: Floats, links: Links, *, change_mm: float = CHANGE_MM, linked: float = LINKED
) -> Floats:
    """Return the density (n, m) of each depth given all other A-scans, 1 on average.

    Args:
        own: Likelihood (n, m) of what each A-scan shows, for each depth of a grid.
        links: From whom each hears.
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
        links: From whom each A-scan hears.
    """
    near = _bells(depth_mm, grid_mm)  # (n, k, m), mean 1 over the grid
    own = 1.0 + np.einsum("nk,nkm->nm", np.where(exists, np.exp(SHARED * odds), 0.0), near)
    prior = neighbour_density(own, links)
    expected = np.einsum("nkm,nm->nk", near, prior) / len(grid_mm)
    weight = np.where(exists, np.exp(odds) * expected**NEIGHBOURS_SHARE, 0.0)
    total = 1.0 + weight.sum(axis=1)
    return np.column_stack((weight, np.ones(len(odds)))) / total[:, None]


def _bells(depth_mm: Floats, grid_mm: Floats) -> Floats:
    gap = (depth_mm[:, :, None] - grid_mm[None, None, :]) / PLACED_SD_MM
    bell = np.exp(-0.5 * gap**2)
    norm = PLACED_SD_MM * np.sqrt(2.0 * np.pi) / STEP_MM / len(grid_mm)
    return bell / norm
