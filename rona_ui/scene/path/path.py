"""Demonstrated and smoothed path, its points, normals and warnings."""

import numpy as np

from rona_core.app.steps.path.path_checks import check_path
from rona_ui.presentation.colors import BLUE, ORANGE, PURPLE, VERMILLION, viridis
from rona_ui.presentation.shown import shown_path, shown_path_key, shows_margins
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.scene.layer import Layer, lift
from rona_ui.scene.viser_nodes import NO_LINES, NO_POINTS, dots_along, draw_shaded, segments, shaded

RAW, SMOOTH, CORNERS, AXES = "/path/raw", "/path/smooth", "/path/points", "/path/axes"
DEVIATION, TILTED, THIN = "/path/deviation", "/path/tilted", "/path/thin"
LIFT_MM = 0.5
RAW_MM, SMOOTH_MM = 0.45, 0.8  # widths: from afar the rows stay apart
AXIS_MM = 14.0
MOST_AXES = 120


class PathLayer(Layer):
    """Draws the raw path in orange, in step 6 by its deviation, and the smoothed one in blue."""

    layer = "path"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw each path where it is another one."""
        fresh = changed(old, new, "static_scene")
        if fresh or changed(old, new, "session.results.path"):
            raw = new.session.results.path
            points = NO_POINTS if raw is None else raw.value.points_base + lift(new, LIFT_MM)
            self.nodes.lines(RAW, segments(points), ORANGE, width_mm=RAW_MM)
        if fresh or old is None or shown_path_key(old) != shown_path_key(new):
            self.draw(new)
        self._show(new)

    def draw(self, new: Snapshot) -> None:
        """Draw the smoothed path with its points, and the deviation of the raw one."""
        view, smooth = shown_path(new), new.session.results.smoothing
        corners = dense = NO_POINTS
        if smooth is not None:
            corners, dense = smooth.value.corners_base, smooth.value.path.points_base
        if view is not None:
            corners = view.corners_base
            dense = corners if view.preview else dense
        self.nodes.lines(SMOOTH, segments(dense + lift(new, 3 * LIFT_MM)), BLUE, width_mm=SMOOTH_MM)
        self.nodes.cloud(CORNERS, corners + lift(new, 4 * LIFT_MM), BLUE, size_mm=0.9)
        if view is None:
            self.nodes.remove(DEVIATION)
            return
        points, values = dots_along(view.raw_base, view.from_raw_mm)
        colors = viridis(values / max(view.tolerance_mm, 1e-9))
        self.nodes.cloud(DEVIATION, points + lift(new, 2 * LIFT_MM), colors, size_mm=0.45)

    def _show(self, new: Snapshot) -> None:
        clear = new.view.all_layers or not _scanned(new)
        by_deviation = new.view.step == "smoothing" and DEVIATION in self.nodes.names()
        self.nodes.show(RAW, self.shown(new) and clear and not by_deviation)
        self.nodes.show(DEVIATION, self.shown(new) and by_deviation)
        later = self.shown(new) and clear and (new.view.step != "path" or new.view.all_layers)
        later = later and not shows_margins(new)
        for node in (SMOOTH, CORNERS):
            self.nodes.show(node, later)


def _scanned(snapshot: Snapshot) -> bool:
    """Return whether the path would hide the points of a scan on it."""
    there = snapshot.session.captures.scan is not None and not snapshot.scanning
    return snapshot.view.step == "scan" and there


class AxesLayer(Layer):
    """Draws the normals as short lines out of the bone, coloured by their predicted error."""

    layer = "arrows"
    follows = ("session.results.smoothing", "session.setup.devices.probe.name")
    names = shaded(AXES)

    def shown(self, snapshot: Snapshot) -> bool:
        """Hide them while a preview is dragged: those of a preview are not known."""
        return Layer.shown(self, snapshot) and snapshot.preview_mm is None

    def draw(self, new: Snapshot) -> None:
        """Draw every k-th normal."""
        check = check_path(new.session)
        pairs, shares = NO_LINES, np.zeros(0)
        if check is not None:
            every = 1 + len(check.sigma_deg) // MOST_AXES
            feet, normals = check.places_base[::every], check.normals[::every]
            pairs = np.stack((feet, feet + AXIS_MM * normals), axis=1)
            shares = check.sigma_deg[::every] / check.tolerance_deg
        draw_shaded(self.nodes, AXES, pairs, shares)


class WarningsLayer(AxesLayer):
    """Marks places of too large probe tilt, and places to sample again."""

    layer = "warnings"
    names = (TILTED, THIN)

    def draw(self, new: Snapshot) -> None:
        """Draw the marks."""
        check = check_path(new.session)
        for node, color, size in ((TILTED, VERMILLION, 1.5), (THIN, PURPLE, 1.0)):
            points = NO_POINTS
            if check is not None:
                marked = check.tilted if node == TILTED else check.thin
                points = (check.places_base + 4 * LIFT_MM * check.normals)[marked]
            self.nodes.cloud(node, points, color, size_mm=size)
