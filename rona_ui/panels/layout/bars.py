"""Bars of the page: the steps with their button, and the replay."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from rona_core.app.declarations.declarations import USABLE, Judgement
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import StepState, step_judgement
from rona_core.app.overview.acceptance import Judgement as FiguresJudgement
from rona_core.app.overview.acceptance import pending_figures
from rona_core.app.procedure import Stage, next_stage
from rona_core.app.steps.implant.view import layer_at
from rona_core.app.steps.roll.view import place_of_roll
from rona_core.app.steps.scan.messages import StartHome, StartRetract
from rona_core.app.steps.scan.planned_motion import motion_stale, motion_times
from rona_ui.labels import doing
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_change, on_click
from rona_ui.panels.widgets.step_panel import (
    GO_ON,
    JudgementNote,
    StepPanel,
    judged,
    rows_of,
)
from rona_ui.presentation.snapshot import (
    Snapshot,
    changed,
    probe_on_bone,
    replay_duration_s,
    robot_away,
    shows_roll_preview,
)
from rona_ui.presentation.view_state import ViewState
from rona_ui.viewer.bindings import escape

FOLLOWED = ("job", "steps", "view", "figures", "judged", "computing")  # by the run bar
STOP = (176, 0, 32)


class StepList:
    """A row per step; a see-through button lies over each, so that keyboard and mouse reach it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._rows: dict[str, Any] = {}
        self.buttons: dict[str, Any] = {}  # by name of the step
        for number, name in enumerate(REGISTRY.step_names, start=1):
            self._rows[name] = gui.add_html("")
            button = gui.add_button(f"Step {number}: {REGISTRY.lines[name].title}")
            self.buttons[name] = button
            opened = partial(context.set_view, step=name, drawing=None, picks=())
            on_click(button, lambda e, opened=opened: opened())

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw the rows that have changed."""
        if not changed(old, new, "steps", "figures", "judged", "computing", "view.step"):
            return
        waiting = judged_later(new)
        for state in new.steps:
            active, found = state.name == new.view.step, judged(new, state.name)
            html = row(state, active, found, waits=state.name in waiting)
            self._rows[state.name].content = html


def judged_later(snapshot: Snapshot) -> frozenset[str]:
    """Return the steps whose figures are being computed: it is not known yet if they pass."""
    if not snapshot.computing:
        return frozenset()
    pending = pending_figures(snapshot.session, snapshot.judged)
    rows = (row for row in rows_of(snapshot) if row.key in pending)
    return frozenset(row.step for row in rows if row.limit is not None)


def row(state: StepState, active: bool, found: FiguresJudgement, *, waits: bool = False) -> str:
    """Return one row of the list; a step whose figures fail, or are still awaited, is not done."""
    icon, word, color = style.STATES[state.state]
    reason = "" if state.reason == state.state else state.reason
    mark = ""
    if waits and state.state == "done":
        icon, word, color = style.JUDGING
    elif found.missed and state.state in ("done", "partial", "ready"):
        reason = "; ".join((*(row.sentence for row in found.missed), reason))
        if found.verdict == "fail" and state.state == "done":  # it is not, before that is mended
            icon, word, color = style.VERDICTS["fail"]
            word = f"{icon} {word}"
        else:
            mark = style.verdict(found.verdict) + "&ensp;"
    return (
        f'<div class="r-step{" on" if active else ""}" title="{escape(reason)}">'
        f'<span class="i" style="color:{color}">{icon}</span>'
        f'<span class="t">{state.number}&ensp;{escape(state.title)}'
        f'<span class="s">{escape(reason)}</span></span>'
        f'<span class="v">{mark}'
        f'<span class="r-badge" style="background:{color}">{word}</span></span></div>'
    )


class StepTitle:
    """Number and name of the active step; where it is blocked or stale, why and what mends it."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._html = gui.add_html("")
        self._note = JudgementNote(gui, context)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the active step and its state."""
        if not changed(old, new, "steps", "view.step", "busy", "figures", "judged"):
            return
        state = new.step(new.view.step)
        self._html.content = style.tag("div", f"Step {state.number}: {state.title}", "r-title")
        words = ""
        if state.state == "blocked":
            words = f"Blocked: {state.reason}."
        elif state.state == "stale":
            again = (state.blocked or "repeat this step").removesuffix(f": {state.reason}")
            again = style.sentence(again)
            words = f"Stale: {state.reason}. {again}."
        elif state.state == "partial" or (state.state == "ready" and state.reason != "ready"):
            words = f"{style.sentence(state.reason)}."
        named = not words and judged(new, new.view.step).remedy is not None  # beside its figures
        self._note.show(
            words,
            USABLE if named else _mended_elsewhere(new),
            busy=new.busy,
            kind="warn",
            first=state.blocked is not None,  # the primary button has to wait for it
        )


def _mended_elsewhere(snapshot: Snapshot) -> Judgement:
    """Return the judgement of the active step; the primary button is remedy enough of its own."""
    step = snapshot.view.step
    found = step_judgement(step, snapshot.session)
    message = None if found.remedy is None else found.remedy.message
    own = type(message) is REGISTRY.lines[step].message
    return replace(found, remedy=None) if own else found


class RunBar:
    """Primary button of the active step, progress, cancel; next opens a step, continue runs it."""

    def __init__(
        self,
        gui: Any,
        context: PanelContext,
        panels: Mapping[str, StepPanel],
        kinds: Mapping[str, type[StepPanel]],
    ) -> None:
        """Add the buttons; ``panels`` are those that are built, ``kinds`` those of all steps."""
        self._panels, self._kinds, self._context = panels, kinds, context
        self._step, self._rests = "setup", (False, False)
        self._stage: Stage | None = None  # the next one of the procedure
        # the step that is left, the one to be started once it is open, and the click on it
        self._to_start: tuple[str, str, Any] | None = None
        self._start = gui.add_button("Start", icon="player-play")
        self._progress_words = gui.add_html("")
        self._progress = gui.add_progress_bar(0.0, visible=False)
        self._cancel = gui.add_button("Cancel", icon="player-stop", color=STOP, visible=False)
        self._continue = gui.add_button("Continue", icon="player-track-next", color=GO_ON)
        self._offer = gui.add_html("")
        self._skip = gui.add_button("Skip", icon="player-skip-forward", color="gray")
        self._next = gui.add_button("Next step", icon="arrow-right", color=GO_ON)
        self._back = context.send_button(
            gui, "Retract probe", "arrow-back-up", StartRetract, visible=False
        )
        self._home = context.send_button(gui, "Robot home", "home", StartHome, visible=False)
        self.buttons = {
            "start": self._start,
            "cancel": self._cancel,
            "continue": self._continue,
            "next": self._next,
        }
        on_click(self._start, lambda e: context.send(panels[self._step].message, e))
        on_click(self._cancel, lambda e: context.service("cancel", e, None))
        on_click(self._continue, self._go_on)
        on_click(self._skip, lambda e: self._pass_over())
        on_click(self._next, lambda e: self._open_next())

    def _open_next(self) -> None:
        """Open the step behind the active one."""
        after = step_after(self._step)
        if after is not None:
            self._to_start = None
            self._context.set_view(step=after, drawing=None, picks=())

    def _go_on(self, event: Any) -> None:
        """Start the next stage: the primary one of a step with its fields, once it is open."""
        stage = self._stage
        if stage is None or not self._continue.visible:
            return  # it was hidden meanwhile: the click was meant for a stage that has ended
        if is_primary(stage):
            self._to_start = (self._step, stage.step, event)
        else:
            self._context.send(lambda: stage.message, event)
        self._context.set_view(step=stage.step, drawing=None, picks=())

    def _pass_over(self) -> None:
        """Pass over the stage that is offered, in this browser."""
        stage = self._stage
        if stage is not None:
            self._context.change_view(
                lambda view: replace(view, skipped=view.skipped | {stage.name})
            )

    def _start_opened(self, step: str) -> None:
        """Start the step that is open if it was opened for that; its fields are there by now."""
        if self._to_start is None:
            return
        left, wanted, event = self._to_start
        if step == left:  # a picture that was on its way already
            return
        self._to_start = None
        if step == wanted:
            self._context.send(self._panels[step].message, event)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow step, job, and whether the probe stands on the bone."""
        job, step = new.job, new.view.step
        self._progress_words.content = progress_words(new)
        # these follow live joints, not only steps
        rests, self._rests = self._rests, (probe_on_bone(new), robot_away(new))
        if rests == self._rests and not changed(old, new, *FOLLOWED):
            return
        self._start_opened(step)
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
        self._back.visible, self._home.visible = self._rests
        self._cancel.visible = self._progress.visible = busy
        if busy and job is not None:
            self._progress.value = round(100.0 * min(max(job.progress, 0.0), 1.0), 1)
        after = step_after(step)
        self._next.visible = (done or partial) and not busy and not drawing and after is not None
        stage = self._stage = next_stage(new.session, new.view.skipped)
        offers = stage is not None and not busy and not drawing and self._may_start(stage, new)
        self._continue.visible = offers
        self._skip.visible = offers and stage is not None and bool(stage.offered)
        failed = judged(new, step).verdict == "fail"  # its remedy comes first
        beside = partial or offers or failed or step in judged_later(new)
        self._next.color = "gray" if beside else GO_ON
        if after is not None:
            self._next.label = f"Next: {new.step(after).number} {new.step(after).title}"
        self._offer.content = ""
        if offers and stage is not None:
            words = self._kinds[stage.step].start if is_primary(stage) else stage.title
            self._continue.label = f"Continue: {words}"
            self._skip.label = f"Skip: {stage.title}"
            brings = f"It brings {stage.offered}. It may be skipped."
            self._offer.content = style.text(brings) if stage.offered else ""

    def _may_start(self, stage: Stage, new: Snapshot) -> bool:
        """Return whether a stage may start from the active step: nothing to look at before."""
        if self._step in judged_later(new):  # its figures may not pass
            return False
        if not stage.is_due(new.session):
            return False
        if stage.step == self._step:
            return not is_primary(stage)  # that has its own button
        failed = judged(new, self._step).verdict == "fail"
        return new.step(self._step).state == "done" and not failed and not stage.seen_first


