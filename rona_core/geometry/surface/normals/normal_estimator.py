"""Estimation of normals with one radius: fit, predicted error and flags."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.surface.normals.neighbourhood_fits import (
    COEFFICIENTS,
    Neighbourhoods,
    Planes,
    fit_jets,
    fit_ols,
    fit_tls,
    neighbourhoods,
)

NormalMethod = Literal["jet", "ols"]
METHODS: tuple[NormalMethod, ...] = ("jet", "ols")

MIN_COUNT = 10  # points; with fewer, chance makes them look flatter than they are
MAX_SIGMA_DEG = 5.0  # predicted; beyond it the probe hears nothing
MIN_SPARE = 4  # points more than a quadric has coefficients
MIN_FLATNESS = 9.0  # variance across the narrow direction of the patch over that along the normal
MIN_WIDTH = 0.05  # variance across the patch over that along it; a single strand is below
MAX_OFF_CENTRE = 0.3  # of the radius; the centroid of half a disc is at 0.42
DISC_GAIN = 8.0  # gain of a full disc times its points and its radius squared
MAX_GAIN = 225.0  # in full discs of as many points: 15 times their error
# indices into normals.FLAGS; 0: nothing is wrong
TOO_FEW, RANK_DEFICIENT, NOT_FLAT, ONE_SIDED, EDGE_ON, UNCERTAIN = 1, 2, 3, 4, 5, 6
SURE = 2.0  # sigma of a variance by which it must exceed the noise to count as relief,
SLACK = 0.15  # and this share of the noise, which is not known better


@dataclass(slots=True, eq=False)
class Estimates:
    """Results at m places, before they are turned outward."""

    normals: Floats  # (m, 3) sign open, zero where there is none
    count: Ints  # (m,)
    eigenvalues: Floats  # (m, 3) mm^2
    sigma_deg: Floats  # (m,)
    flag: Ints  # (m,) index into the names of normals.FLAGS
    noise_mm2: Floats  # (m,) variance of one point about the surface
    gain: Floats  # (m,) variance of the normal over that of one point, rad^2/mm^2
    curvature_per_mm: Floats  # (m,) the larger one by size; 0 for planes

    def select(self, rows: Ints | np.ndarray) -> "Estimates":
        """Return those of some places."""
        return Estimates(*(getattr(self, name)[rows] for name in self.__slots__))

    def replace(self, rows: Ints, other: "Estimates") -> None:
        """Put ``other`` in the place of ``rows``."""
        for name in self.__slots__:
            getattr(self, name)[rows] = getattr(other, name)


def estimate(
    tree: KDTree, places: Floats, radius_mm: float, method: NormalMethod, noise_mm: float | None
) -> Estimates:
    """Return the normals at ``places`` (m, 3) from the points within ``radius_mm``.

    Args:
        tree: The cloud.
        places: Where, in the frame of the cloud.
        radius_mm: Size of the neighbourhoods.
        method: How to fit.
        noise_mm: Noise of one point, for telling relief from noise where a quadric is fitted;
            None where it is unknown: then all scatter is noise.
    """
    m = len(places)
    found = Estimates(
        normals=np.zeros((m, 3)),
        count=np.zeros(m, dtype=np.int64),
        eigenvalues=np.zeros((m, 3)),
        sigma_deg=np.full(m, 180.0),
        flag=np.ones(m, dtype=np.int64),
        noise_mm2=np.zeros(m),
        gain=np.zeros(m),
        curvature_per_mm=np.zeros(m),
    )
    for near in neighbourhoods(tree, places, radius_mm):
        count = near.there.sum(axis=1)
        if method == "jet":
            part = _from_jets(near, count, radius_mm, noise_mm)
        else:
            part = _from_planes(fit_ols(near), count, radius_mm)
        found.replace(near.rows, part)
    return found


def _from_planes(planes: Planes, count: Ints, radius_mm: float) -> Estimates:
    thin, narrow, wide = planes.eigenvalues.T
    solid = (count >= 3) & (narrow > 0)
    across, along = np.where(solid, narrow, 1.0), np.where(solid, wide, 1.0)
    gain = (1.0 / across + 1.0 / along) / np.maximum(count, 1)
    sigma = np.rad2deg(np.sqrt(thin * gain))
    middle = planes.centroids
    off = np.linalg.norm(
        middle - np.einsum("bi,bi->b", middle, planes.normals)[:, None] * planes.normals, axis=1
    )
    flag = _shape_flags(planes, count, MIN_COUNT)
    flag = np.where((flag == 0) & (off > MAX_OFF_CENTRE * radius_mm), ONE_SIDED, flag)
    flag = np.where((flag == 0) & (sigma > MAX_SIGMA_DEG), UNCERTAIN, flag)
    return Estimates(
        normals=planes.normals,
        count=count,
        eigenvalues=planes.eigenvalues,
        sigma_deg=np.where(solid, np.minimum(sigma, 180.0), 180.0),
        flag=flag,
        noise_mm2=thin,
        gain=np.where(solid, gain, 0.0),
        curvature_per_mm=np.zeros(len(count)),
    )


def _from_jets(
    near: Neighbourhoods, count: Ints, radius_mm: float, noise_mm: float | None
) -> Estimates:
    """Return normals of quadrics; scatter that exceeds the noise counts as one bump of relief."""
    planes = fit_tls(near)
    jets = fit_jets(near, planes.normals, radius_mm)
    flag = _shape_flags(planes, count, COEFFICIENTS + MIN_SPARE)
    vague = ~jets.solved | (jets.gain * count * radius_mm**2 > MAX_GAIN * DISC_GAIN)
    flag = np.where((flag == 0) & vague, RANK_DEFICIENT, flag)
    spare = np.maximum(count - COEFFICIENTS, 1)
    if noise_mm is None:
        variance = jets.noise_mm2 * jets.alike
    else:
        limit = noise_mm**2 * (1.0 + SLACK + SURE * np.sqrt(2.0 / spare))
        relief = np.maximum(jets.noise_mm2 - limit, 0.0)
        # relief does not average out
        variance = np.maximum(jets.noise_mm2, noise_mm**2) * jets.alike + relief * count
    sigma = np.rad2deg(np.sqrt(jets.gain * variance))
    flag = np.where((flag == 0) & (sigma > MAX_SIGMA_DEG), UNCERTAIN, flag)
    return Estimates(
        normals=jets.normals,
        count=count,
        eigenvalues=planes.eigenvalues,
        sigma_deg=np.where((flag == 0) | (flag == UNCERTAIN), np.minimum(sigma, 180.0), 180.0),
        flag=flag,
        noise_mm2=jets.noise_mm2,
        gain=jets.gain,
        curvature_per_mm=np.abs(jets.curvatures[:, 0]),
    )


def _shape_flags(planes: Planes, count: Ints, least: int) -> Ints:
    thin, narrow, wide = planes.eigenvalues.T
    flag = np.zeros(len(count), dtype=np.int64)
    flag[narrow <= MIN_FLATNESS * thin] = NOT_FLAT
    flag[narrow <= MIN_WIDTH * wide] = RANK_DEFICIENT
    flag[count < least] = TOO_FEW
    return flag
