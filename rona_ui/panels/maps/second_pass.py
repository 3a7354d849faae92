"""Further passes over the gaps: planned, scanned and mapped, and what came of them."""

from collections.abc import Callable
from typing import Any

from rona_core.app.steps.maps.further_passes import usable_second
from rona_core.app.steps.maps.messages import StartGapPlan, StartGapScan, StartMapping
from rona_core.app.steps.maps.view import SecondView, second_cells, second_view
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.panels.widgets.step_panel import stopped_note
from rona_ui.presentation.colors import SKY, css
from rona_ui.presentation.shown import shows_second_path, tilt_scale_max_deg
from rona_ui.presentation.snapshot import Snapshot, changed

SECOND_PASS = (
    "Where the inner table is inclined, its echo misses the probe. The robot scans these "
    "gaps again with the probe tilted. Passes add up: each is planned over the gaps that are left."
)


class SecondFolder:
    """Plan, scan and map the gaps, and what came of it."""

    def __init__(
        self, gui: Any, context: PanelContext, mapping: Callable[[], StartMapping]
    ) -> None:
        self._form = Form(gui)
        self._window = gui.add_folder("Second pass over the gaps", visible=False)
        with self._window:
            gui.add_html(style.text(SECOND_PASS))
            self._words = gui.add_html("")
            self._plan = gui.add_button("Plan second pass", icon="route")
            self._scan = gui.add_button("Scan gaps", icon="player-play")
            self._map = gui.add_button("Map with second pass", icon="map", visible=False)
            with gui.add_folder("Row spacing and tilt", expand_by_default=False):
                self._form.of(StartGapPlan, "spacing_mm", "fan", "largest_lean_deg")
        on_click(self._plan, lambda e: self._send(context, self.message, e))
        on_click(self._scan, lambda e: self._send(context, StartGapScan, e))
        on_click(self._map, lambda e: self._send(context, mapping, e, second=False))

    def message(self) -> StartGapPlan:
        """Return the planning with these parameters."""
        return StartGapPlan(**self._form.values())

    @staticmethod
    def _send(context: PanelContext, make: Any, event: Any, *, second: bool = True) -> None:
        context.send(make, event)
        context.set_view(second=second, cursor=None, playing=False)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow maps, plan and scan of the gaps."""
        if not changed(old, new, "session", "busy", "view.second"):
            return
        self._form.enable(not new.busy)
        self._window.visible = new.session.results.maps is not None
        view = second_view(new.session)
        ready = view is not None and view.blocked is None
        self._plan.disabled = new.busy
        self._scan.disabled = new.busy or not ready
        scanned = bool(usable_second(new.session))
        done = view is not None and view.scanned
        again = "Plan second pass again" if view is not None else "Plan second pass"
        self._plan.label = "Plan next pass" if scanned else again
        self._scan.label = "Scan gaps again" if done else "Scan gaps"
        self._plan.color = "gray" if ready else None
        self._scan.color = "gray" if done else None
        self._map.visible = scanned and second_cells(new.session) is None
        self._map.disabled = new.busy
        self._words.content = second_pass_words(new, view, scanned)


def second_pass_words(snapshot: Snapshot, view: SecondView | None, scanned: bool) -> str:
    """Return what is planned, what all passes scanned, and the coverage before and after."""
    session, html = snapshot.session, stopped_note(snapshot, "StartGapScan")
    if view is not None:
        text = (
            f"Gaps: {100 * view.gap_share:.0f} % of the map. Path of {view.length_mm:.0f} "
            f"mm, probe tilt up to {view.lean_deg.max(initial=0.0):.1f}°"
        )
        if view.blocked is not None:
            html += style.note(f"{text}. Cannot be scanned: {view.blocked}.", "warn")
        elif view.stale is not None and not view.scanned:
            html += style.note(f"{text}. Stale: {view.stale}. Plan again.", "warn")
        else:
            html += style.note(f"{text}, duration {view.duration_s or 0.0:.0f} s.")
        if shows_second_path(snapshot):
            most = f"{tilt_scale_max_deg(view):.0f}"
            html += style.color_bar("Lean of the probe (deg)", "0", most)
            html += style.key(((css(SKY), "second path"),))
    passes = session.captures.second
    if not passes:
        return html
    if not scanned:
        return html + style.note(
            "The gap scan belongs to another scan. Scan the gaps again.", "warn"
        )
    n_scans = sum(len(one.scans) for one in passes)
    cells = second_cells(session)
    if cells is None:
        return html + style.note(
            f"{n_scans} A-scans of the gaps recorded. Map the boundaries with them."
        )
    which = "the second pass" if len(passes) == 1 else f"{len(passes)} further passes"
    return html + style.note(
        f"Inner coverage {100 * cells.before:.0f} % before, {100 * cells.after:.0f} % with "
        f"{which} ({n_scans} A-scans). White dots: cells seen only by {which}.",
        "good",
    )
