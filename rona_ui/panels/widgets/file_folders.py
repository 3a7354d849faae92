"""Closed folders that take a file as the capture of a step, and that download files."""

from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, Literal

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.imports.messages import StartImport
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot

Purpose = Literal["captures", "cloud", "path", "motion"]


@dataclass(frozen=True, slots=True)
class Load:
    """What a folder says that takes files of a purpose."""

    title: str
    kinds: str  # endings, as a browser takes them
    words: str
    needed: str | None = None  # the step whose result it is held against


LOADS: dict[Purpose, Load] = {
    "cloud": Load(
        "Load a point cloud",
        ".ply,.csv,.tsv,.txt,.xyz",
        "Points of the outer surface in the robot's base frame, in mm (.ply, .csv). They become "
        "the surface of this step.",
    ),
    "path": Load(
        "Load a path",
        ".csv,.tsv,.txt,.xyz,.json,.ply",
        "Points in the robot's base frame, in mm and in their order (.csv, .mrk.json). They become "
        "the scan path.",
    ),
    "motion": Load(
        "Load a motion",
        ".csv,.tsv,.txt,.json,.yaml,.yml,.script,.urscript,.mcap,.db3,.bag",
        "A joint motion of this robot over the smoothed path (table, JointTrajectory, URScript, "
        "bag) becomes the plan. The verifier certifies it, or refuses it with the reason.",
        "smoothing",
    ),
    "captures": Load(
        "Load captures",
        ".h5,.hdf5",
        "Recordings as RONA exports them, or tracked A-scans in groups of the same names (HDF5). "
        "Each becomes the capture of its step.",
    ),
}
ALL = "All in the file"


def store_upload(context: PanelContext, event: Any, uploaded: Any) -> str:
    """Store a file that a browser has sent, and return its plain name."""
    name = PurePath(uploaded.name.replace("\\", "/")).name
    context.service(f"upload:{name}", event, uploaded.content)
    return name


class LoadFolder:
    """A button that takes a file as the captures that its purpose says."""

    def __init__(self, gui: Any, context: PanelContext, purpose: Purpose) -> None:
        self._context = context
        self._purpose: Purpose = purpose
        self._load = load = LOADS[purpose]
        self._group: Any = None
        self._folder = gui.add_folder(load.title, expand_by_default=False)
        with self._folder:
            gui.add_html(style.text(load.words))
            if purpose == "captures":
                self._group = gui.add_dropdown(
                    "Group", (ALL, *REGISTRY.captures), hint="Of the file; the others are left"
                )
            self._button = gui.add_upload_button(
                "Choose file…", icon="upload", mime_type=load.kinds, color="gray"
            )
            self._button.on_upload(self._take)

    async def _take(self, event: Any) -> None:
        name = store_upload(self._context, event, self._button.value)
        group = ALL if self._group is None else self._group.value
        only = () if group == ALL else (group,)
        self._context.send(lambda: StartImport(name, self._purpose, only), event)

    def render(self, new: Snapshot) -> None:
        """Rest while a job runs, or before what the file is held against is there."""
        needed = self._load.needed
        missing = needed is not None and new.session.results.get(needed) is None
        self._button.disabled = new.busy or missing
        self._folder.visible = new.view.drawing is None


class ExportFolder:
    """Choice of a file, and the button that downloads it."""

    def __init__(
        self,
        gui: Any,
        context: PanelContext,
        names: tuple[str, ...],
        *,
        words: str,
        button: str,
        title: str = "Export",
    ) -> None:
        """Add the folder, hidden until there is something to export.

        Args:
            gui: Where it is added.
            context: Through which the file is asked for.
            names: Of the files.
            words: What they hold.
            button: Label of the button.
            title: Of the folder.
        """
        self._window = gui.add_folder(title, visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(words))
            self._file = file = gui.add_dropdown("File", names)
            self._reason = gui.add_html("")
            self._button = gui.add_button(button, icon="download", color="gray")
        on_click(self._button, lambda e: context.service(f"export:{file.value}", e, None))

    def show(
        self, *, there: bool, names: tuple[str, ...] | None = None, reason: str | None = None
    ) -> None:
        """Offer the files where something is there; with a reason why not, none is downloaded."""
        self._window.visible = there
        if names is not None and tuple(self._file.options) != names:
            self._file.options = names
        self._button.disabled = reason is not None
        self._reason.content = (
            "" if reason is None else style.note(f"Not exported: {reason}.", "warn")
        )
