"""Lines are sent in colours that the viewer's curve turns into those of the legend."""

import numpy as np
import pytest

from rona_ui.presentation.colors import BLUE, CATEGORIES, INK, STEEL, VERMILLION, viridis
from rona_ui.scene import line_colors
from rona_ui.scene.line_colors import sent_color, sent_colors


def drawn_color(light: np.ndarray) -> np.ndarray:
    """The colour (..., 3), sRGB from 0 to 255, that the viewer draws for light 0 to 1."""
    v = line_colors.EXPOSURE * light @ line_colors.INTO.T
    curve = np.polyval(line_colors.ABOVE, v) / np.polyval(line_colors.BELOW, v)
    share = np.clip(curve @ line_colors.OUT_OF.T, 0.0, 1.0)
    coded = np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)
    return 255.0 * coded


def light(colors: np.ndarray) -> np.ndarray:
    share = colors / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(
    ("sent", "drawn"),  # read off a screenshot of the viewer
    [((0, 158, 115), (0, 173, 128)), ((213, 94, 0), (221, 104, 13)), ((62, 68, 76), (49, 56, 66))],
)
def test_the_curve_is_that_of_the_viewer(sent, drawn) -> None:
    np.testing.assert_allclose(drawn_color(light(np.array(sent))), drawn, atol=0.6)


@pytest.mark.parametrize("color", [*CATEGORIES, INK, STEEL])
def test_a_line_in_one_colour_is_drawn_in_it(color) -> None:
    drawn = drawn_color(light(sent_color(color).astype(float)))
    assert np.abs(drawn - color).max() <= (10.0 if color in (BLUE, VERMILLION, INK) else 35.0)
    naive = drawn_color(light(np.array(color, dtype=float)))
    assert np.abs(drawn - color).max() < np.abs(naive - color).max()


def test_a_scale_along_a_line_is_that_of_the_colour_bar() -> None:
    bar = viridis(np.linspace(0.0, 0.85, 50))
    drawn = drawn_color(sent_colors(bar) / 255.0)
    assert np.abs(drawn - bar).max() < 25.0
    assert np.median(np.abs(drawn - bar).max(axis=1)) < 2.0
