"""Name and state of the session; undo, redo, save, open, new."""

from collections.abc import Callable
from typing import Any

from rona_core.app.autosave import CopyState
from rona_core.app.exports import recorded_captures
from rona_core.app.messages import Redo, RenameSession, Undo
from rona_ui.bindings import Event, escape
from rona_ui.panels.door import Door, listen
from rona_ui.view_state import Picture

NOTHING = "choose …"


class SessionHead:
    """Session name, and a dot while something is not saved."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html("")

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow name and save state."""
        content = head(new.session.name, new.saved, new.copy)
        if old is None or content != head(old.session.name, old.saved, old.copy):
            self._html.content = content


COPIES: dict[CopyState, str] = {"none": "", "kept": ", copy kept", "failed": ", no room for a copy"}


def head(name: str, saved: bool, copy: CopyState) -> str:
    """Return the head of the left dock; the name comes from outside and is escaped."""
    state = "saved" if saved else f"● not saved{COPIES[copy]}"
    color = "#52606d" if saved else "#a34700"
    return (
        f'<div class="r-head"><b title="{escape(name)}">{escape(name)}</b>'
        f'<span style="color:{color}">{state}</span></div>'
    )


class SessionPanel:
    """What can be done with the session as a whole."""

    def __init__(self, gui: Any, door: Door) -> None:
        self._door = door
        self._buttons = gui.add_button_group("History", ("Undo", "Redo", "Save"))
        with gui.add_folder("Session", expand_by_default=False):
            self._name = gui.add_text("Name", "")
            self._rename = gui.add_button("Rename", icon="pencil", color="gray")
            self._file = gui.add_dropdown("File", (NOTHING,))
            self._open = gui.add_button("Open the file", icon="folder-open", color="gray")
            self._new = gui.add_button("New session", icon="plus", color="gray")
            self._capture = gui.add_dropdown("Recording", (NOTHING,), hint="What the tracker saw")
            self._download = gui.add_button("Download .igs.mha", icon="download", color="gray")
        listen(self._buttons, self._clicked)
        listen(self._rename, lambda e: door.send(lambda: RenameSession(self._name.value), e))
        listen(self._open, self._open_file)
        listen(self._download, self._download_capture)
        listen(self._new, lambda e: door.service("new", e, None))
        commands: tuple[tuple[str, str | None, str | None, Callable[[Event], None]], ...] = (
            ("Undo", "Z", "cmd/ctrl", lambda event: door.send(Undo, event)),
            ("Redo", "Z", "cmd/ctrl+shift", lambda event: door.send(Redo, event)),
            ("Save", "S", "cmd/ctrl", lambda event: door.service("save", event, None)),
            ("Stop the robot", None, None, lambda event: door.service("stop", event, None)),
            ("Leave drawing", "escape", None, lambda event: door.service("escape", event, None)),
        )
        for label, key, modifier, act in commands:
            self._command(gui, label, key, modifier, act)

    @staticmethod
    def _command(gui: Any, label: str, key: str | None, modifier: str | None, act: Any) -> None:
        command = gui.add_command(label, hotkey=key, modifier=modifier)

        @command.on_trigger
        async def _(event: Any) -> None:
            act(event)

    def _clicked(self, event: Any) -> None:
        wanted = self._buttons.value
        if wanted == "Save":
            self._door.service("save", event, None)
        else:
            self._door.send(Undo if wanted == "Undo" else Redo, event)

    def _open_file(self, event: Any) -> None:
        if self._file.value != NOTHING:
            self._door.service(f"open:{self._file.value}", event, None)

    def _download_capture(self, event: Any) -> None:
        number = self._capture.value.partition(":")[0]
        if number.isdigit():
            self._door.service(f"download:{number}", event, None)

    def render(self, old: Picture | None, new: Picture) -> None:
        """Follow name, files and captures."""
        if old is None or old.session.name != new.session.name:
            self._name.value = new.session.name
        if old is None or old.files != new.files:
            self._file.options = (NOTHING, *(path.name for path in new.files))
        if old is None or old.session.captures is not new.session.captures:
            words = (w for _, w in recorded_captures(new.session))
            self._capture.options = (NOTHING, *words)
