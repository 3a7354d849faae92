"""Colours: Okabe-Ito for categories, viridis for quantities, a few for materials."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Rgb = tuple[int, int, int]

BACKGROUND: Rgb = (70, 78, 88)
BONE: Rgb = (226, 217, 198)
BONE_RIM: Rgb = (199, 160, 105)  # of bone that is cut
STEEL: Rgb = (154, 160, 168)
BLOCKED: Rgb = (120, 128, 136)  # base place too close to the head

BLUE: Rgb = (0, 114, 178)
ORANGE: Rgb = (230, 159, 0)
GREEN: Rgb = (0, 158, 115)
VERMILLION: Rgb = (213, 94, 0)
PURPLE: Rgb = (204, 121, 167)
SKY: Rgb = (86, 180, 233)
YELLOW: Rgb = (240, 228, 66)
WHITE: Rgb = (245, 245, 245)
CATEGORIES = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY)

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
_PLACES = np.linspace(0.0, 1.0, len(_VIRIDIS))


def viridis(shares: ArrayLike) -> NDArray[np.uint8]:
    """Return colours (n, 3) for shares from 0 to 1; beyond the ends the end's colour."""
    s = np.clip(np.asarray(shares, dtype=np.float64), 0.0, 1.0)
    columns = [np.interp(s, _PLACES, channel) for channel in _VIRIDIS.T]
    return np.round(np.stack(columns, axis=-1)).astype(np.uint8)


def diverging(shares: ArrayLike) -> NDArray[np.uint8]:
    """Return colours (n, 3) from blue over white to vermillion for shares from 0 to 1."""
    s = np.clip(np.asarray(shares, dtype=np.float64), 0.0, 1.0)
    channels = np.array((BLUE, WHITE, VERMILLION), dtype=np.float64).T
    columns = [np.interp(s, (0.0, 0.5, 1.0), channel) for channel in channels]
    return np.round(np.stack(columns, axis=-1)).astype(np.uint8)


def diverging_css() -> str:
    """Return the same as a gradient from left to right."""
    return f"linear-gradient(to right, {css(BLUE)}, {css(WHITE)}, {css(VERMILLION)})"


def css(color: Rgb) -> str:
    """Return a colour for a style sheet."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def viridis_css() -> str:
    """Return viridis as a gradient from left to right."""
    stops = ", ".join(
        f"{css((int(c[0]), int(c[1]), int(c[2])))} {100 * p:.1f}%"
        for c, p in zip(_VIRIDIS, _PLACES, strict=True)
    )
    return f"linear-gradient(to right, {stops})"
