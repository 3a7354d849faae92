"""Graphs: curves over one axis, drawn by the viewer's plot."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rona_core.geometry.arrays import Floats

GRID = {"stroke": "#e3e8ed", "width": 1}
INK = "#3e4c59"
PADDING = (8, 14, 0, 0)  # pixels above and to the right, for the last numbers of the axes


@dataclass(frozen=True, slots=True)
class Axis:
    """Label and ends of an axis."""

    label: str
    low: float
    high: float

    @property
    def options(self) -> dict[str, Any]:
        """What the viewer's plot wants to know of it."""
        font = "11px sans-serif"
        return {"label": self.label, "grid": GRID, "stroke": INK, "labelSize": 22, "font": font}


class Graph:
    """Curves over one axis: new data are drawn in place, other axes or curves anew."""

    def __init__(self, gui: Any, height_px: int) -> None:
        self._gui, self._height_px = gui, height_px
        self._folder = gui.add_folder(None)
        self._plot: Any = None
        self._drawn: tuple[Any, ...] = ()

    def show(
        self,
        x: Axis,
        y: Axis,
        data: tuple[Floats, ...],
        series: Sequence[dict[str, Any]],
        bands: tuple[Any, ...] = (),
    ) -> None:
        """Draw columns of data: the first is the place on the x axis, each other one a curve."""
        drawn = (x, y, tuple(series), bands)
        if self._plot is not None and drawn == self._drawn:
            self._plot.data = data
            return
        self.clear()
        self._drawn = drawn
        with self._folder:
            self._plot = self._gui.add_uplot(
                data,
                tuple(series),
                bands=bands or None,
                scales={
                    "x": {"time": False, "range": (x.low, x.high)},
                    "y": {"range": (y.low, y.high)},
                },
                axes=(x.options, y.options),
                legend={"show": False},
                cursor={"drag": {"x": True, "y": False}},
                height=self._height_px,
                padding=PADDING,
            )

    def clear(self) -> None:
        """Remove the graph."""
        if self._plot is not None:
            self._plot.remove()
            self._plot = None
