"""Colours: Okabe-Ito for categories, viridis for quantities, a few for materials."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rona_core.mapping.colors import PLACES, viridis

Rgb = tuple[int, int, int]

BACKGROUND: Rgb = (186, 194, 201)
FLOOR: Rgb = (150, 158, 164)
WALL: Rgb = (188, 198, 202)
SHEET: Rgb = (152, 174, 172)  # on the table: the green of surgical drapes, pale
PAD: Rgb = (126, 138, 148)
PEDESTAL: Rgb = (128, 136, 144)
SUTURE: Rgb = (150, 128, 98)
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
# kind of move of a milling path -> word and colour
MILLING_COLORS: dict[str, tuple[str, Rgb]] = {
    "cut": ("cut", SKY),
    "rim": ("rim, by the small burr", ORANGE),
    "entry": ("entry", GREEN),
    "retract": ("in the air", WHITE),
}
CATEGORIES = (BLUE, ORANGE, GREEN, VERMILLION, PURPLE, SKY)


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
        for c, p in zip(viridis(PLACES), PLACES, strict=True)
    )
    return f"linear-gradient(to right, {stops})"
