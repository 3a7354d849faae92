"""Margin controls of step 7: quantity of the path colour, colour bar, nearest pair."""

from typing import Any

from rona_core.app.steps.roll.margins_view import PathMargins, Quantity, path_margins
from rona_core.app.steps.setup.clearance import PairClearance
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.colors import VERMILLION, css, viridis_css
from rona_ui.presentation.shown_path import MARGIN_SCALE_MAX
from rona_ui.presentation.shown_robot import shown_clearances
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

QUANTITIES: dict[str, Quantity] = {
    "Smallest margin": "room",
    "Joint limits": "limits",
    "Singularities": "singularity",
    "Collisions": "clearance",
}
UNITS: dict[Quantity, str] = {
    "room": "Margin to limits, singularities, jumps and reach (1 is comfortable)",
    "limits": "Distance from the nearest joint limit (°)",
    "singularity": "Margin to the nearest singularity (1 is comfortable)",
    "clearance": "Clearance of robot, tool and obstacles (mm)",
}
DECIMALS: dict[Quantity, int] = {"room": 1, "limits": 0, "singularity": 1, "clearance": 0}


class MarginControls:
    """Dropdown, colour bar, and the nearest pair."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._choice = gui.add_dropdown("Path colour", tuple(QUANTITIES), visible=False)
        self._bar = gui.add_html("")
        self._near = gui.add_html("")
        on_change(
            self._choice,
            lambda e: context.set_view(margin=QUANTITIES[self._choice.value]),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow search, shown roll, quantity and the robot as it is drawn."""
        has_view = new.session.results.roll is not None
        self._choice.visible = has_view
        if old is not None and changed(old, new, "session.id"):
            self._choice.value = next(w for w, q in QUANTITIES.items() if q == new.view.margin)
        view = ("view.shown_roll", "view.margin", "view.step")
        if changed(old, new, "session.results", "session.setup", *view):
            # in other steps nobody looks at it: it is not worth the time
            found = None
            if new.view.step in ("roll", "scan"):
                found = path_margins(new.session, new.view.shown_roll)
            self._bar.content = "" if found is None else bar(found, new.view.margin)
        self._near.content = near_words(shown_clearances(new)) if has_view else ""


def bar(found: PathMargins, quantity: Quantity) -> str:
    """Return the colour bar of a quantity, and the least value along the path."""
    top, decimals = MARGIN_SCALE_MAX[quantity], DECIMALS[quantity]
    values, fails = found.values(quantity), found.fails(quantity)
    more = "≥ " if float(values.max(initial=0.0)) > top else ""
    ticks = f"<span>0</span><span>{0.5 * top:.{decimals}f}</span>"
    least = float(values.min())
    words = f"Minimum along the path: {least:.{max(decimals, 1)}f}."
    if fails.any():
        part = 100.0 * float(fails.mean())
        words += f" Red on {max(part, 1.0):.0f} % of the path: not allowed."
    closest = PairClearance(*found.closest, found.closest_mm, found.needed_mm)
    if quantity == "clearance":
        share = 100.0 * found.closest_at / max(len(values) - 1, 1)
        words += f" Closest: {closest.sentence} (at {share:.0f} %)."
    return (
        f'<div class="r-text" style="padding-bottom:2px">{escape(UNITS[quantity])}</div>'
        '<div style="display:flex;margin:0 12px;gap:4px">'
        f'<div class="r-bar" style="margin:2px 0 1px;width:14px;background:{css(VERMILLION)}">'
        f'</div><div class="r-bar" style="margin:2px 0 1px;flex:1;background:{viridis_css()}">'
        f'</div></div><div class="r-ticks" style="margin-left:30px">{ticks}'
        f"<span>{more}{top:.{decimals}f}</span></div>{style.text(words)}"
    )


def near_words(pairs: tuple[PairClearance, ...]) -> str:
    """Return what comes too close with the robot as it is drawn, else the nearest pair."""
    hits = [pair for pair in pairs if pair.too_close]
    if hits:
        more = f" And {len(hits) - 1} more." if len(hits) > 1 else ""
        return style.note(f"Too close, red in the scene: {hits[0].sentence}.{more}", "warn")
    return style.text(f"Nearest now: {pairs[0].sentence}.") if pairs else ""
