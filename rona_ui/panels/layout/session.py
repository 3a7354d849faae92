"""Name and state of the session; undo, redo, save, open, new; question before work is lost."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from rona_core.app.runtime.saving.autosave import CopyState
from rona_core.app.runtime.saving.export_captures import recorded_captures
from rona_core.app.runtime.session_step import Redo, RenameSession, Undo
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import Event, escape

COLORS = {"save": None, "keep": "gray", "lose": (176, 0, 32)}  # None: that of the primary button
ICONS = {"save": "device-floppy", "keep": None, "lose": "trash"}


@dataclass(frozen=True, slots=True)
class Choice:
    """One answer, and what it does."""

    label: str
    act: Callable[[Event], None]
    kind: Literal["save", "keep", "lose"] = "keep"


class Question:
    """Modal dialog over the viewer; Cancel is always an answer."""

    def __init__(self, gui: Any) -> None:
        self._gui = gui
        self._modal: Any = None

    def ask(self, title: str, words: str, choices: tuple[Choice, ...]) -> None:
        """Show a question in place of the one before; any answer closes it."""
        self.cancel()
        self._modal = self._gui.add_modal(title)
        with self._modal:
            self._gui.add_html(style.text(words))
            for choice in (*choices, Choice("Cancel", lambda event: None)):
                self._add(choice)

    def _add(self, choice: Choice) -> None:
        button = self._gui.add_button(
            choice.label, icon=ICONS[choice.kind], color=COLORS[choice.kind]
        )

        def answer(event: Event) -> None:
            self.cancel()
            choice.act(event)

        on_click(button, answer)

    def cancel(self) -> bool:
        """Answer with Cancel; return whether a question was open."""
        modal, self._modal = self._modal, None
        if modal is not None:
            modal.close()
        return modal is not None


NOTHING = "choose …"


class SessionHead:
    """Session name, and a dot while something is not saved."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow name and save state."""
        self._html.content = head(new)


COPIES: dict[CopyState, str] = {
    "none": "",
    "kept": ", copy kept",
    "failed": ", no space for a copy",
}


def head(snapshot: Snapshot) -> str:
    """Return the head of the left dock; the name comes from outside and is escaped."""
    name, state = snapshot.session.name, "saved"
    if not snapshot.saved:
        kept = snapshot.recovered and snapshot.copy == "kept"  # that it is there has just been seen
        lacks = "recovered, not saved" if snapshot.recovered else "not saved"
        state = f"● {lacks}{'' if kept else COPIES[snapshot.copy]}"
    color = "#52606d" if snapshot.saved else "#a34700"
    return (
        f'<div class="r-head"><b title="{escape(name)}">{escape(name)}</b>'
        f'<span style="color:{color}">{state}</span></div>'
    )


