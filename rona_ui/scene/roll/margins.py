"""The path coloured by how far the robot stays from its borders, and the point that stops it."""

import numpy as np

from rona_core.app.steps.roll.margins_view import PathMargins, path_margins
from rona_core.app.steps.roll.view import joint_curves, shown_roll
from rona_core.geometry.arrays import Floats
from rona_ui.presentation.colors import VERMILLION, viridis
from rona_ui.presentation.shown_path import MARGIN_SCALE_MAX, shows_margins
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.scene.layer import Layer

PATH, STOP, WORDS = "/margins/path", "/margins/stop", "/margins/words"
LIFT_MM = 1.5
DOTS_MM = 0.5


class MarginsLayer(Layer):
    """Draws the path in step 7: viridis for the margin, red where the robot cannot follow."""

    layer = "path"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw where search, roll, quantity or surroundings are others."""
        if not (self.shown(new) and shows_margins(new)):
            for node in (PATH, STOP, WORDS):
                self.nodes.remove(node)
            return
        drawn = old is not None and self.shown(old) and shows_margins(old)
        if old is None or not drawn or _key(old) != _key(new):
            self._draw(new)

    def _draw(self, new: Snapshot) -> None:
        found = path_margins(new.session, new.view.shown_roll)
        lift = 0.0 if new.static_scene is None else LIFT_MM * new.static_scene.region_normal_base
        places, colors = (np.zeros((0, 3)), viridis([])) if found is None else colored(found, new)
        self.nodes.cloud(PATH, places + lift, colors, size_mm=1.6)
        curves, searched = (
            joint_curves(new.session, new.view.shown_roll),
            new.session.results.roll,
        )
        stop, words = np.zeros((0, 3)), ""
        if curves is not None and searched is not None and not curves.feasible:
            index = shown_roll(new.session, new.view.shown_roll) or 0
            verdict = searched.value.verdicts[index]
            stop = searched.value.path.points_base[verdict.index][None] + lift
            words = stop_words(verdict.reason, verdict.joint, verdict.value, verdict.limit)
        self.nodes.cloud(STOP, stop, VERMILLION, size_mm=5.0)
        if len(stop):
            self.nodes.label(WORDS, words, stop[0] + 3.0 * lift)
        else:
            self.nodes.remove(WORDS)


def colored(found: PathMargins, snapshot: Snapshot) -> tuple[Floats, np.ndarray]:
    """Return dots along the path (n, 3) and their colours (n, 3)."""
    quantity = snapshot.view.margin
    points, values, fails = found.points_base, found.values(quantity), found.fails(quantity)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    way = np.concatenate(([0.0], np.cumsum(steps)))
    at = np.linspace(0.0, way[-1], int(np.clip(np.ceil(way[-1] / DOTS_MM), 1, 20_000)) + 1)
    places = np.column_stack([np.interp(at, way, column) for column in points.T])
    nearest = np.clip(np.searchsorted(way, at, side="right") - 1, 0, len(way) - 1)
    colors = viridis(np.interp(at, way, values) / MARGIN_SCALE_MAX[quantity])
    colors[fails[nearest]] = VERMILLION
    return places, colors


def stop_words(reason: str, joint: int, value: float, limit: float) -> str:
    """Return what stops the robot, short enough to stand in the scene."""
    if reason == "reach":
        return f"out of reach by {-value:.0f} mm"
    if reason == "limit":
        return f"joint {joint}: {value:.1f}° (limit {limit:.1f}°)"
    if reason == "jump":
        return f"joint {joint} jumps by {value:.1f}°"
    if reason == "singularity":
        if joint == 1:
            return f"wrist {value:.0f} mm from axis 1"
        return f"joint {joint} {value:.1f}° from straight"
    return reason


def _key(snapshot: Snapshot) -> tuple[object, ...]:
    session, view = snapshot.session, snapshot.view
    return (
        id(session.results),
        id(session.setup),
        id(snapshot.static_scene),
        view.shown_roll,
        view.margin,
    )
