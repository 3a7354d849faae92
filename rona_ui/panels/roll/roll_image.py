"""Roll image: a strip of feasibility by roll angle, and the margin map of path by roll angle."""

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from rona_core.app.steps.roll.view import RollStrip
from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets.image_slider import png_url
from rona_ui.presentation.colors import (
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY,
    VERMILLION,
    YELLOW,
    Rgb,
    css,
    viridis,
    viridis_css,
)
from rona_ui.viewer.bindings import escape

REASONS: dict[str, tuple[str, Rgb]] = {  # reason of a verdict -> words, colour in the strip
    "none": ("feasible", GREEN),
    "limit": ("joint limit", VERMILLION),
    "reach": ("out of reach", PURPLE),
    "singularity": ("singularity", ORANGE),
    "jump": ("joint jump", BLUE),
    "blocked": ("collision", SKY),
    "roll rate": ("roll rate", SKY),
    "no way": ("no approach or retract", YELLOW),
}
STRIP, GAP, MAP = 80.0, 20.0, 1000.0  # heights in the picture
WIDE = 10.0  # of a roll in the picture


def roll_picture(strip: RollStrip) -> str:
    """Return the picture as SVG; the middle of its first and last roll are its edges."""
    n, top = len(strip.rolls_deg), STRIP + GAP
    width, height = WIDE * (n - 1), top + MAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
        'preserveAspectRatio="none" shape-rendering="crispEdges">',
        f'<rect width="{width:g}" height="{height:g}" fill="#fff"/>',
        *(
            f'<rect x="{WIDE * (i - 0.5):g}" width="{WIDE:g}" height="{STRIP:g}" '
            f'fill="{css(REASONS[reason][1])}"/>'
            for i, reason in enumerate(strip.reasons)
        ),
        f'<image x="{-0.5 * WIDE:g}" y="{top:g}" width="{WIDE * n:g}" height="{MAP:g}" '
        f'preserveAspectRatio="none" style="image-rendering:pixelated" '
        f'href="{png_url(roll_image(strip))}"/>',
        *(
            f'<rect x="{WIDE * (i - 0.4):g}" y="{top + MAP * min(at, 0.985):g}" '
            f'width="{0.8 * WIDE:g}" height="{0.015 * MAP:g}" fill="#fff"/>'
            for i, at in enumerate(strip.fails_at.tolist())
            if not strip.feasible[i]
        ),
    ]
    for line in curve_lines(strip):
        places = " ".join(f"{x:.1f},{y:.1f}" for x, y in line.tolist())
        for color, px in (("#fff", 5), ("#1f2933", 2)):
            parts.append(
                f'<polyline points="{places}" fill="none" stroke="{color}" stroke-width="{px}" '
                'vector-effect="non-scaling-stroke"/>'
            )
    return "".join((*parts, "</svg>"))


def curve_lines(strip: RollStrip) -> list[Floats]:
    """Return the chosen roll as lines (n, 2) in the picture, parted where it leaves at one edge."""
    curve, rolls = strip.curve_deg, strip.rolls_deg
    if not len(curve):
        return []
    step = float(rolls[1] - rolls[0])
    around = bool(abs(step * len(rolls) - 360.0) < 1e-6)
    columns = (curve - rolls[0]) / step
    if around:
        columns = np.mod(columns, len(rolls))
    y = STRIP + GAP + MAP * np.linspace(0.0, 1.0, len(curve))
    breaks = np.flatnonzero(np.abs(np.diff(columns)) > 0.5 * len(rolls)) + 1
    points = np.column_stack((WIDE * columns, y))
    return [part for part in np.split(points, breaks) if len(part) > 1]


def legend(strip: RollStrip) -> str:
    """Return what the colours of strip and map mean."""
    counts = Counter(strip.reasons)
    entries = [
        (css(color), "", f"{counts[reason]} × {words}")
        for reason, (words, color) in REASONS.items()
        if counts[reason]
    ]
    map_key = [
        (viridis_css(), "width:44px;", f"margin, 0 to {_top(strip):.1f}"),
        (css(VERMILLION), "", "no margin"),
        ("#fff;border:1px solid #52606d", "height:4px;", "first failure"),
    ]
    if len(strip.curve_deg):
        map_key.append(("#1f2933", "width:3px;", "selected roll"))
    spans = "".join(
        f'<span><i style="{size}background:{color}"></i>{escape(words)}</span>'
        for color, size, words in (*entries, *map_key)
    )
    return f'<div class="r-key">{spans}</div>'


def _top(strip: RollStrip) -> float:
    """Return the largest margin of all rolls, where the colours end."""
    return max(float(strip.node_room.max(initial=0.0)), 1e-9)


def roll_image(strip: RollStrip) -> NDArray[np.uint8]:
    """Return the colours of the map, (places, rolls, 3): path down, rolls across."""
    image = viridis(np.clip(strip.node_room / _top(strip), 0.0, 1.0))
    image[strip.node_room < 0.0] = VERMILLION
    return image
