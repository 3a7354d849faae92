"""Hampel filter about local planes: samples that disagree with their neighbours (Hampel 1974)."""

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.robust import MAD_TO_SIGMA

NEIGHBOURS = 14
LEAST = 6  # with fewer neighbours no point is judged
THRESHOLD = 3.5  # in robust standard deviations of the neighbourhood
FLOOR_MM = 0.08  # a scatter smaller than this is not believed
REACH_MM = 12.0  # neighbours further off do not count
ROUNDS = 3
REWEIGHTS = 8
SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))  # places of a matrix in its upper half
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
    i, j = np.triu_indices(3)
    products = design[..., i] * design[..., j]
    target = values[others]
    weights = counts.astype(np.float64)
    plane, residuals = np.zeros((n, 3)), target
    for _ in range(REWEIGHTS):  # by absolute residual, so that outliers lose their say
        normal = (weights[:, None, :] @ products)[:, 0, SYMMETRIC] + RIDGE * np.eye(3)
        right = (weights * target)[:, None, :] @ design
        plane = np.linalg.solve(normal, right.transpose(0, 2, 1))[..., 0]
        residuals = target - (design @ plane[..., None])[..., 0]
        weights = counts / np.maximum(np.abs(residuals), FLOOR_MM)
    ranked, number = np.sort(np.where(counts, np.abs(residuals), np.inf)), counts.sum(axis=1)
    middle = np.stack(((number - 1) // 2, number // 2), axis=1)
    spread = np.take_along_axis(ranked, middle, axis=1).mean(axis=1)
    judged = number >= LEAST
    residual = np.where(judged, values - plane[:, 0], 0.0)
    return residual, np.where(judged, MAD_TO_SIGMA * spread, np.inf)
