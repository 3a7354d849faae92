"""Milling by the robot: the buttons that plan and rehearse it, and the verdicts."""

from typing import Any

from rona_core.app.dependencies.judge import blocked
from rona_core.app.steps.implant.messages import PlanMilling, RehearseMilling
from rona_core.app.steps.implant.milling_motion import milling_stale
from rona_core.app.steps.implant.milling_plan import MillingPlan, milling_verdict
from rona_core.app.steps.implant.rehearsal import (
    Rehearsal,
    rehearsal_ok,
    rehearsal_stale,
    rehearsal_verdict,
)
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.presentation.snapshot import Snapshot, changed

EXPLANATION = "Whether the robot can mill this bed: roll about the burr, timing, collisions."
REHEARSAL = (
    "Mills the virtual patient's bone: force is felt, the floor scanned again, the depth corrected."
)


class MillingFolder:
    """The button that asks the robot, the one that tries it, and what they said."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._window = gui.add_folder("Milling by the robot", visible=False)
        with self._window:
            gui.add_html(style.text(EXPLANATION))
            self._planned = gui.add_html("")
            self._button = context.send_button(gui, "Plan milling", "route", PlanMilling)
            gui.add_html(style.text(REHEARSAL))
            self._rehearsed = gui.add_html("")
            self._rehearse = context.send_button(
                gui, "Rehearse milling", "player-play", RehearseMilling
            )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the bed and the plan; the buttons are there where there is something to mill."""
        self._window.visible = new.milling is not None
        if not changed(old, new, "session", "busy"):
            return
        for button, message in ((self._button, PlanMilling), (self._rehearse, RehearseMilling)):
            button.disabled = bool(new.busy) or blocked(message, new.session) is not None
        self._planned.content = _plan_note(new.session)
        self._rehearsed.content = _rehearsal_note(new.session)


def _plan_note(session: Session) -> str:
    held = session.results.get("milling")
    if held is None:
        return ""
    plan: MillingPlan = held.value
    return _note(milling_stale(session), "Plan", milling_verdict(plan), plan.may_move)


def _rehearsal_note(session: Session) -> str:
    held = session.results.get("rehearsal")
    if held is None:
        return ""
    found: Rehearsal = held.value
    return _note(
        rehearsal_stale(session), "Rehearse", rehearsal_verdict(found), rehearsal_ok(found)
    )


def _note(stale: str | None, remedy: str, verdict: str, good: bool) -> str:
    if stale is not None:
        return style.note(f"Out of date: {stale}. {remedy} again.", "warn")
    return style.note(verdict, "good" if good else "warn")
