"""Recordings of the pointer from files (steps 3 to 5)."""

from pathlib import PurePath
from typing import Any, Literal

from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext
from rona_ui.presentation.snapshot import Snapshot

Purpose = Literal["pivot", "surface", "path"]
SEQUENCES = ".mha"
PIVOTS = ".mha,.csv,.txt,.zip"
GEOMETRIES = ".csv,.txt,.rom"
WORDS: dict[Purpose, str] = {
    "pivot": (
        "A recording (.igs.mha), a table with a pose in each row (matrix, or position and "
        "quaternion), a zip with a 4 x 4 matrix in each file, or rows of frame,marker,x,y,z with "
        "the tool geometry. Poses of the marker in the tracker, in mm."
    ),
    "surface": "A recording of the pointer (.igs.mha) from PLUS, 3D Slicer or RONA.",
    "path": "A recording of the pointer (.igs.mha) from PLUS, 3D Slicer or RONA.",
}


class ImportControls:
    """A closed folder with the tool's name and a button that takes a file."""

    def __init__(self, gui: Any, context: PanelContext, purpose: Purpose) -> None:
        self._context = context
        self._purpose: Purpose = purpose
        self._geometry: str | None = None  # uploaded, for the next import
        self._folder = gui.add_folder("Import recording", expand_by_default=False)
        with self._folder:
            gui.add_html(style.text(WORDS[purpose]))
            self._tool = gui.add_text("Tool", "", hint="Needed if the recording has several tools")
            if purpose == "pivot":
                self._markers = gui.add_upload_button(
                    "Load tool geometry…", icon="upload", mime_type=GEOMETRIES, color="gray"
                )
                self._markers_words = gui.add_html("")
                self._markers.on_upload(self._take_markers)
            else:
                hint = "Plays the recording at the speed of a capture"
                self._play = gui.add_checkbox("Play back", False, hint=hint)
            if purpose == "surface":
                self._append = gui.add_checkbox("Append to strokes", True)
            kinds = PIVOTS if purpose == "pivot" else SEQUENCES
            self._upload = gui.add_upload_button(
                "Choose file…", icon="upload", mime_type=kinds, color="gray"
            )
            self._upload.on_upload(self._take)

    async def _take_markers(self, event: Any) -> None:
        self._geometry = self._store(event, self._markers.value)
        self._markers_words.content = style.note(
            f"Tool geometry {self._geometry}: used for the next import."
        )

    async def _take(self, event: Any) -> None:
        name = self._store(event, self._upload.value)
        tool, purpose = self._tool.value.strip() or None, self._purpose
        if purpose == "pivot":
            geometry, self._geometry = self._geometry, None
            self._markers_words.content = ""
            self._context.send(lambda: StartPivotImport((name,), geometry, tool), event)
            return
        play, append = bool(self._play.value), purpose == "surface" and bool(self._append.value)
        self._context.send(lambda: StartRecordingImport(name, purpose, tool, append, play), event)

    def _store(self, event: Any, uploaded: Any) -> str:
        name = PurePath(uploaded.name.replace("\\", "/")).name
        self._context.service(f"upload:{name}", event, uploaded.content)
        return name

    def render(self, new: Snapshot) -> None:
        """Rest while a job runs or the step is blocked."""
        step = "pointer" if self._purpose == "pivot" else self._purpose
        self._upload.disabled = new.busy or new.step(step).state == "blocked"
        self._folder.visible = new.view.drawing is None
