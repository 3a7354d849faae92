"""Hampel filter about local planes: samples that disagree with their neighbours (Hampel 1974)."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.robust import MAD_TO_SIGMA

NEIGHBOURS = 14
LEAST = 6  # fewer neighbours than this judge nobody
THRESHOLD = 3.5  # in robust standard deviations of the neighbourhood
FLOOR_MM = 0.08  # a scatter smaller than this is not believed
REACH_MM = 12.0  # neighbours further off do not count
ROUNDS = 3
REWEIGHTS = 8
RIDGE = 1e-9  # keeps neighbours on one line solvable


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
    n = len(values)
    if len(rows) <= LEAST:
        return np.zeros(n), np.full(n, np.inf)
    distance, near = KDTree(places[rows]).query(places, k=min(NEIGHBOURS + 1, len(rows)))
    others = rows[np.asarray(near)]  # (n, k), a sample that is kept is among its own neighbours
    counts = (np.asarray(distance) <= REACH_MM) & (others != np.arange(n)[:, None])
    offset = places[others] - places[:, None, :]
    design = np.concatenate((np.ones((*others.shape, 1)), offset), axis=2)
    target = values[others]
    weights = counts.astype(np.float64)
    plane, residuals = np.zeros((n, 3)), target
    for _ in range(REWEIGHTS):  # by absolute residual, so that outliers lose their say
        weighted = design * weights[..., None]
        normal = np.einsum("nki,nkj->nij", weighted, design) + RIDGE * np.eye(3)
        right = np.einsum("nki,nk->ni", weighted, target)
        plane = np.linalg.solve(normal, right[..., None])[..., 0]
        residuals = target - np.einsum("nki,ni->nk", design, plane)
        weights = counts / np.maximum(np.abs(residuals), FLOOR_MM)
    spread = np.ma.median(np.ma.masked_array(np.abs(residuals), ~counts), axis=1).filled(np.inf)
    judged = counts.sum(axis=1) >= LEAST
    residual = np.where(judged, values - plane[:, 0], 0.0)
    return residual, np.where(judged, MAD_TO_SIGMA * spread, np.inf)
