"""Second pass: its path, the tilted probe axes, and the cells seen only by it."""

import numpy as np

from rona_core.app.steps.maps.view import SecondView, second_cells, second_view
from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import SKY, Rgb, viridis
from rona_ui.presentation.shown_maps import shows_handheld_maps
from rona_ui.presentation.shown_path import shows_second_path, tilt_scale_max_deg
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import segments

PATH, AXES, CELLS = "/second/path", "/second/axes", "/second/cells"
SHADES = 6
AXIS_MM = 10.0
MOST_AXES = 240
LIFT_MM = 1.2
CELL_MM, PATH_MM = 0.4, 0.35
WHITE: Rgb = (255, 255, 255)


class SecondLayer(Layer):
    """Draws the second path until it is scanned, and while that pass is selected."""

    layer = "second"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the path where it is another one, and the cells where the maps are."""
        if old is None or old.session.results.second is not new.session.results.second:
            self._draw_path(second_view(new.session))
        lift = 0.0 if new.static_scene is None else LIFT_MM * new.static_scene.region_normal_base
        if (
            old is None
            or old.session.results.maps is not new.session.results.maps
            or old.session.captures.second is not new.session.captures.second
            or old.static_scene is not new.static_scene
        ):
            cells = second_cells(new.session)
            points = np.zeros((0, 3)) if cells is None else cells.points_base + lift
            self.nodes.cloud(CELLS, points, WHITE, size_mm=CELL_MM)
        for node in (PATH, *(f"{AXES}{shade}" for shade in range(SHADES))):
            self.nodes.show(node, self.shown(new) and shows_second_path(new))
        mapped = new.view.shows("inner") and not shows_handheld_maps(new)
        self.nodes.show(CELLS, self.shown(new) and mapped)

    def _draw_path(self, view: SecondView | None) -> None:
        points = np.zeros((0, 3)) if view is None else view.points_base
        self.nodes.lines(PATH, segments(points), SKY, width_mm=PATH_MM)
        colors = viridis((np.arange(SHADES) + 0.5) / SHADES)
        for shade in range(SHADES):
            pairs = np.zeros((0, 2, 3))
            if view is not None:
                pairs = axes(view)[shades(view) == shade]
            r, g, b = (int(part) for part in colors[shade])
            self.nodes.lines(f"{AXES}{shade}", pairs, (r, g, b), width_px=2.0)


def _every(view: SecondView) -> slice:
    return slice(None, None, 1 + len(view.points_base) // MOST_AXES)


def axes(view: SecondView) -> Floats:
    """Return the probe's axis out of the bone at some places of the path: segments (n, 2, 3)."""
    some = _every(view)
    feet = view.points_base[some]
    return np.stack((feet, feet - AXIS_MM * view.axes_base[some]), axis=1)


def shades(view: SecondView) -> np.ndarray:
    """Return the number of the shade (n,) of each axis, from no tilt to the largest."""
    share = view.lean_deg[_every(view)] / max(tilt_scale_max_deg(view), 1e-9)
    return np.clip((share * SHADES).astype(np.int64), 0, SHADES - 1)
