"""Plane fits of many neighbourhoods at once: regression, total least squares, robust."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.geometry.robust import (
    CAUCHY_SCALE,
    MAD_TO_SIGMA,
    TUKEY_CUTOFF,
    cauchy_weights,
    tukey_weights,
)
from rona_core.surface.normals.spatial_hash import Neighbourhoods

CAUCHY_ROUNDS, TUKEY_ROUNDS = 5, 10
PARAMETERS = 3  # of a plane


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """One plane for each of b neighbourhoods."""

    normals: Floats  # (b, 3) unit, sign open; zero where there is none
    eigenvalues: Floats  # (b, 3) variances of the (weighted) points, ascending, mm^2
    centroids: Floats  # (b, 3) from the place
    noise_mm2: Floats  # (b,) variance of one point about the plane
    weight: Floats  # (b,) points that count, the doubted ones in part


def fit_tls(near: Neighbourhoods) -> Planes:
    """Return the planes of least squared distances."""
    return _fitted(near.offsets, near.there.astype(np.float64))[0]


def fit_ols(near: Neighbourhoods) -> Planes:
    """Return the paper's regression planes: Equation 2 with the largest denominator."""
    planes, scatter = _fitted(near.offsets, near.there.astype(np.float64))
    return Planes(
        normals=_regression_normals(scatter),
        eigenvalues=planes.eigenvalues,
        centroids=planes.centroids,
        noise_mm2=planes.noise_mm2,
        weight=planes.weight,
    )


def fit_robust(near: Neighbourhoods) -> Planes:
    """Return planes that outliers do not tilt: iteratively reweighted total least squares.

    Weights after Cauchy lead near the answer from any start, Tukey's then give what lies beyond
    4.7 sigma no say at all. The sigma of a neighbourhood is its median absolute distance, scaled.
    """
    present = near.there.astype(np.float64)
    count = near.there.sum(axis=1)
    planes = _fitted(near.offsets, present)[0]
    sigma = np.zeros(len(count))
    for turn in range(CAUCHY_ROUNDS + TUKEY_ROUNDS):
        distances = np.einsum("bki,bi->bk", near.offsets, planes.normals)
        distances -= np.einsum("bi,bi->b", planes.centroids, planes.normals)[:, None]
        sorted_distances = np.sort(np.where(near.there, np.abs(distances), np.inf), axis=1)
        sigma = MAD_TO_SIGMA * sorted_distances[np.arange(len(count)), (count - 1) // 2]
        scaled = distances / np.maximum(sigma, 1e-12)[:, None]
        if turn < CAUCHY_ROUNDS:
            weights = present * cauchy_weights(scaled, CAUCHY_SCALE)
        else:
            weights = present * tukey_weights(scaled, TUKEY_CUTOFF)
        planes = _fitted(near.offsets, weights)[0]
    return Planes(
        normals=planes.normals,
        eigenvalues=planes.eigenvalues,
        centroids=planes.centroids,
        noise_mm2=sigma**2 * count / np.maximum(count - PARAMETERS, 1),
        weight=planes.weight,
    )


def _fitted(offsets: Floats, weights: Floats) -> tuple[Planes, Floats]:
    """Return total least squares with weights (b, k), and the scatter matrices (b, 3, 3)."""
    total = weights.sum(axis=1)
    safe = np.maximum(total, 1e-300)
    centroids = np.einsum("bk,bki->bi", weights, offsets) / safe[:, None]
    centred = offsets - centroids[:, None]
    scatter = (weights[:, :, None] * centred).transpose(0, 2, 1) @ centred / safe[:, None, None]
    eigenvalues, axes = np.linalg.eigh(scatter)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    return Planes(axes[:, :, 0], eigenvalues, centroids, eigenvalues[:, 0], total), scatter


def _regression_normals(scatter: Floats) -> Floats:
    """Return the paper's normals (b, 3) by Equation 2, up to sign; zero where there is no plane.

    With a = 1 the normal is (Syz^2 - Szz Syy, Szz Sxy - Syz Sxz, Sxz Syy - Syz Sxy); b = 1 and
    c = 1 follow by exchanging the letters. The element set to 1 holds its denominator.
    """
    xx, yy, zz = scatter[:, 0, 0], scatter[:, 1, 1], scatter[:, 2, 2]
    xy, xz, yz = scatter[:, 0, 1], scatter[:, 0, 2], scatter[:, 1, 2]
    variants = np.stack(
        (
            np.stack((yz**2 - zz * yy, zz * xy - yz * xz, xz * yy - yz * xy), axis=1),
            np.stack((zz * xy - xz * yz, xz**2 - zz * xx, yz * xx - xz * xy), axis=1),
            np.stack((xz * yy - xy * yz, yz * xx - xy * xz, xy**2 - yy * xx), axis=1),
        ),
        axis=1,
    )
    denominators = np.abs(np.einsum("mii->mi", variants))
    chosen = variants[np.arange(len(scatter)), denominators.argmax(axis=1)]
    lengths = np.linalg.norm(chosen, axis=1)[:, None]
    return np.divide(chosen, lengths, out=np.zeros_like(chosen), where=lengths > 0)
