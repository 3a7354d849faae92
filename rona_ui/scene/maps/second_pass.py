"""Second pass: its path, the tilted probe axes, and the cells seen only by it."""

import numpy as np

from rona_core.app.steps.maps.view import SecondView, second_cells, second_view
from rona_ui.presentation.colors import SKY, Rgb
from rona_ui.presentation.shown_maps import shows_handheld_maps
from rona_ui.presentation.shown_path import shows_second_path, tilt_scale_max_deg
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer, lift
from rona_ui.scene.viser_nodes import NO_POINTS, draw_shaded, segments, shaded

PATH, AXES, CELLS = "/second/path", "/second/axes", "/second/cells"
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
        if changed(old, new, "session.results.second"):
            self._draw_path(second_view(new.session))
        if changed(old, new, "session.results.maps", "session.captures.second", "static_scene"):
            cells = second_cells(new.session)
            points = NO_POINTS if cells is None else cells.points_base + lift(new, LIFT_MM)
            self.nodes.cloud(CELLS, points, WHITE, size_mm=CELL_MM)
        for node in (PATH, *shaded(AXES)):
            self.nodes.show(node, self.shown(new) and shows_second_path(new))
        mapped = new.view.shows("inner") and not shows_handheld_maps(new)
        self.nodes.show(CELLS, self.shown(new) and mapped)

    def _draw_path(self, view: SecondView | None) -> None:
        """Draw the path, and at some places the probe's axis out of the bone."""
        if view is None:
            for node in (PATH, *shaded(AXES)):
                self.nodes.remove(node)
            return
        self.nodes.lines(PATH, segments(view.points_base), SKY, width_mm=PATH_MM)
        every = 1 + len(view.points_base) // MOST_AXES
        feet, axes = view.points_base[::every], view.axes_base[::every]
        pairs = np.stack((feet, feet - AXIS_MM * axes), axis=1)
        shares = view.lean_deg[::every] / max(tilt_scale_max_deg(view), 1e-9)
        draw_shaded(self.nodes, AXES, pairs, shares)