def is_primary(stage: Stage) -> bool:
    """Return whether the primary button of a step does a stage."""
    return REGISTRY.lines[stage.step].message is type(stage.message)


def step_after(step: str) -> str | None:
    """Return the step behind this one; None behind the last."""
    after = REGISTRY.step_names.index(step) + 1
    return REGISTRY.step_names[after] if after < len(REGISTRY.step_names) else None


def progress_words(snapshot: Snapshot) -> str:
    """Return what is going on, how far it is, and how long it still takes; empty at rest."""
    job = snapshot.job
    if job is None or job.finished:
        return ""
    words = f"{doing(job.activity)}: {100 * job.progress:.0f} %"
    return style.text(words if snapshot.left_s is None else f"{words}, {left(snapshot.left_s)}")


def left(time_s: float) -> str:
    """Return a time that is left in words, as coarse as it is known."""
    if time_s < 8.0:
        return "a few seconds left"
    if time_s < 55.0:
        return f"about {10 * max(round(time_s / 10.0), 1)} s left"
    return f"about {max(round(time_s / 60.0), 1)} min left"


REPLAYED = ("roll", "scan", "maps", "implant")  # steps in which the replay is offered
SPEEDS = {"1×": 1.0, "4×": 4.0, "16×": 16.0, "64×": 64.0}


