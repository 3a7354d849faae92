"""Colours: Okabe-Ito for categories, viridis for quantities, a few for materials."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rona_core.mapping.colors import (
    BLUE,
    GREEN,
    ORANGE,
    PLACES,
    SKY,
    VERMILLION,
    Rgb,
    css,
    viridis,
)
from rona_core.mapping.colors import CATEGORIES as CATEGORIES
from rona_core.mapping.colors import PURPLE as PURPLE
from rona_core.mapping.colors import YELLOW as YELLOW

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
INK: Rgb = (62, 68, 76)  # outlines
BLOCKED: Rgb = (120, 128, 136)  # base place too close to the head

WHITE: Rgb = (245, 245, 245)
# kind of move of a milling path -> word and colour
MILLING_COLORS: dict[str, tuple[str, Rgb]] = {
    "cut": ("cut", SKY),
    "rim": ("rim, by the small burr", ORANGE),
    "entry": ("entry", GREEN),
    "retract": ("in the air", WHITE),
}


def diverging(shares: ArrayLike) -> NDArray[np.uint8]:
    """Return colours (n, 3) from blue over white to vermillion for shares from 0 to 1."""
    s = np.clip(np.asarray(shares, dtype=np.float64), 0.0, 1.0)
    channels = np.array((BLUE, WHITE, VERMILLION), dtype=np.float64).T
    columns = [np.interp(s, (0.0, 0.5, 1.0), channel) for channel in channels]
    return np.round(np.stack(columns, axis=-1)).astype(np.uint8)


def diverging_css() -> str:
    """Return the same as a gradient from left to right."""
    return f"linear-gradient(to right, {css(BLUE)}, {css(WHITE)}, {css(VERMILLION)})"


def viridis_css() -> str:
    """Return viridis as a gradient from left to right."""
    stops = ", ".join(
        f"{css((int(c[0]), int(c[1]), int(c[2])))} {100 * p:.1f}%"
        for c, p in zip(viridis(PLACES), PLACES, strict=True)
    )
    return f"linear-gradient(to right, {stops})"
