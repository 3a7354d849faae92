"""Type of the figures, and the root mean square."""

import numpy as np

from rona_core.geometry.arrays import Floats

Figure = float | int | str | bool | None  # None where there is nothing to score yet
Figures = dict[str, Figure]


def rms(values: Floats) -> float | None:
    """Return the root mean square of values (n,) or of vectors (n, 3); None if there are none."""
    if not len(values):
        return None
    return float(np.sqrt((values**2).sum() / len(values)))
