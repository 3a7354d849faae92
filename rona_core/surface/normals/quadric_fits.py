"""Quadric fits (osculating jets) of many neighbourhoods at once: normals free of curvature bias.

A plane through points that lie on one side only leans with the curvature; a quadric
z = a + b u + c v + d u^2 + e u v + f v^2 over the plane bends with it, and its slope at the place
is the normal there (Cazals and Pouget 2005, docs/references.md).
"""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.surface.normals.neighbourhoods import Neighbourhoods

COEFFICIENTS = 6
TURNS = 2  # the height is measured along the plane's normal first, then along the quadric's
RANK = 1e-10  # eigenvalue of the normal equations over the largest; below it there is no quadric


@dataclass(frozen=True, slots=True, eq=False)
class Jets:
    """One quadric for each of b neighbourhoods."""

    normals: Floats  # (b, 3) unit, on the side of the planes' normals
    noise_mm2: Floats  # (b,) variance of one point about the quadric; 0 without spare points
    gain: Floats  # (b,) variance of the normal in rad^2 over that of one point, 1/mm^2
    curvatures: Floats  # (b, 2) principal curvatures, 1/mm, larger size first
    solved: Bools  # (b,) whether the points determine all coefficients


def fit_jets(near: Neighbourhoods, normals: Floats, radius_mm: float) -> Jets:
    """Return the quadrics over planes with ``normals`` (b, 3), each taken at its place.

    Lengths along the plane are scaled by ``radius_mm`` so that the equations are well balanced.
    """
    weights = near.there[:, :, None].astype(np.float64)
    spare = np.maximum(near.there.sum(axis=1) - COEFFICIENTS, 0)
    gain = noise = np.zeros(len(normals))
    solved: Bools = np.zeros(len(normals), dtype=bool)
    curvatures = np.zeros((len(normals), 2))
    for _ in range(TURNS):
        frames = _frames(normals)
        u, v, z = np.moveaxis(near.offsets @ frames.transpose(0, 2, 1), 2, 0)
        u, v = u / radius_mm, v / radius_mm
        design = np.stack((np.ones_like(u), u, v, u * u, u * v, v * v), axis=2) * weights
        squares = design.transpose(0, 2, 1) @ design
        sizes, axes = np.linalg.eigh(squares)
        solid = sizes > RANK * sizes[:, -1:]
        inverse = (axes * np.where(solid, 1.0 / np.where(solid, sizes, 1.0), 0.0)[:, None]) @ (
            axes.transpose(0, 2, 1)
        )
        c = (inverse @ (design.transpose(0, 2, 1) @ z[:, :, None]))[:, :, 0]
        residuals = z * weights[:, :, 0] - (design @ c[:, :, None])[:, :, 0]
        noise = np.where(spare > 0, (residuals**2).sum(axis=1) / np.maximum(spare, 1), 0.0)
        slopes = c[:, 1:3] / radius_mm
        flat = 1.0 + (slopes**2).sum(axis=1)
        gain = (inverse[:, 1, 1] + inverse[:, 2, 2]) / radius_mm**2 / flat
        solved = np.asarray(solid.all(axis=1))
        curvatures = _curvatures(c[:, 3:] / radius_mm**2)
        local = np.column_stack((-slopes, np.ones(len(c)))) / np.sqrt(flat)[:, None]
        normals = np.einsum("bi,bij->bj", local, frames)
    return Jets(normals, noise, gain, curvatures, solved)


def _frames(normals: Floats) -> Floats:
    """Return right-handed frames (b, 3, 3) as rows, the last one along each normal."""
    helper = np.eye(3)[np.abs(normals).argmin(axis=1)]
    x: Floats = np.cross(helper, normals)
    x /= np.linalg.norm(x, axis=1)[:, None]
    y: Floats = np.cross(normals, x)
    return np.stack((x, y, normals), axis=1)


def _curvatures(second: Floats) -> Floats:
    """Return the eigenvalues (b, 2) of the second derivatives (d, e, f), larger size first."""
    d, e, f = second.T
    mean, split = d + f, np.hypot(d - f, e)
    both = np.stack((mean + split, mean - split), axis=1)
    order = np.argsort(-np.abs(both), axis=1)
    return np.take_along_axis(both, order, axis=1)
