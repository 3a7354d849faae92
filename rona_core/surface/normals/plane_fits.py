"""Plane fits of many neighbourhoods at once: regression and total least squares."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.surface.normals.neighbourhoods import Neighbourhoods


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """One plane for each of b neighbourhoods."""

    normals: Floats  # (b, 3) unit, sign open; zero where there is none
    eigenvalues: Floats  # (b, 3) variances of the points, ascending, mm^2
    centroids: Floats  # (b, 3) from the place


def fit_tls(near: Neighbourhoods) -> Planes:
    """Return the planes of least squared distances."""
    return _fitted(near)[0]


def fit_ols(near: Neighbourhoods) -> Planes:
    """Return the paper's regression planes: Equation 2 with the largest denominator."""
    planes, scatter = _fitted(near)
    return Planes(_regression_normals(scatter), planes.eigenvalues, planes.centroids)


def _fitted(near: Neighbourhoods) -> tuple[Planes, Floats]:
    """Return the planes by total least squares, and the scatter matrices (b, 3, 3)."""
    weights = near.there.astype(np.float64)
    count = np.maximum(weights.sum(axis=1), 1.0)
    centroids = np.einsum("bk,bki->bi", weights, near.offsets) / count[:, None]
    centred = (near.offsets - centroids[:, None]) * weights[:, :, None]
    scatter = centred.transpose(0, 2, 1) @ centred / count[:, None, None]
    eigenvalues, axes = np.linalg.eigh(scatter)
    return Planes(axes[:, :, 0], np.maximum(eigenvalues, 0.0), centroids), scatter


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
