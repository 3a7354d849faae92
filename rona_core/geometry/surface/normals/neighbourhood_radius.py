"""Choice of the neighbourhood radius for normals: noise against bias.

After Mitra and Nguyen 2003 the error of a normal is noise, falling with the square of the radius
and the root of the density, plus a lean, rising with it. Both are measured on the cloud itself:
the noise from the scatter about small quadrics; the lean from how far normals of wide
neighbourhoods turn away from those of narrow ones, beyond what the noise explains.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.surface.normals.neighbourhood_fits import COEFFICIENTS
from rona_core.geometry.surface.normals.normal_estimator import (
    DISC_GAIN,
    ONE_SIDED,
    Estimates,
    NormalMethod,
    estimate,
)

RADII_MM = readonly(2.0 * 2.0 ** (np.arange(12) / 3.0))  # 2 to 25 mm, a third of an octave apart
SAMPLES = 300  # points of the cloud at which radii are tried
MIN_SHARE = 0.9  # of them with a usable normal, for a radius to be considered
SURE = 2.0  # standard errors by which normals must differ to show a lean
WORSE = 4.0  # times the least expected square: no wider radius is tried
ENOUGH_RAD = np.deg2rad(0.1)  # of noise: no wider radius is needed
CENTRED_GAIN = 4.0  # in full discs; places with more are at a rim and left out
DEFAULT_MM = 8.0  # where nothing can be learnt


@dataclass(frozen=True, slots=True, eq=False)
class RadiusChoice:
    """The radius with the least expected error, and what was weighed against what."""

    radius_mm: float
    noise_mm: float  # of one point, along the normal
    density_per_mm2: float
    curvature_per_mm: float  # larger principal curvature, median
    radii_mm: Floats  # (k,) that were tried
    noise_deg: Floats  # (k,) RMS error by noise that each of them leaves
    lean_deg: Floats  # (k,) RMS error by relief and curvature that each of them brings

    def lean_at_deg(self, radii_mm: Floats) -> Floats:
        """Return the error by relief and curvature at some radii; 0 where none was tried."""
        if not len(self.radii_mm):
            return np.zeros(np.shape(radii_mm))
        return np.interp(radii_mm, self.radii_mm, self.lean_deg)


def choose_radius(tree: KDTree, method: NormalMethod) -> RadiusChoice:
    """Return the radius to be used for ``method`` on a cloud."""
    radii: list[float] = []
    fits: list[Estimates] = []
    noise2, curvature = 0.0, 0.0
    noise = bias = np.zeros(0)
    for radius, jet in _usable(tree):
        fit = jet
        if method != "jet":
            fit = estimate(tree, _sample(tree), radius, method, None)
            if np.mean((fit.flag == 0) | (fit.flag == ONE_SIDED)) < MIN_SHARE:
                continue
        if not radii:
            noise2 = _noise_mm2(jet)
        radii.append(radius)
        fits.append(fit)
        noise, bias = _errors(radii, fits, noise2, tree.n)
        risk = noise + bias
        if risk.argmin() == len(risk) - 1:
            curvature = float(np.median(jet.curvature_per_mm[jet.flag == 0]))
        if noise[-1] < ENOUGH_RAD**2 or risk[-1] > WORSE * risk.min():
            break
    best = int((noise + bias).argmin()) if radii else 0
    return RadiusChoice(
        radius_mm=radii[best] if radii else DEFAULT_MM,
        noise_mm=float(np.sqrt(noise2)),
        density_per_mm2=_density(fits[best], radii[best]) if radii else 0.0,
        curvature_per_mm=curvature,
        radii_mm=readonly(np.array(radii)),
        noise_deg=readonly(np.rad2deg(np.sqrt(noise))),
        lean_deg=readonly(np.rad2deg(np.sqrt(bias))),
    )


def measure_noise_mm(tree: KDTree) -> float | None:
    """Return the noise of one point along the normal, or None where no quadric can be fitted."""
    for _, jet in _usable(tree):
        return float(np.sqrt(_noise_mm2(jet)))
    return None


def _sample(tree: KDTree) -> Floats:
    return np.asarray(tree.data[:: max(1, tree.n // SAMPLES)])


def _usable(tree: KDTree) -> Iterator[tuple[float, Estimates]]:
    """Yield the radii, ascending, at which nearly all quadrics can be fitted, and these."""
    if not tree.n:
        return
    for radius in RADII_MM.tolist():
        jet = estimate(tree, _sample(tree), radius, "jet", None)
        if np.mean(jet.flag == 0) >= MIN_SHARE:
            yield radius, jet


def _noise_mm2(jet: Estimates) -> float:
    """Return the variance of one point: the median over places, freed of its own bias."""
    good = jet.flag == 0
    spare = np.maximum(jet.count[good] - COEFFICIENTS, 1)
    return float(np.median(jet.noise_mm2[good] / (1.0 - 2.0 / (9.0 * spare)) ** 3))


def _density(fit: Estimates, radius: float) -> float:
    return float(np.median(fit.count) / (np.pi * radius**2))


def _errors(
    radii: list[float], fits: list[Estimates], noise2: float, n: int
) -> tuple[Floats, Floats]:
    """Return the mean squares in rad^2 by noise and by relief, for each radius.

    Normals of one neighbourhood within another differ by the difference of their variances and
    by the lean of the wider one. A lean counts when it is sure in the face of so many places.
    """
    noise, bias = np.zeros(len(radii)), np.zeros(len(radii))
    inner = [_centred(fit, radius) for fit, radius in zip(fits, radii, strict=True)]
    for k, fit in enumerate(fits):
        noise[k] = noise2 * fit.gain[inner[k]].mean()
        for j in range(k):
            both = inner[k] & inner[j]
            if not both.any():
                continue
            other = fits[j]
            cross = np.cross(fit.normals[both], other.normals[both])
            squared_angles = np.arcsin(np.minimum(np.linalg.norm(cross, axis=1), 1.0)) ** 2
            by_noise = float(noise2 * (other.gain[both] - fit.gain[both]).mean())
            apart = n / max(_density(other, radii[j]) * np.pi * radii[j] ** 2, 1.0)
            standard_error = (
                SURE * float(squared_angles.std()) / np.sqrt(max(min(apart, both.sum()), 4.0))
            )
            bias[k] = max(bias[k], float(squared_angles.mean()) - by_noise - standard_error)
    return noise, np.maximum.accumulate(bias)


def centred(fit: Estimates, radii_mm: Floats) -> Bools:
    """Return where points lie all round, so that noise turns the normal hardly more than there."""
    return np.asarray(fit.gain * fit.count * radii_mm**2 < CENTRED_GAIN * DISC_GAIN)


def _centred(fit: Estimates, radius: float) -> Bools:
    """Return which places have usable points all round; all usable ones where these are few."""
    good = fit.flag == 0
    inner = good & centred(fit, np.array(radius))
    return inner if inner.sum() >= 20 else (good if good.any() else np.ones_like(good))
