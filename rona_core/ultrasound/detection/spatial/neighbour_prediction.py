"""What the A-scans around one make of its inner boundary: the plane that fits them best.

The envelope of an echo that is hardly louder than the noise says to a cycle or two when it comes,
its phase says it to a fraction of one. Two dozen envelopes on one plane say which cycle.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.detection.spatial.neighbour_graph import Links

BENT_US_PER_MM = 0.02  # how far, for each mm of distance, a boundary leaves its plane
STEEP_US_PER_MM = 0.3  # rms slope to be expected
ROBUST_ROUNDS = 3
OUTLYING = 2.0  # sigmas from the plane, where a neighbour counts half
FEW = 3  # neighbours that show a slope


def expected_lags(
    lag_us: Floats, sigma_us: Floats, counts: Bools, links: Links
) -> tuple[Floats, Floats, Floats]:
    """Return the lag (n,) that the plane through the neighbours has here, its sd, and its slope.

    Args:
        lag_us: Of each A-scan (n,).
        sigma_us: And how far off it may be.
        counts: Which ones are asked (n,).
        links: Who is around whom.

    The sd is infinite where no neighbour counts. Where fewer than three do, no more is known of the
    slope than how steep bone usually is; in us per mm, it is 0 there.
    """
    there = links.around
    asked = (there >= 0) & counts[there]
    distance = np.hypot(links.around_mm[..., 0], links.around_mm[..., 1])
    variance = sigma_us[there] ** 2 + (BENT_US_PER_MM * distance) ** 2
    known = np.where(asked, 1.0 / np.maximum(variance, 1e-12), 0.0)
    design = np.concatenate((np.ones((*there.shape, 1)), links.around_mm), axis=2)
    seen = np.where(asked, lag_us[there], 0.0)
    start = _weighted_median(seen, known)
    ridge = np.diag((0.0, STEEP_US_PER_MM**-2, STEEP_US_PER_MM**-2)) + 1e-9 * np.eye(3)
    plane = np.column_stack((start, np.zeros((len(lag_us), 2))))
    inverse = np.zeros((len(lag_us), 3, 3))
    for _ in range(ROBUST_ROUNDS):
        off = (seen - np.einsum("knj,nj->kn", design, plane)) ** 2 * known
        weight = known / (1.0 + off / OUTLYING**2)
        normal = np.einsum("kn,kni,knj->nij", weight, design, design) + ridge
        right = np.einsum("kn,kn,kni->ni", weight, seen - start, design)
        inverse = np.linalg.inv(normal)
        plane = np.einsum("nij,nj->ni", inverse, right)
        plane[:, 0] += start
    some, enough = asked.any(axis=0), asked.sum(axis=0) >= FEW
    off = np.where(asked, (seen - np.einsum("knj,nj->kn", design, plane)) ** 2 * known, 0.0)
    excess = (off / (1.0 + off / OUTLYING**2)).sum(axis=0) / np.maximum(asked.sum(axis=0), 1)
    sd = np.sqrt(inverse[:, 0, 0] * np.maximum(excess, 1.0))
    return (
        np.where(some, plane[:, 0], lag_us),
        np.where(some, sd, np.inf),
        np.where(enough, np.hypot(plane[:, 1], plane[:, 2]), 0.0),
    )


def _weighted_median(values: Floats, weights: Floats) -> Floats:
    """Return the weighted medians (n,) of the columns of (k, n)."""
    order = np.argsort(values, axis=0)
    share = np.cumsum(np.take_along_axis(weights, order, axis=0), axis=0)
    at = np.argmax(share >= 0.5 * share[-1:], axis=0)
    rows = np.arange(values.shape[1])
    return values[order[at, rows], rows]
