"""Contact force: live during the scan, over path or time afterwards."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rona_core.app.steps.scan.contact_view import (
    ForceCurve,
    contact_report,
    force_curve,
    live_force,
)
from rona_core.geometry.arrays import Floats
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.graph_style import PADDING, axis
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.colors import CATEGORIES, GREEN, VERMILLION, css
from rona_ui.presentation.snapshot import Snapshot

ACROSS = {"Path (mm)": "path", "Time (s)": "time"}
FILLS = {  # state -> colour of its background
    "approach": "rgba(86,180,233,0.25)",
    "lost": "rgba(213,94,0,0.35)",
    "retract": "rgba(138,151,165,0.25)",
    "stopped": "rgba(176,0,32,0.35)",
}
EMPTY = "The force appears during the scan (step 8)."
LEAST_N = 1.5  # above the set point, that the graph shows


class ForcePanel:
    """A graph of the force with set point, limits and the states of the force loop."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._gui = gui
        self._across = gui.add_dropdown("Horizontal axis", tuple(ACROSS))
        self._words = gui.add_html(style.text(EMPTY))
        self._folder = gui.add_folder(None)
        self._plot: Any = None
        self._frame: Frame | None = None
        on_change(
            self._across,
            lambda e: context.change_view(
                lambda v: replace(v, force_across=ACROSS[self._across.value])
            ),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the scan; while the robot scans, the newest seconds."""
        live = new.scanning and new.live.force is not None
        if (
            old is not None
            and old.session.captures.scan is new.session.captures.scan
            and old.session.setup is new.session.setup
            and old.view.force_across == new.view.force_across
            and old.scanning == new.scanning
            and (not live or old.live.force is new.live.force)
        ):
            return
        if new.live.force is not None and live:
            curve, words = live_force(new.session, new.live.force), ""
        else:
            curve = force_curve(new.session, new.view.force_across)
            report = contact_report(new.session)
            words = EMPTY if report is None else report.sentence
        if curve is None:
            self._clear(words)
            return
        self._draw(curve)
        last = f"Now {curve.force_n[-1]:.1f} N, {curve.states[-1]}." if live else words
        self._words.content = style.text(last) + style.key(force_key(curve))

    def _clear(self, words: str) -> None:
        self._words.content = style.text(words)
        if self._plot is not None:
            self._plot.remove()
            self._plot = None

    def _draw(self, curve: ForceCurve) -> None:
        frame, data = graph_frame(curve), force_data(curve)
        if self._plot is not None and frame == self._frame:
            self._plot.data = data
            return
        if self._plot is not None:
            self._plot.remove()
        self._frame = frame
        line = {"points": {"show": False}}
        states = tuple(
            {"label": word, "stroke": "transparent", "width": 0, "fill": color, **line}
            for word, color in FILLS.items()
        )
        limit = {"stroke": css(VERMILLION), "width": 1, "dash": (5, 4), **line}
        with self._folder:
            self._plot = self._gui.add_uplot(
                data,
                (
                    {"label": curve.axis},
                    *states,
                    {"label": "set point", "stroke": css(GREEN), "width": 1, **line},
                    {"label": "soft limit", **limit},
                    {"label": "stop", **limit},
                    {"label": "force", "stroke": css(CATEGORIES[0]), "width": 1.5, **line},
                ),
                scales={
                    "x": {"time": False, "range": (frame.start, frame.end)},
                    "y": {"range": (frame.low_n, frame.high_n)},
                },
                axes=(axis(curve.axis), axis("force (N)")),
                legend={"show": False},
                cursor={"drag": {"x": True, "y": False}},
                height=215,
                padding=PADDING,
            )


@dataclass(frozen=True, slots=True)
class Frame:
    """Ends of the axes."""

    start: float
    end: float
    low_n: float
    high_n: float


def graph_frame(curve: ForceCurve) -> Frame:
    """Return what the graph shows: all of the force, and limits where they come near."""
    high = max(float(curve.force_n.max()), curve.setpoint_n) + LEAST_N
    low = min(-0.5, float(curve.force_n.min()) - 0.2)  # an unloaded sensor reads about zero
    return Frame(
        float(curve.at[0]),
        max(float(curve.at[-1]), float(curve.at[0]) + 1e-3),
        float(np.floor(2.0 * low)) / 2.0,
        float(np.ceil(high)),
    )


def force_data(curve: ForceCurve) -> tuple[Floats, ...]:
    """Return the columns: place or time, a background for each state, set point, limits, force."""
    ones, high = np.ones(len(curve.at)), graph_frame(curve).high_n
    states = np.array(curve.states)
    backs = [np.where(states == word, high, 0.0) for word in FILLS]  # filled down to zero
    beyond = high + 1.0  # limits that the graph does not reach are drawn above it
    limits = [ones * (beyond if v is None else v) for v in (curve.monitor_n, curve.stop_n)]
    return (curve.at, *backs, curve.setpoint_n * ones, *limits, curve.force_n)


def force_key(curve: ForceCurve) -> tuple[tuple[str, str], ...]:
    """Return colours and words of what is to be seen."""
    high_n = graph_frame(curve).high_n
    limits = ((curve.monitor_n, "soft limit"), (curve.stop_n, "hard limit"))
    words = ", ".join(f"{word} {at:.0f} N" for at, word in limits if at is not None and at < high_n)
    seen = [(css(CATEGORIES[0]), "force"), (css(GREEN), "set point")]
    seen += [(css(VERMILLION), words)] if words else []
    return tuple(seen + [(color, word) for word, color in FILLS.items() if word in curve.states])
