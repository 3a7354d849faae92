"""Error model of single markers: anisotropic noise, larger in depth."""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly

MAX_DEPTH_RATIO = 20.0


@dataclass(frozen=True, slots=True)
class MarkerNoise:
    """White error of one marker in the frame ``tracker``, whose z axis is the depth.

    A stereo tracker measures depth worst, by about twice the distance over the baseline.
    """

    depth_ratio: float = 3.0  # deviation along z over that along x or y
    sigma_mm: float | None = None  # 3D RMS of one marker; None: taken from the residuals

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidInputError: a ratio outside 1 to 20, or a deviation that is not positive.
        """
        if not 1.0 <= self.depth_ratio <= MAX_DEPTH_RATIO:
            raise InvalidInputError(
                f"depth_ratio must be 1 to {MAX_DEPTH_RATIO:g}, not {self.depth_ratio}"
            )
        if self.sigma_mm is not None and not 0.0 < self.sigma_mm < np.inf:
            raise InvalidInputError(f"sigma_mm must be positive, not {self.sigma_mm}")

    def shape(self) -> Floats:
        """Return the deviations (3,) along tracker x, y, z for a 3D RMS of 1."""
        shares = np.array((1.0, 1.0, self.depth_ratio))
        return readonly(shares / np.linalg.norm(shares))


EVEN = MarkerNoise(depth_ratio=1.0)
