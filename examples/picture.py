"""Charts as SVG text, for the gallery: no package is needed."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 360, 70, 20, 40, 50
COLORS = ("#1f5fa8", "#c4500c", "#2a7f3f", "#7a3f98")


@dataclass(frozen=True)
class Series:
    """Values (n,) over places (n,), drawn as a line or as dots."""

    label: str
    x: ArrayLike
    y: ArrayLike
    dots: bool = False


def chart(title: str, x_label: str, y_label: str, series: Sequence[Series]) -> str:
    """Return a chart of some series as SVG."""
    xs = np.concatenate([np.asarray(s.x, float) for s in series])
    ys = np.concatenate([np.asarray(s.y, float) for s in series])
    shown = np.isfinite(xs) & np.isfinite(ys)
    (x0, x1), (y0, y1) = (_range(values[shown]) for values in (xs, ys))

    def place(x: float, y: float) -> tuple[float, float]:
        right = LEFT + (x - x0) / (x1 - x0) * (WIDTH - LEFT - RIGHT)
        down = HEIGHT - BOTTOM - (y - y0) / (y1 - y0) * (HEIGHT - TOP - BOTTOM)
        return round(right, 1), round(down, 1)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" '
        'font-family="sans-serif" font-size="13">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        _text(WIDTH / 2, 22, title, size=16),
        _text(WIDTH / 2, HEIGHT - 10, x_label),
        f'<text transform="translate(16 {HEIGHT / 2}) rotate(-90)" text-anchor="middle">'
        f"{escape(y_label)}</text>",
        f'<path d="M{LEFT} {TOP}V{HEIGHT - BOTTOM}H{WIDTH - RIGHT}" fill="none" stroke="#888"/>',
    ]
    for tick in np.linspace(0.0, 1.0, 5):
        x, y = place(x0 + tick * (x1 - x0), y0 + tick * (y1 - y0))
        parts.append(_text(x, HEIGHT - BOTTOM + 18, f"{x0 + tick * (x1 - x0):.4g}"))
        parts.append(_text(LEFT - 8, y + 4, f"{y0 + tick * (y1 - y0):.4g}", anchor="end"))
    for k, one in enumerate(series):
        color = COLORS[k % len(COLORS)]
        pairs = zip(np.asarray(one.x, float), np.asarray(one.y, float), strict=True)
        places = [place(x, y) for x, y in pairs if np.isfinite(x) and np.isfinite(y)]
        if one.dots:
            parts += [f'<circle cx="{x}" cy="{y}" r="2.5" fill="{color}"/>' for x, y in places]
        else:
            line = " ".join(f"{x},{y}" for x, y in places)
            parts.append(f'<polyline points="{line}" fill="none" stroke="{color}"/>')
        label = _text(WIDTH - RIGHT, TOP + 16 * k, one.label, anchor="end")
        parts.append(label.replace("<text", f'<text fill="{color}"'))
    return "\n".join([*parts, "</svg>\n"])


def _range(values: np.ndarray) -> tuple[float, float]:
    low, high = float(values.min()), float(values.max())
    room = 0.05 * (high - low) or 1.0
    return low - room, high + room


def _text(x: float, y: float, words: str, *, anchor: str = "middle", size: int = 13) -> str:
    return f'<text x="{x}" y="{y}" text-anchor="{anchor}" font-size="{size}">{escape(words)}</text>'
