"""Title of the active step, its primary button, progress, cancel and next."""

from dataclasses import replace
from operator import is_
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.scan.messages import StartRetract
from rona_ui.labels import doing
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_click
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.shown_robot import probe_on_bone
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.viewer.bindings import escape

GO_ON = (0, 105, 77)


class StepTitle:
    """Number and name of the active step; a warning where it is blocked or stale."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the active step and its state."""
        if old is not None and old.steps is new.steps and old.view.step == new.view.step:
            return
        state = new.step(new.view.step)
        html = style.tag("div", f"Step {state.number}: {state.title}", "r-title")
        if state.state == "blocked":
            html += style.note(f"Blocked: {state.reason}.", "warn")
        elif state.state == "stale":
            again = "Repeat this step"
            if state.blocked is not None:
                again = state.blocked[:1].upper() + state.blocked[1:]
            html += style.note(f"Stale: {state.reason}. {again}.", "warn")
        elif state.state == "partial" or (state.state == "ready" and state.reason != "ready"):
            html += style.note(f"{state.reason[:1].upper()}{state.reason[1:]}.", "warn")
        self._html.content = html


class RunBar:
    """Primary button of the active step, progress, cancel and next."""

    def __init__(self, gui: Any, context: PanelContext, panels: dict[str, StepPanel]) -> None:
        self._panels, self._context = panels, context
        self._step, self._rests = "setup", False
        self._start = gui.add_button("Start", icon="player-play")
        self._progress_words = gui.add_html("")
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button(
            "Cancel", icon="player-stop", color=(176, 0, 32), visible=False
        )
        self._next = gui.add_button("Next step", icon="arrow-right", color=GO_ON)
        self._back = gui.add_button(
            "Retract probe", icon="arrow-back-up", color="gray", visible=False
        )
        on_click(self._start, self._run)
        on_click(self._back, lambda e: context.send(StartRetract, e))
        on_click(self._cancel, lambda e: context.service("cancel", e, None))
        on_click(self._next, self._go_on)

    def _run(self, event: Any) -> None:
        self._context.send(self._panels[self._step].message, event)

    def _go_on(self, event: Any) -> None:
        after = REGISTRY.step_names[
            min(REGISTRY.step_names.index(self._step) + 1, len(REGISTRY.step_names) - 1)
        ]
        self._context.change_view(lambda v: replace(v, step=after, drawing=None, picks=()))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow step, job, and whether the probe stands on the bone."""
        job, step = new.job, new.view.step
        rests, self._rests = self._rests, probe_on_bone(new)  # follows live joints, not only steps
        known = (job, new.steps, new.view)
        same = old is not None and all(map(is_, (old.job, old.steps, old.view), known))
        if same and rests is self._rests:
            return
        panel, state = self._panels[step], new.step(step)
        self._step, busy = step, new.busy
        drawing = new.view.drawing is not None
        done, partial = state.state == "done", state.state == "partial"
        self._start.visible = panel.start is not None and not busy and not drawing
        label = panel.start or "Start"
        self._start.label = f"{label} again" if done or partial else label
        self._start.icon = "refresh" if done or partial else "player-play"
        self._start.color = "gray" if done else None
        self._start.disabled = state.blocked is not None
        self._back.visible = not busy and self._rests
        self._cancel.visible = self._progress.visible = busy
        words = ""
        if busy and job is not None:
            self._progress.value = round(100.0 * min(max(job.progress, 0.0), 1.0), 1)
            words = f"{escape(doing(job.activity))}: {100 * job.progress:.0f} %"
        html = f'<div class="r-text">{words}</div>' if words else ""
        if self._progress_words.content != html:
            self._progress_words.content = html
        last = step == REGISTRY.step_names[-1]
        self._next.visible = (done or partial) and not busy and not last and not drawing
        self._next.color = "gray" if partial else GO_ON
        if not last:
            after = new.step(REGISTRY.step_names[REGISTRY.step_names.index(step) + 1])
            self._next.label = f"Next: {after.number} {after.title}"
