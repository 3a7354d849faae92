"""Colours of lines: what the viewer is to be sent so that a line has the colour of its legend.

The viewer draws points as they are, but lines as if they were lit: it maps their light by a curve
of film (ACES, as in three.js with exposure 1), which this module undoes. A single colour of a line
is taken for sRGB, one for each of its points for light itself. Light greys and yellows beyond what
the curve can give are drawn as near as can be: the end of viridis is 23 of 255 too dark.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rona_core.geometry.arrays import Floats

EXPOSURE = 1.0 / 0.6
# fit by S. Hill of the reference and output transforms of ACES, as three.js has it
INTO = np.array(
    (
        (0.59719, 0.35458, 0.04823),
        (0.07600, 0.90834, 0.01566),
        (0.02840, 0.13383, 0.83777),
    )
)
OUT_OF = np.array(
    (
        (1.60475, -0.53108, -0.07367),
        (-0.10208, 1.10813, -0.00605),
        (-0.00327, -0.07276, 1.07602),
    )
)
ABOVE = (1.0, 0.0245786, -0.000090537)  # v², v and 1 of the fit's numerator
BELOW = (0.983729, 0.4329510, 0.238081)  # and of its denominator
BRIGHTEST = 0.99  # of the curve, which never gives 1


def sent_color(shown: ArrayLike) -> NDArray[np.uint8]:
    """Return the one colour (3,) of a line that is to be shown in a colour, sRGB from 0 to 255."""
    return np.round(_coded(_before_curve(_linear(shown)))).astype(np.uint8)


def sent_colors(shown: ArrayLike) -> NDArray[np.uint8]:
    """Return the colours (..., 3) of single points of a line that are to be shown in these."""
    return np.round(255.0 * _before_curve(_linear(shown))).astype(np.uint8)


def _coded(light: Floats) -> Floats:
    low = light <= 0.0031308
    return 255.0 * np.where(low, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)


def _linear(colors: ArrayLike) -> Floats:
    share = np.asarray(colors, dtype=np.float64) / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _before_curve(wanted: Floats) -> Floats:
    """Return the light (..., 3) that the curve maps to a wanted one, as near as can be."""
    y = np.clip(wanted @ np.linalg.inv(OUT_OF).T, 0.0, BRIGHTEST)
    a, b, c = (above - below * y for above, below in zip(ABOVE, BELOW, strict=True))
    v = (-b + np.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    return np.clip(v @ np.linalg.inv(INTO).T / EXPOSURE, 0.0, 1.0)
