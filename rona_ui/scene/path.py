"""The demonstrated and the smoothed path, its way-points and every k-th probe axis."""

import numpy as np

from rona_ui.scene.adapter import Layer
from rona_ui.scene.colors import BLUE, ORANGE, YELLOW
from rona_ui.scene.metres import segments
from rona_ui.view_state import Picture

RAW, SMOOTH, CORNERS, AXES = "/path/raw", "/path/smooth", "/path/points", "/path/axes"
LIFT_MM = 0.5
AXIS_MM = 14.0
MOST_AXES = 120


class PathLayer(Layer):
    """Draws the raw path in orange, the smoothed one in blue with its way-points."""

    layer = "path"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw each path where it is another one."""
        raw, smooth = new.session.results.path, new.session.results.smoothing
        lift = 0.0 if new.backdrop is None else LIFT_MM * new.backdrop.region_normal_base
        before = None if old is None or old.backdrop is not new.backdrop else old.session.results
        if before is None or before.path is not raw:
            points = np.zeros((0, 3)) if raw is None else raw.value.points_base + lift
            self.stage.lines(RAW, segments(points), ORANGE, width_px=2.0)
        if before is None or before.smoothing is not smooth:
            dense = np.zeros((0, 3)) if smooth is None else smooth.value.path.points_base
            self.stage.lines(SMOOTH, segments(dense + 3 * lift), BLUE, width_px=4.0)
            corners = _corners(new) + 3 * lift
            self.stage.cloud(CORNERS, corners, BLUE, size_mm=1.3)
        clear = new.view.everything or not _scanned(new)
        self.stage.show(RAW, self.shown(new) and clear)
        later = self.shown(new) and clear and (new.view.step != "path" or new.view.everything)
        for node in (SMOOTH, CORNERS):
            self.stage.show(node, later)


def _scanned(picture: Picture) -> bool:
    """Return whether the path would hide the points of a scan, which lie on it."""
    there = picture.session.captures.scan is not None and not picture.scanning
    return picture.view.step == "scan" and there


def _corners(picture: Picture) -> np.ndarray:
    smooth, raw = picture.session.results.smoothing, picture.session.results.path
    if smooth is None or raw is None:
        return np.zeros((0, 3))
    index = smooth.value.simplified.index
    points = raw.value.points_base
    return points[index[index < len(points)]]


class AxesLayer(Layer):
    """Draws the probe axes as short lines that stand out of the bone."""

    layer = "arrows"

    def render(self, old: Picture | None, new: Picture) -> None:
        """Draw every k-th axis where the path is another one."""
        smooth = new.session.results.smoothing
        if old is None or old.session.results.smoothing is not smooth:
            pairs = np.zeros((0, 2, 3))
            if smooth is not None:
                path = smooth.value.path
                step = 1 + len(path) // MOST_AXES
                feet = path.points_base[::step]
                pairs = np.stack((feet, feet - AXIS_MM * path.axes_base[::step]), axis=1)
            self.stage.lines(AXES, pairs, YELLOW, width_px=1.5)
        self.stage.show(AXES, self.shown(new))
