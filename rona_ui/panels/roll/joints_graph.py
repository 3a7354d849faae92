"""The joints along the path, with their limits shaded."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.roll.view import JointCurves, joint_curves, shown_roll
from rona_core.app.steps.scan.planned_motion import path_percent_at
from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change
from rona_ui.panels.widgets.graphs import INK, Axis, Graph
from rona_ui.presentation.colors import CATEGORIES, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed

JOINTS = ("All, share of range", *(f"Joint {j}" for j in range(1, 7)))
BELOW = 3.0  # graph heights
MOST_PLACES = 300  # along the path: about the width of the graph in pixels
SHADE = "rgba(213,94,0,0.20)"
EMPTY = "The joint graphs appear after step 7."
FOLLOWED = ("session.results.roll", "view.shown_roll", "view.joint", "view.cursor", "view.second")
PATH = Axis("path (%)", 0.0, 100.0)
MARKS = (
    {"label": "worst", "stroke": css(VERMILLION), "width": 2, "dash": (5, 4)},
    {"label": "now", "stroke": INK, "width": 2},
)
EDGES = tuple({"label": n, "stroke": "#a34700", "width": 1} for n in ("l0", "l", "h", "h1"))
SPOTS = {
    "label": "fails",
    "stroke": css(VERMILLION),
    "width": 0,
    "points": {"show": True, "size": 5, "fill": css(VERMILLION)},
}


class JointsPanel:
    """Six joints of the shown roll; the forbidden zones are shaded, the failing place is marked."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        select = gui.add_dropdown("Joint", JOINTS)
        self._words = gui.add_html(style.text(EMPTY))
        self._graph = Graph(gui, 225)
        on_change(select, lambda e: context.set_view(joint=JOINTS.index(select.value)))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the shown roll, the chosen joint and the cursor."""
        if not changed(old, new, *FOLLOWED):
            return
        curves, joint = joint_curves(new.session, new.view.shown_roll), new.view.joint
        if curves is None:
            self._graph.clear()
            self._words.content = style.text(EMPTY)
            return
        cursor = None
        if new.view.cursor is not None and not new.view.second and _is_planned(new):
            cursor = path_percent_at(new.session, new.view.cursor)
        data, low, high = joint_data(thinned(curves), joint, cursor)
        shown = tuple(range(1, 7)) if joint == 0 else (joint,)
        lines = [
            {
                "label": f"J{j}",
                "stroke": css(CATEGORIES[j - 1]),
                "width": 2,
                "points": {"show": False},
            }
            for j in shown
        ]
        zones = 1 + len(lines) + len(MARKS)  # number of the first edge of a shaded zone
        bands = tuple(
            {"series": (upper, upper - 1), "fill": SHADE} for upper in (zones + 1, zones + 3)
        )
        unit = "share of range (%)" if joint == 0 else f"joint {joint} (deg)"
        series = ({"label": "path"}, *lines, *MARKS, *EDGES, SPOTS)
        self._graph.show(PATH, Axis(unit, low, high), data, series, bands)
        self._words.content = _joint_words(curves)


def _is_planned(snapshot: Snapshot) -> bool:
    roll = snapshot.session.results.roll
    return roll is not None and shown_roll(snapshot.session, snapshot.view.shown_roll) == max(
        roll.value.search.chosen, 0
    )


def thinned(curves: JointCurves) -> JointCurves:
    """Return curves at no more places than the graph can show; one that fails goes on to tell."""
    count = len(curves.path_percent)
    if count <= MOST_PLACES:
        return curves
    kept = np.linspace(0, count - 1, MOST_PLACES).round().astype(np.int64)
    fails = None if curves.fails is None else np.logical_or.reduceat(curves.fails, kept)
    places, joints = curves.path_percent[kept], curves.joints_deg[kept]
    return replace(curves, path_percent=places, joints_deg=joints, fails=fails)


def joint_data(
    curves: JointCurves, joint: int, cursor_percent: float | None
) -> tuple[tuple[Floats, ...], float, float]:
    """Return the columns of the graph and the limits of its y axis.

    Columns: path (%), the joints, the worst place, the cursor, four edges of the shaded zones, and
    the spots where the robot cannot follow: on the joint that is to blame, else along the bottom.
    With ``joint`` 0 all joints are shown as a share of their range, else one in degrees.
    """
    if joint == 0:
        span = curves.upper_deg - curves.lower_deg
        values = 100.0 * (curves.joints_deg - curves.lower_deg) / span
        lower, upper, low, high = 0.0, 100.0, -15.0, 115.0
    else:
        values = curves.joints_deg[:, joint - 1 : joint]
        lower, upper = float(curves.lower_deg[joint - 1]), float(curves.upper_deg[joint - 1])
        edge = 0.12 * (upper - lower)
        low, high = lower - edge, upper + edge
    x, columns = curves.path_percent, [np.clip(c, low, high) for c in values.T]
    worst = None if curves.feasible else curves.worst_percent
    marks = [m for m in (worst, cursor_percent) if m is not None]
    at = np.sort(np.concatenate((x, np.repeat(np.array(marks, dtype=np.float64), 3))))
    columns = [np.interp(at, x, c) for c in columns]
    ones = np.ones(len(at))
    return (
        (
            at,
            *columns,
            _upright(at, worst, low, high),
            _upright(at, cursor_percent, low, high),
            low * ones,
            lower * ones,
            upper * ones,
            high * ones,
            _spots(at, curves, joint, columns, low, high),
        ),
        low,
        high,
    )


def _spots(
    at: Floats, curves: JointCurves, joint: int, columns: list[Floats], low: float, high: float
) -> Floats:
    """Return a column of the failing spots, far below the graph where nothing fails."""
    below = np.full(len(at), low - BELOW * (high - low))
    if curves.fails is None:
        return below
    fails = np.interp(at, curves.path_percent, curves.fails.astype(np.float64)) > 0.5
    height = np.full(len(at), low + 0.02 * (high - low))
    if joint == 0 and curves.worst_joint:
        height = columns[curves.worst_joint - 1]
    elif joint and joint == curves.worst_joint:
        height = columns[0]
    return np.where(fails, height, below)


def _upright(at: Floats, place: float | None, low: float, high: float) -> Floats:
    """Return a column that draws a vertical line at a place that occurs three times in ``at``.

    Elsewhere the column lies far below the graph; gaps of NaN would not be drawn as gaps.
    """
    column = np.full(len(at), low - BELOW * (high - low))
    if place is not None:
        column[np.flatnonzero(at == place)[1]] = high
    return column


def _joint_words(curves: JointCurves) -> str:
    names = tuple((css(color), f"J{j}") for j, color in enumerate(CATEGORIES, start=1))
    words = f"Roll {curves.roll_deg:.0f}°. Shaded: beyond the joint limits."
    if curves.variation_deg > 0.0:
        words = (
            f"Roll varying over {curves.variation_deg:.0f}° along the path. "
            "Shaded: beyond the joint limits."
        )
    if not curves.feasible:
        words += " Dashed: first failure. Dots: all infeasible places."
    return style.key(names) + style.text(words)
