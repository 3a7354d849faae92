"""Drop samples that disagree with their neighbours (Hampel's filter about local planes)."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.arrays import Bools, Floats

NEIGHBOURS = 14
LEAST = 6  # fewer neighbours than this judge nobody
THRESHOLD = 3.5  # in robust standard deviations of the neighbourhood
MAD_TO_SD = 1.4826
FLOOR_MM = 0.08  # a scatter smaller than this is not believed
REACH_MM = 12.0  # neighbours further off do not count
ROUNDS = 3


def agreeing(places_mm: Floats, values_mm: Floats) -> Bools:
    """Return which samples (n,) agree with the plane through the values of their neighbours.

    Args:
        places_mm: Where the samples lie (n, 2).
        values_mm: What they say (n,).
    """
    kept = np.ones(len(values_mm), dtype=np.bool_)
    for _ in range(ROUNDS):
        residual, scale = _against_neighbours(places_mm, values_mm, kept)
        agree = np.abs(residual) <= THRESHOLD * np.maximum(scale, FLOOR_MM)
        if np.array_equal(agree, kept):
            break
        kept = agree
    return kept


def _against_neighbours(places: Floats, values: Floats, kept: Bools) -> tuple[Floats, Floats]:
    """Return the distance of each value to its neighbours' robust plane, and their scatter."""
    rows = np.flatnonzero(kept)
    residual, scale = np.zeros(len(values)), np.full(len(values), np.inf)
    if len(rows) <= LEAST:
        return residual, scale
    count = min(NEIGHBOURS + 1, len(rows))
    distance, near = KDTree(places[rows]).query(places, k=count)
    for i in range(len(values)):
        others = rows[near[i]][(distance[i] <= REACH_MM) & (rows[near[i]] != i)]
        if len(others) < LEAST:
            continue
        design = np.column_stack((np.ones(len(others)), places[others] - places[i]))
        weights = np.ones(len(others))
        for _ in range(3):  # reweighted by absolute residual, so that outliers lose their say
            root = np.sqrt(weights)
            plane = np.linalg.lstsq(design * root[:, None], values[others] * root)[0]
            left = values[others] - design @ plane
            weights = 1.0 / np.maximum(np.abs(left), FLOOR_MM)
        residual[i] = values[i] - plane[0]
        scale[i] = MAD_TO_SD * float(np.median(np.abs(left - np.median(left))))
    return residual, scale
