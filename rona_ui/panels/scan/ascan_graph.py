"""The A-scan as columns of a graph: curves, and boundaries, gates and hypotheses as boxes."""

from typing import Any

import numpy as np

from rona_core.app.steps.boundaries.ascan_view import AScanPlot
from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import CATEGORIES, GREEN, ORANGE, PURPLE, VERMILLION, css

LOW, HIGH = -1.05, 1.05
BELOW = -8.0  # out of sight: gaps of NaN would not be drawn as gaps
THIN_US = 0.004  # least half width of a line
GATE_TOP = -0.96
Span = tuple[float, float]

SERIES: tuple[dict[str, Any], ...] = (
    {"label": "time"},
    {"label": "signal", "stroke": "#a9b3bd", "width": 1},
    {"label": "envelope", "stroke": "#52606d", "width": 1},
    {"label": "compressed", "stroke": css(CATEGORIES[0]), "width": 2},
    {"label": "without front", "stroke": css(PURPLE), "width": 2},
    {"label": "outer", "stroke": css(GREEN), "width": 1.5},
    {"label": "inner", "stroke": css(VERMILLION), "width": 1.5},
    {"label": "other echo", "stroke": css(ORANGE), "width": 2, "dash": (6, 4)},
    {"label": "does not count", "stroke": "#52606d", "width": 1.5, "dash": (2, 4)},
    {"label": "by hand", "stroke": "#1f2933", "width": 2},
    {"label": "gate of the front", "stroke": "transparent", "width": 0},
    {"label": "gate of the inner", "stroke": "transparent", "width": 0},
    {"label": "floor", "stroke": "transparent", "width": 0},
)
FLOOR = len(SERIES) - 1
BANDS = (
    {"series": (5, FLOOR), "fill": "rgba(0,158,115,0.30)"},
    {"series": (6, FLOOR), "fill": "rgba(213,94,0,0.30)"},
    {"series": (10, FLOOR), "fill": css(GREEN)},
    {"series": (11, FLOOR), "fill": css(VERMILLION)},
)
KEY = (
    ("#a9b3bd", "signal"),
    ("#52606d", "envelope"),
    (css(CATEGORIES[0]), "matched filter"),
    (css(PURPLE), "without front echo, enlarged"),
    (css(GREEN), "outer boundary ± σ"),
    (css(VERMILLION), "inner boundary ± σ"),
    (css(ORANGE), "other echo"),
)


def ascan_data(plot: AScanPlot, hand_us: float | None = None) -> tuple[Floats, ...]:
    """Return the columns of the graph, in the order of ``SERIES``.

    Boundaries are as wide as their sigma to both sides. The bars along the bottom are the gates.
    """
    boxes: list[tuple[Span | None, float]] = [
        (_around(plot.outer_us, plot.outer_sigma_us), 1.0),
        (_around(plot.inner_us, plot.inner_sigma_us), 1.0),
        (_around(plot.alternative_us, 0.0), 0.85),
        (_around(plot.guess_us, 0.0), 0.85),
        (_around(hand_us, 0.0), 1.0),
        (plot.front_gate_us, GATE_TOP),
        (plot.bone_gate_us, GATE_TOP),
    ]
    edges = [edge for span, _ in boxes if span is not None for edge in span]
    at = np.sort(np.concatenate((plot.time_us, np.repeat(np.array(edges, dtype=np.float64), 2))))
    curves = (plot.rf, plot.envelope, plot.compressed, plot.behind_front)
    return (
        at,
        *(np.interp(at, plot.time_us, curve) for curve in curves),
        *(box(at, span, top) for span, top in boxes),
        np.full(len(at), LOW - 0.1),
    )


def _around(place_us: float | None, sigma_us: float) -> Span | None:
    if place_us is None:
        return None
    half = max(sigma_us, THIN_US)
    return place_us - half, place_us + half


def box(at: Floats, span: Span | None, top: float) -> Floats:
    """Return a column that is ``top`` within a span, whose edges occur twice in ``at``."""
    column = np.full(len(at), BELOW)
    if span is not None:
        first = int(np.searchsorted(at, span[0], side="right")) - 1
        last = int(np.searchsorted(at, span[1], side="left"))
        column[first : last + 1] = top
    return column
