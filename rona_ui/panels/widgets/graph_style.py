"""Axes, grid and margins that all graphs share."""

from typing import Any

GRID = {"stroke": "#e3e8ed", "width": 1}
INK = "#3e4c59"
PADDING = (8, 14, 0, 0)  # pixels above and to the right, for the last numbers of the axes


def axis(label: str) -> dict[str, Any]:
    """Return an axis with its label."""
    return {"label": label, "grid": GRID, "stroke": INK, "labelSize": 22, "font": "11px sans-serif"}
