"""Demonstrated and smoothed path, its points, normals and warnings."""

import numpy as np

from rona_core.app.steps.path.path_checks import PathCheck, check_path
from rona_core.app.steps.smoothing.path_view import PathView
from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import BLUE, ORANGE, PURPLE, VERMILLION, viridis
from rona_ui.presentation.shown_path import shown_path, shown_path_key, shows_margins
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer
from rona_ui.scene.viser_nodes import segments

RAW, SMOOTH, CORNERS, AXES = "/path/raw", "/path/smooth", "/path/points", "/path/axes"
DEVIATION, TILTED, THIN = "/path/deviation", "/path/tilted", "/path/thin"
LIFT_MM = 0.5
RAW_MM, SMOOTH_MM = 0.45, 0.8  # widths: from afar the rows stay apart
AXIS_MM = 14.0
MOST_AXES = 120
SHADES = 8  # of the colour bar; one line can only be of one colour
DOTS_MM = 0.5  # between the dots that show the deviation


class PathLayer(Layer):
    """Draws the raw path in orange, in step 6 by its deviation, and the smoothed one in blue."""

    layer = "path"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw each path where it is another one."""
        raw, smooth = new.session.results.path, new.session.results.smoothing
        lift = 0.0 if new.static_scene is None else LIFT_MM * new.static_scene.region_normal_base
        fresh = old is None or old.static_scene is not new.static_scene
        if fresh or old is None or old.session.results.path is not raw:
            points = np.zeros((0, 3)) if raw is None else raw.value.points_base + lift
            self.nodes.lines(RAW, segments(points), ORANGE, width_mm=RAW_MM)
        if fresh or old is None or shown_path_key(old) != shown_path_key(new):
            view, dense = shown_path(new), np.zeros((0, 3))
            if view is not None and view.preview:
                dense = view.corners_base
            elif smooth is not None:
                dense = smooth.value.path.points_base
            corners = np.zeros((0, 3)) if smooth is None else smooth.value.corners_base
            corners = corners if view is None else view.corners_base
            self.nodes.lines(SMOOTH, segments(dense + 3 * lift), BLUE, width_mm=SMOOTH_MM)
            self.nodes.cloud(CORNERS, corners + 4 * lift, BLUE, size_mm=0.9)
            self._draw_deviation(view, lift)
        self._show(new)

    def _draw_deviation(self, view: PathView | None, lift: Floats | float) -> None:
        if view is None:
            self.nodes.remove(DEVIATION)
            return
        points, values = dots_along(view.raw_base, view.from_raw_mm)
        shares = values / max(view.tolerance_mm, 1e-9)
        self.nodes.cloud(DEVIATION, points + 2 * lift, viridis(shares), size_mm=0.45)

    def _show(self, new: Snapshot) -> None:
        clear = new.view.all_layers or not _scanned(new)
        by_deviation = new.view.step == "smoothing" and DEVIATION in self.nodes.names()
        self.nodes.show(RAW, self.shown(new) and clear and not by_deviation)
        self.nodes.show(DEVIATION, self.shown(new) and by_deviation)
        later = self.shown(new) and clear and (new.view.step != "path" or new.view.all_layers)
        later = later and not shows_margins(new)
        for node in (SMOOTH, CORNERS):
            self.nodes.show(node, later)


def dots_along(points: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return places along a path (n, 3), close enough to look like a line, and values (m,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    count = int(np.clip(np.ceil(along[-1] / DOTS_MM), 1, 20_000)) + 1
    dots_mm = np.linspace(0.0, along[-1], count)
    if not along[-1] > 0.0:
        return points[:1], values[:1]
    places = np.column_stack([np.interp(dots_mm, along, column) for column in points.T])
    return places, np.interp(dots_mm, along, values)


def _scanned(snapshot: Snapshot) -> bool:
    """Return whether the path would hide the points of a scan on it."""
    there = snapshot.session.captures.scan is not None and not snapshot.scanning
    return snapshot.view.step == "scan" and there


def _check_key(snapshot: Snapshot) -> tuple[int, str]:
    session = snapshot.session
    return id(session.results.smoothing), session.setup.devices.probe.name


class AxesLayer(Layer):
    """Draws the normals as short lines out of the bone, coloured by their predicted error."""

    layer = "arrows"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw every k-th normal where the path is another one."""
        if old is None or _check_key(old) != _check_key(new):
            self._draw(check_path(new.session))
        shown = self.shown(new) and new.preview_mm is None  # those of a preview are not known
        for shade in range(SHADES):
            self.nodes.show(f"{AXES}{shade}", shown)

    def _draw(self, check: PathCheck | None) -> None:
        colors = viridis((np.arange(SHADES) + 0.5) / SHADES)
        for shade in range(SHADES):
            pairs = np.zeros((0, 2, 3))
            if check is not None:
                every = 1 + len(check.sigma_deg) // MOST_AXES
                feet, normals = check.places_base[::every], check.normals[::every]
                held = shades(check.sigma_deg[::every], check.tolerance_deg) == shade
                pairs = np.stack((feet, feet + AXIS_MM * normals), axis=1)[held]
            r, g, b = (int(part) for part in colors[shade])
            self.nodes.lines(f"{AXES}{shade}", pairs, (r, g, b), width_px=2.0)


def shades(sigma_deg: Floats, tolerance_deg: float) -> np.ndarray:
    """Return the number of the shade (m,) of each normal, from 0 to the tolerance."""
    return np.clip((sigma_deg / tolerance_deg * SHADES).astype(np.int64), 0, SHADES - 1)


class WarningsLayer(Layer):
    """Marks places of too large probe tilt, and places to sample again."""

    layer = "warnings"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the marks where the path is another one."""
        if old is None or _check_key(old) != _check_key(new):
            check = check_path(new.session)
            for node, color, size in ((TILTED, VERMILLION, 1.5), (THIN, PURPLE, 1.0)):
                points = np.zeros((0, 3))
                if check is not None:
                    highlighted_parts = check.tilted if node == TILTED else check.thin
                    points = (check.places_base + 4 * LIFT_MM * check.normals)[highlighted_parts]
                self.nodes.cloud(node, points, color, size_mm=size)
        for node in (TILTED, THIN):
            self.nodes.show(node, self.shown(new) and new.preview_mm is None)
