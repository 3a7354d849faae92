"""Graphs drawn by the viewer's plot, and a slider whose track is an image."""

import base64
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets.form import on_change

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


TRACK = """<style>
div:has(>.%(name)s)+div :is(.mantine-Slider-root,.mantine-Slider-trackContainer,
 .mantine-Slider-track,.mantine-Slider-thumb){height:%(h)dpx!important}
div:has(>.%(name)s)+div .mantine-Slider-track{background:0 0/100%% 100%% no-repeat
 url(data:image/svg+xml;base64,%(data)s)}
div:has(>.%(name)s)+div .mantine-Slider-markWrapper{top:%(mark)dpx}
</style><div class="r-track %(name)s"></div>"""


class ImageSlider:
    """A slider that is built anew with each image."""

    def __init__(
        self, gui: Any, name: str, label: str, height_px: int, call: Callable[[Any], None]
    ) -> None:
        """Add the place of the slider; ``name`` is a CSS class that no other slider has."""
        self._gui, self._name, self._label, self._height_px = gui, name, label, height_px
        self._call = call
        self.folder = gui.add_folder(None, visible=False)
        self._parts: tuple[Any, ...] = ()

    @property
    def value(self) -> int | None:
        """Where the slider is; None while there is none."""
        return int(self._parts[1].value) if self._parts else None

    @value.setter
    def value(self, place: int) -> None:
        if self._parts:
            self._parts[1].value = place

    def show(
        self, svg: str, span: tuple[int, int], value: int, marks: tuple[tuple[int, str], ...]
    ) -> None:
        """Show an image as SVG, with the slider from the first to the last of ``span`` on it."""
        self.clear()
        with self.folder:
            track = self._gui.add_html(_track(self._name, self._height_px, svg))
            slider = self._gui.add_slider(self._label, *span, 1, value, marks=marks)
        self._parts = track, slider
        self.folder.visible = True
        on_change(slider, self._call)

    def clear(self) -> None:
        """Remove image and slider."""
        for part in self._parts:
            part.remove()
        self._parts = ()
        self.folder.visible = False


def _track(name: str, height_px: int, svg: str) -> str:
    """Return the style that makes an image the track of the slider added next."""
    data = base64.b64encode(svg.encode()).decode()
    return TRACK % {"name": name, "h": height_px, "mark": height_px + 2, "data": data}


def png_url(image: NDArray[np.uint8]) -> str:
    """Return an image (h, w, 3) as a PNG in an address, for SVG."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "png")
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
