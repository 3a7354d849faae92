"""Bone left below a milled floor: draws of the maps, corrected by what the probe measured there.

The draws say how errors of the maps hang together from place to place, so what was measured at
some places moves all of them (an ensemble Kalman filter with perturbed observations, Evensen 1994).
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.spatial.distance import cdist

from rona_core.geometry.arrays import Bools, Floats, Ints

TAPER_MM = 15.0  # beyond which chance alone may tie draws together
LEAST_SIGMA_MM = 0.10  # of one A-scan: the face looks at a disc, and not at a place
AT_ONCE = 512  # places that are worked on together: thousands with all draws take much memory
OUTLIER = 3.5  # sigmas off the median difference


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredFloor:
    """Residual bone measured from a floor: m places in ``bed``."""

    scans: Ints  # (m,) which of the A-scans
    places_bed: Floats  # (m, 3)
    residual_mm: Floats  # (m,) by the probe, along its axis as all of these are
    sigma_mm: Floats  # (m,) of each by itself
    common_share: float  # relative sigma that all share: that of the speed of sound
    mapped_mm: Floats  # (m,) by the maps
    drawn_mm: Floats  # (m, k) in draws of the maps

    def part(self, which: Bools) -> "MeasuredFloor":
        """Return some of the places (m,)."""
        return MeasuredFloor(
            self.scans[which],
            self.places_bed[which],
            self.residual_mm[which],
            self.sigma_mm[which],
            self.common_share,
            self.mapped_mm[which],
            self.drawn_mm[which],
        )

    def without_outliers(self) -> "MeasuredFloor":
        """Return it without places that are far off what the others say of the maps."""
        off = self.residual_mm - self.mapped_mm
        sigma = np.hypot(self.drawn_mm.std(axis=1), self.sigma_mm)
        return self.part(np.abs(off - np.median(off)) <= OUTLIER * sigma)


class CorrectedBone:
    """Draws of the bone below a bed, moved by what was measured."""

    def __init__(self, measured: MeasuredFloor, random: Generator) -> None:
        """Take in what was measured, at least at one place; its noise in the draws is random."""
        self._places = measured.places_bed
        self._off = measured.drawn_mm - measured.drawn_mm.mean(axis=1, keepdims=True)
        count, draws = self._off.shape
        own = np.hypot(measured.sigma_mm, LEAST_SIGMA_MM)
        common = measured.common_share * measured.residual_mm
        noise = own[:, None] * random.standard_normal((count, draws))
        noise += common[:, None] * random.standard_normal(draws)
        cov = self._tied(self._places, self._off) + np.diag(own**2) + np.outer(common, common)
        innovations = measured.residual_mm[:, None] + noise - measured.drawn_mm
        self._moves = np.linalg.solve(cov, innovations)

    def draws(self, places_bed: Floats, drawn_mm: Floats, *, overwrite: bool = False) -> Floats:
        """Return residuals (n, k) below places (n, 3) in draws, given those of the maps (n, k).

        With ``overwrite`` they take the place of those of the maps.
        """
        found = drawn_mm if overwrite else drawn_mm.copy()
        for start in range(0, len(found), AT_ONCE):
            rows = slice(start, start + AT_ONCE)
            off = found[rows] - found[rows].mean(axis=1, keepdims=True)
            found[rows] += self._tied(places_bed[rows], off) @ self._moves
        return found

    def _tied(self, places_bed: Floats, off_mm: Floats) -> Floats:
        """Return the covariance (n, m) of places with those that were measured."""
        away2 = cdist(places_bed[:, :2], self._places[:, :2], "sqeuclidean")
        away2 *= -0.5 / TAPER_MM**2  # in place: there are many places
        tied = np.exp(away2, out=away2)
        tied *= off_mm @ self._off.T
        tied /= off_mm.shape[1] - 1
        return tied
