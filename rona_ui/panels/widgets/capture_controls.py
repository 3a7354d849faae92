"""Controls of a capture without its device: drawn by mouse, or read from files."""

from collections.abc import Callable
from typing import Any, Literal

from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_click
from rona_ui.panels.widgets.step_panel import store_upload
from rona_ui.presentation.mouse_input import (
    LIFTED,
    lifted,
    may_lift,
    n_strokes,
    starts,
    without_last_pick,
)
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import Drawing, Point, ViewState

Picks = tuple[Point, ...]
Lifts = tuple[int, ...]


class DrawingControls:
    """Buttons to draw, lift the pointer, finish or discard."""

    def __init__(
        self,
        gui: Any,
        context: PanelContext,
        kind: Drawing,
        message: Callable[[Picks, Lifts], Any],
    ) -> None:
        self._kind, self._context, self._message = kind, context, message
        self._view = ViewState()
        self._last: str | None = None  # id of the newest job
        self._sent: tuple[str | None, Picks] | None = None  # the job before, and picks
        self._begin = context.view_button(gui, "Draw on the skull", "pencil", drawing=kind)
        self._help = gui.add_html("")
        self._finish = gui.add_button("Finish stroke", icon="check", visible=False)
        on_click(self._finish, self._send)
        self._lift = gui.add_button("Lift pointer", icon="arrow-up", color="gray", visible=False)
        on_click(self._lift, lambda e: context.change_view(lifted))
        self._shorter = gui.add_button(
            "Undo last point", icon="arrow-back-up", color="gray", visible=False
        )
        on_click(self._shorter, lambda e: context.change_view(without_last_pick))
        self._drop = context.view_button(gui, "Discard stroke", "x", drawing=None, picks=())

    def _send(self, event: Any) -> None:
        picks, lifts = self._view.picks, starts(self._view)[1:]
        self._sent = self._last, picks
        self._context.send(lambda: self._message(picks, lifts), event)
        self._context.set_view(drawing=None)

    def _recorded(self, new: Snapshot) -> bool:
        """Return whether the pointer has followed what was sent; until then it is kept."""
        job, sent = new.job, self._sent
        if sent is None or job is None or not job.finished or job.id == sent[0]:
            return False
        self._sent = None
        return job.state == "done" and new.view.picks == sent[1]

    def render(self, new: Snapshot, words: str = "") -> None:
        """Show what can be done now; ``words`` about what is drawn so far."""
        drawing = new.view.drawing == self._kind
        if self._recorded(new):
            self._context.set_view(picks=())
        self._last = None if new.job is None else new.job.id
        view = self._view = new.view
        blocked = new.busy or new.step(self._kind).state == "blocked"
        self._begin.visible = not drawing
        self._begin.label = "Continue drawing" if view.picks else "Draw on the skull"
        self._begin.disabled = blocked
        self._finish.visible = drawing
        self._finish.label = "Finish strokes" if n_strokes(view) > 1 else "Finish stroke"
        self._lift.visible = may_lift(view)
        self._shorter.visible = drawing and len(view.picks) > 0
        self._drop.visible = (drawing or len(view.picks) > 0) and not new.busy
        self._finish.disabled = blocked or len(view.picks) < 2
        self._help.content = style.note(f"{_help_words(view)} {words}".rstrip()) if drawing else ""


def _help_words(view: ViewState) -> str:
    """Return what a click and a drag do, and what there is so far."""
    points = f"{len(view.picks)} point{'' if len(view.picks) == 1 else 's'}"
    if view.drawing != LIFTED:
        return (
            "Click points on the skull, or drag over it. Dragging beside the skull "
            f"rotates the view. {points} so far."
        )
    return (
        "Drag over the skull: each drag is a stroke. Clicks go on with the last one until the "
        f"pointer is lifted. Dragging beside the skull rotates the view. {points} in "
        f"{n_strokes(view)} stroke{'' if n_strokes(view) == 1 else 's'} so far."
    )


Purpose = Literal["pivot", "surface", "path"]
POSES = ".mha,.mhd,.nrrd,.csv,.tsv,.txt,.zip,.npy,.npz,.mat,.json,.bag,.mcap,.db3"
GEOMETRIES = ".csv,.txt,.rom"
STROKES = (
    "A recording of the pointer with times: a sequence file (.igs.mha), a table with a pose in "
    "each row, or a ROS bag. Poses of the marker in the tracker, in mm."
)
WORDS: dict[Purpose, str] = {
    "pivot": (
        "A recording (.igs.mha), a table with a pose in each row (matrix, or position and "
        "quaternion), a zip with a 4 x 4 matrix in each file, or rows of frame,marker,x,y,z with "
        "the tool geometry. Poses of the marker in the tracker, in mm."
    ),
    "surface": STROKES,
    "path": STROKES,
}


class ImportControls:
    """A closed folder with a button that takes a file, and with what the file may leave open."""

    def __init__(self, gui: Any, context: PanelContext, purpose: Purpose) -> None:
        self._context = context
        self._purpose: Purpose = purpose
        self._geometry: str | None = None  # uploaded, for the next import
        self._folder = gui.add_folder("Import recording", expand_by_default=False)
        self._layout = Form(gui)
        with self._folder:
            gui.add_html(style.text(WORDS[purpose]))
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
            with gui.add_folder("What the file leaves open", expand_by_default=False):
                self._layout.of(StartPivotImport if purpose == "pivot" else StartRecordingImport)
            self._upload = gui.add_upload_button(
                "Choose file…", icon="upload", mime_type=POSES, color="gray"
            )
            self._upload.on_upload(self._take)

    async def _take_markers(self, event: Any) -> None:
        self._geometry = store_upload(self._context, event, self._markers.value)
        self._markers_words.content = style.note(
            f"Tool geometry {self._geometry}: used for the next import."
        )

    async def _take(self, event: Any) -> None:
        name, purpose = store_upload(self._context, event, self._upload.value), self._purpose
        layout = self._layout.values()
        if purpose == "pivot":
            geometry, self._geometry = self._geometry, None
            self._markers_words.content = ""
            self._context.send(lambda: StartPivotImport((name,), geometry, **layout), event)
            return
        layout |= {"append": purpose == "surface" and self._append.value, "play": self._play.value}
        self._context.send(lambda: StartRecordingImport(name, purpose, **layout), event)

    def render(self, new: Snapshot) -> None:
        """Rest while a job runs or the step is blocked."""
        step = "pointer" if self._purpose == "pivot" else self._purpose
        self._upload.disabled = new.busy or new.step(step).state == "blocked"
        self._layout.enable(not new.busy)
        self._folder.visible = new.view.drawing is None