class SessionPanel:
    """Controls of the session: undo, save, rename, open, close."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context = context
        self.question = Question(gui)
        self._snapshot: Snapshot | None = None
        self._buttons = gui.add_button_group("History", ("Undo", "Redo", "Save"))
        with gui.add_folder("Session", expand_by_default=False):
            self._name = gui.add_text("Name", "")
            self._rename = gui.add_button("Rename", icon="pencil", color="gray")
            hint = "Switch to another open session"
            self._opened = gui.add_dropdown("Open sessions", (NOTHING,), hint=hint)
            self._close = gui.add_button("Close session", icon="x", color="gray")
            self._file = gui.add_dropdown("File", (NOTHING,))
            self._open = gui.add_button("Open file", icon="folder-open", color="gray")
            self._new = gui.add_button("New session", icon="plus", color="gray")
            self._capture = gui.add_dropdown(
                "Recording", (NOTHING,), hint="Tracker recording of a capture"
            )
            self._download = gui.add_button("Download .igs.mha", icon="download", color="gray")
            hint = "One page to print and to keep: maps, figures, calibrations, certificate"
            self._report = gui.add_button("Report", icon="file-text", color="gray", hint=hint)
        serve = context.service
        history: dict[str, Callable[[Any], None]] = {
            "Undo": lambda e: context.send(Undo, e),
            "Redo": lambda e: context.send(Redo, e),
            "Save": lambda e: serve("save", e, None),
        }
        on_click(self._buttons, lambda e: history[self._buttons.value](e))
        on_click(self._rename, lambda e: context.send(lambda: RenameSession(self._name.value), e))
        on_click(self._open, self._open_file)
        on_click(self._download, self._download_capture)
        on_click(self._report, lambda e: serve("report", e, None))
        on_click(self._new, lambda e: self._leave("new", "start a new session", e))
        on_click(self._close, self._close_session)
        on_change(self._opened, self._show)
        _add_command(gui, "Undo", history["Undo"], "Z", "cmd/ctrl")
        _add_command(gui, "Redo", history["Redo"], "Z", "cmd/ctrl+shift")
        _add_command(gui, "Save", history["Save"], "S", "cmd/ctrl")
        _add_command(gui, "Stop the robot", lambda e: serve("stop", e, None))
        _add_command(gui, "Exit drawing", lambda e: serve("escape", e, None), "escape")

    def _open_file(self, event: Any) -> None:
        if self._file.value != NOTHING:
            self._leave(f"open:{self._file.value}", f"open {self._file.value}", event)

    def _show(self, event: Any) -> None:
        shown = self._snapshot
        labels = () if shown is None else labels_of(shown.opened)
        if shown is not None and self._opened.value in labels:
            key = shown.opened[labels.index(self._opened.value)][0]
            if key != shown.session.id:
                self._serve(f"show:{key}", event)

    def _leave(self, what: str, words: str, event: Any) -> None:
        """Do something that puts another session in sight; ask first where work is not saved."""
        shown = self._snapshot
        if shown is None or not shown.changes:
            self._serve(what, event)
            return
        key, name = shown.session.id, shown.session.name
        self.question.ask(
            f"Save “{name}” first?",
            f"“{name}” has unsaved changes. You are about to {words}. Without saving, "
            f"“{name}” stays open in the background: return to it with Session, Open "
            "sessions.",
            (
                Choice("Save first", lambda e: self._serve(f"save:{key}+{what}", e), "save"),
                Choice("Keep open, unsaved", lambda e: self._serve(what, e)),
            ),
        )

    def _close_session(self, event: Any) -> None:
        shown = self._snapshot
        if shown is None:
            return
        key, name = shown.session.id, shown.session.name
        if not (shown.changes or shown.busy):
            self._serve(f"close:{key}", event)
            return
        why = "has unsaved changes" if shown.changes else "has a running job"
        loses = "the changes are lost" if shown.changes else "the job is cancelled"
        save = Choice("Save and close", lambda e: self._serve(f"save:{key}+drop:{key}", e), "save")
        drop = Choice("Close without saving", lambda e: self._serve(f"drop:{key}", e), "lose")
        self.question.ask(
            f"Close “{name}”?", f"“{name}” {why}. If you close it now, {loses}.", (save, drop)
        )

    def _serve(self, what: str, event: Any) -> None:
        self._context.service(what, event, None)

    def _download_capture(self, event: Any) -> None:
        number = self._capture.value.partition(":")[0]
        if number.isdigit():
            self._context.service(f"download:{number}", event, None)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow name, open sessions, files and captures."""
        self._snapshot = new
        if changed(old, new, "opened", "session.id"):
            labels, ids = labels_of(new.opened), [key for key, _ in new.opened]
            self._opened.options = labels or (NOTHING,)
            if new.session.id in ids:
                self._opened.value = labels[ids.index(new.session.id)]
        if changed(old, new, "session.name"):
            self._name.value = new.session.name
        if changed(old, new, "files"):
            self._file.options = (NOTHING, *(path.name for path in new.files))
        if changed(old, new, "session.captures"):
            words = (w for _, w in recorded_captures(new.session))
            self._capture.options = (NOTHING, *words)


def _add_command(
    gui: Any,
    label: str,
    act: Callable[[Any], None],
    key: str | None = None,
    modifier: str | None = None,
) -> None:
    """Add a command of the palette, with its keys."""
    command = gui.add_command(label, hotkey=key, modifier=modifier)

    @command.on_trigger
    async def _(event: Any) -> None:
        act(event)


def labels_of(opened: tuple[tuple[str, str], ...]) -> tuple[str, ...]:
    """Return what the open sessions are called in the list: numbered, as names may be equal."""
    return tuple(f"{number}: {name}" for number, (_, name) in enumerate(opened, 1))
