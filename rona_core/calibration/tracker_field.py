"""Fixed error of the tracker over its volume, as far as its maker and the pivot tell of it.

How large it is, the maker states. How fast it changes from place to place is not stated, and that
alone counts for a tip that swings, or for two places that were mapped with one registration. But
where the pointer pivots, the tip seems to wander as the field changes under its markers: the
residuals tell the length. The field is taken for a Gaussian process (Rasmussen 2006) whose lengths
are weighted by the likelihood of the residuals; without a pivot each length is as likely.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.distance import cdist

from rona_core.geometry.arrays import Floats, readonly

TYPICAL_DEPTH_MM = 1950.0  # at which the stated error of a tracker holds (RMS over its volume)
FIELD_LENGTH_MM = 400.0  # over which the fixed error of a tracker changes
# from a tenth of the width of a measuring volume to well beyond its depth, a quarter apart
LENGTHS_MM = readonly(np.geomspace(150.0, 2400.0, 13))
EVEN = readonly(np.full(len(LENGTHS_MM), 1.0 / len(LENGTHS_MM)))
NEGLIGIBLE = 0.01  # weight of a length that is left out
AT_ONCE = 64  # points whose distances to all are held together


@dataclass(frozen=True, slots=True)
class TrackerErrorField:
    """What is assumed of the fixed error of a marker in the volume of the tracker."""

    total_mm: float = 0.35  # 3D RMS over the volume, as the maker states it
    depth_ratio: float = 3.0  # in depth over laterally
    length_mm: float = FIELD_LENGTH_MM

    def covariance(self, points_tracker: Floats) -> Floats:
        """Return the covariance (3 n, 3 n) in mm^2 of the errors at points (n, 3)."""
        sigmas = self.sigmas_mm(points_tracker)
        apart = np.linalg.norm(points_tracker[:, None] - points_tracker[None], axis=2)
        alike = np.exp(-0.5 * (apart / self.length_mm) ** 2)
        blocks = np.einsum("nm,ni,mj,ij->nimj", alike, sigmas, sigmas, np.eye(3))
        return blocks.reshape(sigmas.size, sigmas.size)

    def sigmas_mm(self, points_tracker: Floats) -> Floats:
        """Return the standard deviations (n, 3) along the axes of ``tracker`` at points (n, 3)."""
        shares = np.array((1.0, 1.0, self.depth_ratio))
        shares = shares / np.linalg.norm(shares) * self.total_mm
        z = points_tracker[:, 2] / TYPICAL_DEPTH_MM
        return shares * np.stack((z, z, z * z), axis=1)  # two cameras: depth is worst far away


@dataclass(frozen=True, slots=True, eq=False)
class LearnedField:
    """The fixed error of a marker: its size as stated, its lengths as likely as ``weights``."""

    stated: TrackerErrorField  # its length does not count
    weights: Floats = field(default_factory=lambda: EVEN)  # (13,) of ``LENGTHS_MM``, sum 1

    def propagate(self, sensitivity: Floats, points_tracker: Floats) -> Floats:
        """Return the covariance (k, k) of what depends linearly on the error at points.

        Args:
            sensitivity: Derivatives (k, n, 3) by the error at each point.
            points_tracker: Places of markers (n, 3).
        """
        sigmas = self.stated.sigmas_mm(points_tracker)
        alike = np.zeros((len(points_tracker), len(points_tracker)))
        for start in range(0, len(points_tracker), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            squares = cdist(points_tracker[some], points_tracker, "sqeuclidean")
            for length_mm, weight in zip(LENGTHS_MM, self.weights, strict=True):
                if weight > NEGLIGIBLE:
                    part = squares * (-0.5 / length_mm**2)
                    np.exp(part, out=part)
                    part *= weight
                    alike[some] += part
        alike /= self.weights[self.weights > NEGLIGIBLE].sum()
        spread = np.zeros((len(sensitivity), len(sensitivity)))
        for axis in range(3):  # one by one: all scaled at once take much memory
            scaled = sensitivity[:, :, axis] * sigmas[:, axis]
            spread += scaled @ alike @ scaled.T
        return spread

    def learn(
        self, residuals: Floats, sensitivity: Floats, points_tracker: Floats, noise: Floats
    ) -> "LearnedField":
        """Return the field with the lengths that explain residuals.

        Args:
            residuals: (k,) with what was fitted taken out.
            sensitivity: Derivatives (k, n, 3) by the error at each point, of the same.
            points_tracker: Places of markers (n, 3).
            noise: Covariance (k, k) of what else is in the residuals.
        """
        if self.stated.total_mm == 0.0:
            return self
        logs = np.zeros(len(LENGTHS_MM))
        for i in range(len(LENGTHS_MM)):
            alone = replace(self, weights=np.eye(len(LENGTHS_MM))[i])
            spread = alone.propagate(sensitivity, points_tracker) + noise
            root = np.linalg.cholesky(spread)
            white = np.linalg.solve(root, residuals)
            logs[i] = -0.5 * white @ white - np.log(np.diag(root)).sum()
        weights = np.exp(logs - logs.max())
        return replace(self, weights=readonly(weights / weights.sum()))
