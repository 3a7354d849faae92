"""Base class of the step panels, their folders of files, and notes of judgements and figures."""

from dataclasses import dataclass
from pathlib import PurePath
from typing import Any, ClassVar, Literal

from rona_core.app.declarations.declarations import Judgement as InputJudgement
from rona_core.app.declarations.declarations import Message, Remedy
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import imported_parts
from rona_core.app.overview.acceptance import (
    Judgement,
    QualityRow,
    judgement,
    pending_figures,
    quality_rows,
)
from rona_core.app.steps.imports.messages import StartImport
from rona_core.errors import InvalidInputError
from rona_core.session.memo import Memo
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_click
from rona_ui.presentation.snapshot import Snapshot, changed

GO_ON = (0, 105, 77)  # what to do now
MAX_LISTED = 3  # figures in a note
FOLLOWED = ("session", "view", "busy", "figures", "judged", "static_scene")  # by the remarks


# every panel of every browser asks for the same ones
_ROWS: Memo[tuple[QualityRow, ...]] = Memo(1)


def rows_of(snapshot: Snapshot) -> tuple[QualityRow, ...]:
    """Return the figures of a picture with their verdicts; one that is pending has no value."""
    figures, session, judged = snapshot.figures, snapshot.session, snapshot.judged

    def make() -> tuple[QualityRow, ...]:
        pending = pending_figures(session, judged)
        known = {key: value for key, value in figures.items() if key not in pending}
        return quality_rows(known, session)

    return _ROWS.get((figures, session, judged), make)


def judged(snapshot: Snapshot, step: str) -> Judgement:
    """Return the verdict of the figures of a step."""
    return judgement(rows_of(snapshot), step)


def missed_note(found: Judgement) -> str:
    """Return the figures that do not pass as a note, the worst first; empty where all do."""
    if not found.missed:
        return ""
    icon, word, _ = style.VERDICTS[found.verdict]
    lines = [row.sentence for row in found.missed[:MAX_LISTED]]
    more = len(found.missed) - MAX_LISTED
    lines += [f"and {more} more, see Quality"] if more > 0 else []
    remedy = found.remedy
    if remedy is not None and remedy.message is None:
        lines.append(f"What helps: {remedy.words}")
    return style.note(f"{icon} {word}. {'. '.join(lines)}.", "warn")


class JudgementNote:
    """A judgement in words, and the button that sends the message of its remedy."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self.html = gui.add_html("")
        self._message: Message | None = None
        self._button = context.send_button(
            gui, "Remedy", "tool", lambda: self._message, visible=False
        )

    def show(
        self,
        words: str,
        found: InputJudgement,
        *,
        busy: bool,
        kind: str | None = None,
        first: bool = False,
    ) -> None:
        """Show ``words`` about something, and offer what mends it; no button while it is missing.

        What is missing has a button of its own beside the note. ``kind`` is that of the note, where
        the state does not say it; ``first`` is as for ``offer``.
        """
        html = style.note(words, style.BOXES[found.state] if kind is None else kind)
        remedy = None if found.state == "missing" else found.remedy
        self.offer(html, remedy, busy=busy, first=first)

    def offer(self, html: str, remedy: Remedy | None, *, busy: bool, first: bool = False) -> None:
        """Show HTML, and a button that does what mends it, where a message does.

        Args:
            html: Escaped.
            remedy: What mends it.
            busy: Whether something runs, so that it has to wait.
            first: Whether it is what to do now.
        """
        self.html.content = html
        self._message = None if remedy is None else remedy.message
        self._button.visible = self._message is not None
        self._button.disabled = busy
        self._button.color = GO_ON if first else "gray"
        words = "" if remedy is None or remedy.message is None else remedy.words
        self._button.label = style.sentence(words) or "Remedy"


class StepPanel:
    """Fields of one step; subclasses say what they are and what the primary button sends."""

    step: ClassVar[str] = ""
    explanation: ClassVar[str] = ""
    activity: ClassVar[str] = ""  # that the primary button starts, where it records something
    start: ClassVar[str | None] = None  # words of the primary button; None: the step has none

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self.gui, self.context = gui, context
        self.form = Form(gui)
        self.folder = gui.add_folder(None, visible=False)
        with self.folder:
            self._explained = gui.add_html("")
            # what came of the step is above its fields: seen without scrolling
            self.verdict = JudgementNote(gui, context)
            self.remark = gui.add_html("")
            self.build_result()
            self.build()

    def build_result(self) -> None:
        """Add what shows the result beside the remarks: legends, and what chooses what is shown."""

    def build(self) -> None:
        """Add the fields."""

    def message(self) -> Any:
        """Return what the primary button sends."""
        raise InvalidInputError(f"step {self.step} starts nothing: change its fields")

    def remarks(self, snapshot: Snapshot) -> str:
        """Return HTML about the result of the step."""
        return ""

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Draw what else has changed."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Show the fields while the step is active, and follow the session."""
        active = new.view.step == self.step
        self.folder.visible = active
        if old is None or old.busy != new.busy:
            self.form.enable(not new.busy)
        self.update(old, new)
        if active and changed(old, new, *FOLLOWED):
            stopped, html = stopped_note(new, self.activity), self.remarks(new)
            stale = new.step(self.step).state == "stale"
            figures = judged(new, self.step)
            missed = "" if stale else missed_note(figures)
            remedy, failed = figures.remedy if missed else None, figures.verdict == "fail"
            self.verdict.offer(missed + stopped, remedy, busy=new.busy, first=failed)
            # what is not good is not praised
            html = html.replace("r-note good", "r-note") if stale or missed else html
            self.remark.content = imported_note(new, self.step) + html
            shown = html and self.start is not None  # the result takes the place of the explanation
            self._explained.content = "" if shown else style.text(self.explanation)


def imported_note(snapshot: Snapshot, step: str) -> str:
    """Return which captures of a step came out of which files, as HTML; empty where none did."""
    files: dict[str, list[str]] = {}
    for noun, file in imported_parts(step, snapshot.session):
        files.setdefault(file, []).append(noun)
    said = "; ".join(f"{', '.join(nouns)}, from {file}" for file, nouns in files.items())
    return style.note(f"Imported: {said}." if said else "")


def stopped_note(snapshot: Snapshot, activity: str) -> str:
    """Return what became of an activity that was stopped, as HTML; empty where none was."""
    job = snapshot.job
    if not activity or job is None or job.activity != activity or job.state != "cancelled":
        return ""
    if job.error:
        return style.note(f"Stopped: {job.error}.", "warn")
    session = snapshot.session
    last = session.archive[-1] if session.archive else None
    captures = [session.captures.get(name) for name in REGISTRY.captures]
    if last is None or any(last is c or (isinstance(c, tuple) and last in c) for c in captures):
        return ""
    return style.note(
        "Stopped early: the previous recording and its results are unchanged. The partial "
        "recording is kept in the session archive.",
        "warn",
    )


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
