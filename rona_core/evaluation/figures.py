"""Type of the figures, and the root mean square."""

import numpy as np

from rona_core.geometry.arrays import Floats

Figure = float | int | str | bool | None  # None where there is nothing to score yet
Figures = dict[str, Figure]


def rms(values: Floats) -> float | None:
    """Return the root mean square of finite values (n,) or vectors (n, 3); None without any."""
    known = values[np.isfinite(values)] if values.ndim == 1 else values
    return float(np.sqrt((known**2).sum() / len(known))) if len(known) else None
