"""Contact force: live during the scan, over path or time afterwards."""

from typing import Any

import numpy as np

from rona_core.app.steps.scan.view import (
    ForceCurve,
    contact_report,
    force_curve,
    live_force,
)
from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.graphs import Axis, Graph
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.colors import CATEGORIES, GREEN, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot, changed

ACROSS = {"Path (mm)": "path", "Time (s)": "time"}
FILLS = {  # state -> colour of its background
    "approach": "rgba(86,180,233,0.25)",
    "lost": "rgba(213,94,0,0.35)",
    "retract": "rgba(138,151,165,0.25)",
    "stopped": "rgba(176,0,32,0.35)",
}
EMPTY = "The force appears during the scan (step 8)."
LEAST_N = 1.5  # above the set point, that the graph shows
LINE = {"points": {"show": False}}
LIMIT = {"stroke": css(VERMILLION), "width": 1, "dash": (5, 4), **LINE}
SERIES = (
    *(
        {"label": w, "stroke": "transparent", "width": 0, "fill": c, **LINE}
        for w, c in FILLS.items()
    ),
    {"label": "set point", "stroke": css(GREEN), "width": 1, **LINE},
    {"label": "soft limit", **LIMIT},
    {"label": "stop", **LIMIT},
    {"label": "force", "stroke": css(CATEGORIES[0]), "width": 1.5, **LINE},
)


class ForcePanel:
    """A graph of the force with set point, limits and the states of the force loop."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        across = gui.add_dropdown("Horizontal axis", tuple(ACROSS))
        self._words = gui.add_html(style.text(EMPTY))
        self._graph = Graph(gui, 215)
        on_change(across, lambda e: context.set_view(force_across=ACROSS[across.value]))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the scan; while the robot scans, the newest seconds."""
        live = new.live.force if new.scanning else None
        seen = ("session.captures.scan", "session.setup", "view.force_across", "scanning")
        if not changed(old, new, *seen, *(("live.force",) if live is not None else ())):
            return
        if live is not None:
            curve, words = live_force(new.session, live), ""
        else:
            curve, report = (
                force_curve(new.session, new.view.force_across),
                contact_report(new.session),
            )
            words = EMPTY if report is None else report.sentence
        if curve is None:
            self._words.content = style.text(words)
            self._graph.clear()
            return
        x, y = graph_axes(curve)
        self._graph.show(x, y, force_data(curve), ({"label": curve.axis}, *SERIES))
        last = f"Now {curve.force_n[-1]:.1f} N, {curve.states[-1]}." if live is not None else words
        self._words.content = style.text(last) + style.key(force_key(curve))


def graph_axes(curve: ForceCurve) -> tuple[Axis, Axis]:
    """Return axes that show all of the force, and limits where they come near."""
    high = max(float(curve.force_n.max()), curve.setpoint_n) + LEAST_N
    low = min(-0.5, float(curve.force_n.min()) - 0.2)  # an unloaded sensor reads about zero
    start = float(curve.at[0])
    return (
        Axis(curve.axis, start, max(float(curve.at[-1]), start + 1e-3)),
        Axis("force (N)", float(np.floor(2.0 * low)) / 2.0, float(np.ceil(high))),
    )


def force_data(curve: ForceCurve) -> tuple[Floats, ...]:
    """Return the columns: place or time, a background for each state, set point, limits, force."""
    ones, high = np.ones(len(curve.at)), graph_axes(curve)[1].high
    states = np.array(curve.states)
    backs = [np.where(states == word, high, 0.0) for word in FILLS]  # filled down to zero
    beyond = high + 1.0  # limits that the graph does not reach are drawn above it
    limits = [ones * (beyond if v is None else v) for v in (curve.monitor_n, curve.stop_n)]
    return (curve.at, *backs, curve.setpoint_n * ones, *limits, curve.force_n)


def force_key(curve: ForceCurve) -> tuple[tuple[str, str], ...]:
    """Return colours and words of what is to be seen."""
    high_n = graph_axes(curve)[1].high
    limits = ((curve.monitor_n, "soft limit"), (curve.stop_n, "hard limit"))
    words = ", ".join(f"{word} {at:.0f} N" for at, word in limits if at is not None and at < high_n)
    seen = [(css(CATEGORIES[0]), "force"), (css(GREEN), "set point")]
    seen += [(css(VERMILLION), words)] if words else []
    return tuple(seen + [(color, word) for word, color in FILLS.items() if word in curve.states])
