"""The nine steps as a list: state by icon, word and colour, the reason beneath, a click opens."""

from dataclasses import replace
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.step_states import StepState
from rona_core.app.overview.acceptance import Judgement
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.panels.widgets.verdicts import judged
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.viewer.bindings import escape

NOTHING_JUDGED = Judgement("none", ())


class StepList:
    """A row per step; a see-through button lies over each, so that keyboard and mouse reach it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._rows: dict[str, Any] = {}
        for number, name in enumerate(REGISTRY.step_names, start=1):
            self._rows[name] = gui.add_html("")
            button = gui.add_button(f"Step {number}: {REGISTRY.lines[name].title}")
            self._listen(button, name, context)

    @staticmethod
    def _listen(button: Any, name: str, context: PanelContext) -> None:
        on_click(
            button,
            lambda e: context.change_view(lambda v: replace(v, step=name, drawing=None, picks=())),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the rows that have changed."""
        if (
            old is not None
            and old.steps is new.steps
            and old.figures is new.figures
            and old.view.step == new.view.step
        ):
            return
        for state in new.steps:
            content = row(state, state.name == new.view.step, judged(new, state.name))
            if self._rows[state.name].content != content:
                self._rows[state.name].content = content


def row(state: StepState, active: bool, found: Judgement = NOTHING_JUDGED) -> str:
    """Return one row of the list; figures that do not pass come before what the step made."""
    icon, word, color = style.STATES[state.state]
    reason = "" if state.reason == state.state else state.reason
    mark = ""
    if found.missed and state.state in ("done", "partial", "ready"):
        reason = "; ".join((*(row.sentence for row in found.missed), reason))
        mark = style.verdict(found.verdict) + "&ensp;"
    return (
        f'<div class="r-step{" on" if active else ""}" title="{escape(reason)}">'
        f'<span class="i" style="color:{color}">{icon}</span>'
        f'<span class="t">{state.number}&ensp;{escape(state.title)}'
        f'<span class="s">{escape(reason)}</span></span>'
        f'<span class="v">{mark}'
        f'<span class="r-badge" style="background:{color}">{word}</span></span></div>'
    )
