"""Take what was recorded elsewhere as the capture of a step: what steps 3, 4 and 5 share."""

from pathlib import PurePath
from typing import Any, Literal

from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import Door
from rona_ui.view_state import Picture

Purpose = Literal["pivot", "surface", "path"]
SEQUENCES = ".mha"
PIVOTS = ".mha,.csv,.txt,.zip"
GEOMETRIES = ".csv,.txt,.rom"
WORDS: dict[Purpose, str] = {
    "pivot": "A recording (.igs.mha), 4 x 4 matrices as text (sixteen numbers a row, or a zip of "
    "one file each), or frame,marker,x,y,z with the markers of the tool, in mm.",
    "surface": "A recording of the pointer (.igs.mha), of PLUS, 3D Slicer or this program.",
    "path": "A recording of the pointer (.igs.mha), of PLUS, 3D Slicer or this program.",
}


class ImportControls:
    """A closed folder with the tool's name and a button that takes a file."""

    def __init__(self, gui: Any, door: Door, purpose: Purpose) -> None:
        self._door, self._purpose = door, purpose
        self._geometry: str | None = None  # uploaded, for the next import
        self._folder = gui.add_folder("Import a recording", expand_by_default=False)
        with self._folder:
            gui.add_html(style.text(WORDS[purpose]))
            self._tool = gui.add_text("Tool", "", hint="Where the recording has several")
            if purpose == "pivot":
                self._markers = gui.add_upload_button(
                    "Markers of the tool", icon="upload", mime_type=GEOMETRIES, color="gray"
                )
                self._markers_words = gui.add_html("")
                self._markers.on_upload(self._take_markers)
            else:
                hint = "Show it at the pace of captures"
                self._play = gui.add_checkbox("Play it", False, hint=hint)
            if purpose == "surface":
                self._append = gui.add_checkbox("Add to the strokes", True)
            kinds = PIVOTS if purpose == "pivot" else SEQUENCES
            self._upload = gui.add_upload_button(
                "Import recording…", icon="upload", mime_type=kinds, color="gray"
            )
            self._upload.on_upload(self._take)

    async def _take_markers(self, event: Any) -> None:
        self._geometry = self._store(event, self._markers.value)
        self._markers_words.content = style.note(f"Markers of {self._geometry}: for the next one.")

    async def _take(self, event: Any) -> None:
        name = self._store(event, self._upload.value)
        tool = self._tool.value.strip() or None
        if self._purpose == "pivot":
            geometry, self._geometry = self._geometry, None
            self._markers_words.content = ""
            self._door.send(lambda: StartPivotImport((name,), geometry, tool), event)
        elif self._purpose == "surface":
            append, play = bool(self._append.value), bool(self._play.value)
            self._door.send(
                lambda: StartRecordingImport(name, "surface", tool, append, play), event
            )
        else:
            play = bool(self._play.value)
            self._door.send(lambda: StartRecordingImport(name, "path", tool, play=play), event)

    def _store(self, event: Any, uploaded: Any) -> str:
        name = PurePath(uploaded.name.replace("\\", "/")).name
        self._door.service(f"upload:{name}", event, uploaded.content)
        return name

    def render(self, new: Picture) -> None:
        """Rest while a job runs or the step is blocked."""
        step = "pointer" if self._purpose == "pivot" else self._purpose
        self._upload.disabled = new.busy or new.step(step).state == "blocked"
        self._folder.visible = new.view.drawing is None
