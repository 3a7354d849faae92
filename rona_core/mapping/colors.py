"""Colours of quantities (viridis) and categories (Okabe-Ito), the same in browser and reports."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

# viridis at 20 even places (matplotlib's CC0 colour map, by its published values)
_VIRIDIS = np.array(
    [
        (68, 1, 84), (72, 21, 103), (72, 38, 119), (69, 55, 129), (64, 71, 136), (57, 86, 140),
        (51, 99, 141), (45, 112, 142), (40, 125, 142), (35, 138, 141), (31, 150, 139),
        (32, 163, 135), (41, 175, 127), (60, 187, 117), (85, 198, 103), (115, 208, 85),
        (149, 216, 64), (184, 222, 41), (220, 227, 25), (253, 231, 37),
    ],
    dtype=np.float64,
)  # fmt: skip
PLACES = np.linspace(0.0, 1.0, len(_VIRIDIS))

Rgb = tuple[int, int, int]
BLUE: Rgb = (0, 114, 178)
ORANGE: Rgb = (230, 159, 0)
GREEN: Rgb = (0, 158, 115)
VERMILLION: Rgb = (213, 94, 0)
PURPLE: Rgb = (204, 121, 167)
SKY: Rgb = (86, 180, 233)
YELLOW: Rgb = (240, 228, 66)
CATEGORIES = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY)


def viridis(shares: ArrayLike) -> NDArray[np.uint8]:
    """Return colours (n, 3) for shares from 0 to 1; beyond the ends the end's colour."""
    s = np.clip(np.asarray(shares, dtype=np.float64), 0.0, 1.0)
    columns = [np.interp(s, PLACES, channel) for channel in _VIRIDIS.T]
    return np.round(np.stack(columns, axis=-1)).astype(np.uint8)


def css(color: Rgb) -> str:
    """Return a colour for a style sheet."""
    return "#{:02x}{:02x}{:02x}".format(*color)