class ReplayPanel:
    """Slider, play, back, and a choice of speeds."""

    def __init__(self, gui: Any, context: PanelContext, window: Any) -> None:
        self._window = window
        self._words = gui.add_html("")
        self._slider = gui.add_slider("Motion (%)", 0.0, 100.0, 0.1, 0.0)
        self._buttons = gui.add_button_group("Replay", ("Play", "Pause", "Back", "Live"))
        self._speed = gui.add_button_group("Speed", tuple(SPEEDS))
        on_change(
            self._slider,
            lambda e: context.change_view(lambda v: v.replayed_at(e.target.value / 100.0)),
        )
        on_click(self._buttons, lambda e: context.change_view(self._change))
        on_click(self._speed, lambda e: context.set_view(speed=SPEEDS[self._speed.value]))

    def _change(self, view: ViewState) -> ViewState:
        wanted, cursor = self._buttons.value, view.replay_cursor
        if wanted == "Play":
            start = cursor if cursor is not None and cursor < 1.0 else 0.0
            return view.replayed_at(start, playing=True)
        if wanted == "Pause":
            return replace(view, playing=False)
        return view.replayed_at(0.0 if wanted == "Back" else None)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the cursor; without a planned motion there is nothing to replay."""
        if not changed(old, new, "session", "view", "busy", "steps"):
            return
        duration_s, cursor = replay_duration_s(new.session, new.view), new.view.replay_cursor
        offered = cursor is not None or new.view.step in REPLAYED
        self._window.visible = duration_s is not None and offered
        words = scan_words(new) if new.view.step != "implant" else milling_words(new, duration_s)
        self._words.content = style.text(words)
        self._slider.value = round(100.0 * (cursor or 0.0), 1)


def milling_words(snapshot: Snapshot, duration_s: float | None) -> str:
    """Return where the replay of the milling is; empty where there is none."""
    cursor = snapshot.view.milling_cursor
    if duration_s is None:
        return ""
    whole = clock(duration_s)
    layer = None if cursor is None else layer_at(snapshot.session, cursor)
    if cursor is None or layer is None:
        return f"The planned milling takes {whole} min."
    return (
        f"{clock(cursor * duration_s)} of {whole} min, layer {layer[0]} of {layer[1]}; "
        f"{snapshot.view.speed:.0f}× real time"
    )


def clock(time_s: float) -> str:
    """Return a time as minutes and seconds."""
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes}:{seconds:02d}"


def scan_words(snapshot: Snapshot) -> str:
    """Return where the replay of the scan is."""
    view, session = snapshot.view, snapshot.session
    times = motion_times(session, second=view.second)
    cursor, stale = view.cursor, motion_stale(session, second=view.second)
    if times is None:
        words = "The planned motion can be replayed after step 7."
    elif stale is not None:
        words = f"The planned motion is stale and not shown: {stale}."
    elif shows_roll_preview(snapshot):
        place = place_of_roll(session, view.shown_roll, view.place)
        words = (
            f"Shown: the selected roll at {100.0 * place:.0f} % of the path. Play runs "
            f"the planned motion ({times[0]:.1f} s)."
        )
    elif cursor is None:
        words = f"Live. The planned motion takes {times[0]:.1f} s."
    else:
        words = (
            f"{cursor * times[0]:.1f} of {times[0]:.1f} s, "
            f"{_phase(cursor * times[0], times)}; {view.speed:.0f}× real time"
        )
    return ("Tilted passes. " if view.second else "") + words


def _phase(time_s: float, times: tuple[float, float, float]) -> str:
    if time_s < times[1]:
        return "approach"
    return "scan" if time_s <= times[2] else "retract"
