"""Step 10: the bed of an implant is searched or laid by hand; verdict, figures, milling path."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.dependencies.judge import blocked, fresh, judge_part
from rona_core.app.overview.bed_figures import (
    LIFT_HEAD,
    SCREW_HEAD,
    bed_rows,
    lift_rows,
    milling_rows,
    screw_rows,
)
from rona_core.app.overview.bed_risk import bed_risk
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.burr.step import UNKNOWN, burr_words
from rona_core.app.steps.implant.derivation import BedLines, ImplantBed, lines_verdict
from rona_core.app.steps.implant.export import EXPORTS, MOTIONS, offered
from rona_core.app.steps.implant.messages import (
    PlaceBed,
    PlanMilling,
    RehearseMilling,
    StartBedLines,
    StartBedSearch,
)
from rona_core.app.steps.implant.milling import MillingView
from rona_core.app.steps.implant.milling_plan import MillingPlan, milling_verdict
from rona_core.app.steps.implant.rehearsal import (
    Rehearsal,
    rehearsal_ok,
    rehearsal_stale,
    rehearsal_verdict,
)
from rona_core.app.steps.implant.view import milling_stale, placed_turns, verdict
from rona_core.app.steps.maps.messages import StartTiltPlan
from rona_core.app.steps.maps.view import layers_of
from rona_core.session.document import Session
from rona_ui.panels.maps.maps import color_bar
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_change, on_click
from rona_ui.panels.widgets.step_panel import ExportFolder, JudgementNote, StepPanel
from rona_ui.presentation.colors import (
    BONE_RIM,
    MILLING_COLORS,
    PURPLE,
    STEEL,
    VERMILLION,
    css,
)
from rona_ui.presentation.snapshot import (
    Snapshot,
    changed,
    map_errors,
    map_sigma,
    opens_window,
    shown_maps,
)


class BurrFields:
    """The button that registers the burr, and one line about its tip."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._register = context.send_button(gui, "Register burr", "target", StartBurrCapture)
        self._found = JudgementNote(gui, context)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the registration."""
        if not changed(old, new, "session", "busy"):
            return
        hindrance = blocked(StartBurrCapture, new.session)
        self._register.disabled = bool(new.busy) or hindrance is not None
        words = "" if hindrance is not None else burr_words(new.session) or UNKNOWN
        self._found.show(words, judge_part("burr", new.session), busy=bool(new.busy))


BY_HAND_EXPLANATION = "Moves, turns and tilts the bed. The verdict follows when a slider rests."
HELP = "Click the skull, or drag on it: the bed follows, and its verdict. Drag beside it to rotate."
ASKED = ("implant", "limit_mm", "probability", "burr_mm")  # of the fields above


class ByHandFolder:
    """Sliders of a placement, filled by the last one; ``asked`` holds the fields of the step."""

    def __init__(self, gui: Any, context: PanelContext, asked: Form) -> None:
        self._context, self._asked = context, asked
        self._sent: dict[str, Any] = {}
        self._form = form = Form(gui, lambda _, e: context.send_debounced("bed", self.message, e))
        self._window = gui.add_folder("Place by hand", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(BY_HAND_EXPLANATION))
            hint = "Moves the bed to where you click or drag on the skull"
            self._move = gui.add_button("Move on the skull", icon="target", color="gray", hint=hint)
            self._help = gui.add_html("")
            self._done = context.view_button(gui, "Done", "check", drawing=None, move_target=None)
            self._across = {
                name: form.slider(PlaceBed, name, **{name: 0.0}) for name in ("u_mm", "v_mm")
            }
            for name in ("angle_deg", "tilt_x_deg", "tilt_y_deg", "lift_mm"):
                form.slider(PlaceBed, name)
        on_click(self._move, self._begin)

    def _begin(self, event: Any) -> None:
        self._context.set_view(drawing="implant", move_target=None)
        self._context.set_camera("Region")

    def message(self) -> PlaceBed:
        """Return the placement that the sliders hold, of what the fields of the step ask for."""
        self._sent = self._asked.values(*ASKED) | self._form.values()
        return PlaceBed(**self._sent)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the maps and the bed; a slider that is ahead of its own message is left alone."""
        self._window.visible = new.step("implant").blocked is None
        if old is None or old.busy != new.busy:
            self._form.enable(not new.busy)
        held, moving = new.session.results.get("bed"), new.view.drawing == "implant"
        self._move.visible, self._done.visible = not moving, moving
        self._move.disabled = new.busy or held is None
        self._help.content = style.note(HELP) if moving else ""
        maps = new.session.results.maps
        if maps is not None and changed(old, new, "session.results.maps"):
            outer = maps.value.outer
            for name, slider in self._across.items():
                cells = outer.u_mm if name == "u_mm" else outer.v_mm
                slider.min, slider.max = float(np.floor(cells[0])), float(np.ceil(cells[-1]))
                slider.value = min(max(slider.value, slider.min), slider.max)
        before = None if old is None else old.session.results.get("bed")
        if held is None or held is before or dict(held.arguments) == self._sent:
            return
        self._form.show(_slider_values(held.value))


def _slider_values(bed: ImplantBed) -> dict[str, float]:
    """Return where the sliders stand for a bed."""
    if bed.placed is None:
        return {}
    at = bed.placed.placement
    return {"u_mm": float(at.u_mm), "v_mm": float(at.v_mm), **placed_turns(bed)}


EXPORT_EXPLANATION = (
    "Milling path in the frame of the bed (mm), as a table or as G-code; body that is milled away "
    "in the robot's base (.stl), and its outline, axis, screws and thinnest place for 3D Slicer "
    "(.mrk.json); certified motion of the robot (rad, s), as a table or, for UR arms, as URScript."
)


class BedExportFolder(ExportFolder):
    """Files of the bed."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        without = tuple(one.name for one in EXPORTS if one.name not in MOTIONS)
        super().__init__(gui, context, without, words=EXPORT_EXPLANATION, button="Download bed")

    def render(self, new: Snapshot) -> None:
        """Offer files where there is a bed that can be milled."""
        self.show(there=new.milling is not None, names=offered(new.session))


LINES_EXPLANATION = "Where to scan on, so that the bone below this bed is known better."
NEXT = "Then scan it (step 9, tilted passes), map again and lay the bed anew."


class LinesFolder:
    """The button that finds lines, and the one that plans a further pass along them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._rows: tuple[Any, ...] = ()
        self._window = gui.add_folder("Scan for this bed", visible=False, expand_by_default=False)
        with self._window:
            gui.add_html(style.text(LINES_EXPLANATION))
            self._words = gui.add_html("")
            self._find = context.send_button(gui, "Find lines", "search", StartBedLines)
            self._plan = gui.add_button("Plan pass along them", icon="route", color="gray")
            gui.add_html(style.text(NEXT))

        def plan(event: Any) -> None:
            context.send(lambda: StartTiltPlan(rows=self._rows), event)
            context.set_view(second=True, cursor=None, playing=False)

        on_click(self._plan, plan)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the bed and its lines."""
        self._window.visible = new.milling is not None
        if not changed(old, new, "session", "busy"):
            return
        found = _fresh(new.session)
        self._rows = () if found is None else found.rows
        self._find.disabled = bool(new.busy) or blocked(StartBedLines, new.session) is not None
        self._plan.disabled = bool(new.busy) or not self._rows
        self._words.content = "" if found is None else style.note(lines_verdict(found))


def _fresh(session: Session) -> BedLines | None:
    """Return the lines that were found for the bed of now."""
    return fresh("lines", session)


MILLING_EXPLANATION = (
    "Whether the robot can mill this bed: roll about the burr, timing, collisions."
)
REHEARSAL = (
    "Mills the virtual patient's bone: force is felt, the floor scanned again, the depth corrected."
)


class MillingFolder:
    """The button that asks the robot, the one that tries it, and what they said."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._window = gui.add_folder("Milling by the robot", visible=False)
        with self._window:
            gui.add_html(style.text(MILLING_EXPLANATION))
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


SHOWN = {
    "Implant in the bone": ("implant", "bed"),
    "Milling path": ("milling",),
    "Probability of each place": ("chance",),
}
BED_LAYERS = frozenset(name for names in SHOWN.values() for name in names)
NO_CHANCE = "Laid by hand: search the bed to see the probability of each place."


class ImplantPanel(StepPanel):
    """What is asked of the bed; what it leaves of the bone, and how it would be milled."""

    step = "implant"
    explanation = (
        "Finds where the bed most surely leaves enough bone, given the errors of the maps."
    )
    start = "Search the bed"

    def __init__(self, gui: Any, context: PanelContext) -> None:
        super().__init__(gui, context)
        with self.folder:
            self._hand = ByHandFolder(gui, context, self.form)
            self._lines = LinesFolder(gui, context)
            self._milling = MillingFolder(gui, context)
            self._figures = gui.add_folder("Figures", visible=False)
            with self._figures:
                self._tables = gui.add_html("")
            with gui.add_folder("Advanced", expand_by_default=False):
                self.form.of(StartBedSearch, "burr_mm")
            self._export = BedExportFolder(gui, context)

    def build_result(self) -> None:
        """Add the legend, the choice of what is shown, and the lifts that were tried."""
        gui, context = self.gui, self.context
        self._key = gui.add_html("")
        self._shown = gui.add_dropdown("Show", tuple(SHOWN))
        self._window = gui.add_checkbox(
            "Cut-away window", True, hint="Hides the drawn bone over the region"
        )
        self._lifts = gui.add_html("")
        on_change(self._shown, lambda e: self._show(SHOWN[e.target.value]))
        on_change(self._window, lambda e: context.set_view(skull_window=e.target.value))

    def build(self) -> None:
        """Add what is asked of the bed."""
        self._burr = BurrFields(self.gui, self.context)
        self.form.of(StartBedSearch, "implant", "lift_mm", "limit_mm", "probability")

    def _show(self, names: tuple[str, ...]) -> None:
        hide = BED_LAYERS - set(names)
        self.context.change_view(lambda v: replace(v, hidden=(v.hidden - set(names)) | hide))

    def message(self) -> Any:
        """Return the search with these parameters."""
        return StartBedSearch(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the bed, and explain the colours of what is shown of it."""
        held = new.session.results.get("bed")
        before = None if old is None else old.session.results.get("bed")
        if held is not None and held is not before:
            searched = held.message == StartBedSearch.__name__
            names = (*ASKED, "lift_mm") if searched else ASKED  # else it is that of the slider
            self.form.show({name: held.arguments.get(name) for name in names})
        self._shown.visible = held is not None
        self._window.visible = held is not None and not new.view.shows("chance")
        if changed(old, new, "view.skull_window"):
            self._window.value = new.view.skull_window
        if changed(old, new, "session", "view", "static_scene", "compared", "truth"):
            self._key.content = "" if held is None else _key(new)
        self._figures.visible = held is not None and held.value.placed is not None
        if changed(old, new, "session.results", "milling"):
            self._tables.content = "" if held is None else _tables(held.value, new.milling)
            self._lifts.content = "" if held is None else _lifts(held.value)
        self._burr.render(old, new)
        self._hand.render(old, new)
        self._lines.render(old, new)
        self._milling.render(old, new)
        self._export.render(new)

    def remarks(self, snapshot: Snapshot) -> str:
        """Return the verdict."""
        held = snapshot.session.results.get("bed")
        if held is None:
            return ""
        bed: ImplantBed = held.value
        words = style.note(verdict(bed), "good" if bed.refusal is None else "warn")
        risk = bed_risk(snapshot.session)
        return words if risk is None else words + style.text(risk.words)


def _lifts(bed: ImplantBed) -> str:
    """Return the lifts that were tried as a table; empty where none was."""
    rows = [(*cells, style.verdict(kept)) for *cells, kept in lift_rows(bed)]
    return style.table(("", "n", "n"), LIFT_HEAD, rows) if rows else ""


def _tables(bed: ImplantBed, milling: MillingView | None) -> str:
    """Return the figures of the bed, and of its milling where it lies wholly in the maps."""
    placed, html = bed.placed, ""
    if placed is not None:
        html = style.table(("", "n"), ("Bed", ""), bed_rows(bed, placed))
        if placed.screws:
            html += style.table(("", "n", "n", "n"), SCREW_HEAD, screw_rows(placed))
    if milling is not None:
        html += style.table(("", "n"), ("Milling", ""), milling_rows(milling))
    return html


DRAWN = (
    (css(STEEL), "implant"),
    (css(PURPLE), "screws"),
    (css(BONE_RIM), "bed"),
    (css(VERMILLION), "least bone below the bed"),
)


def _key(snapshot: Snapshot) -> str:
    """Return what the colours of the shown layers mean."""
    view, held, maps = snapshot.view, snapshot.session.results.get("bed"), shown_maps(snapshot)
    html = style.key(DRAWN) if view.shows("implant") else ""
    if view.shows("milling"):
        html += style.key(tuple((css(color), word) for word, color in MILLING_COLORS.values()))
    if opens_window(view) and view.shows("inner") and maps is not None:
        layers = layers_of(maps, view.quantity, map_sigma(snapshot), map_errors(snapshot))
        html += color_bar(layers)
    if held is None or not view.shows("chance"):
        return html
    if held.value.probability is None:
        return html + style.text(NO_CHANCE)
    bar = style.color_bar("Probability with the middle of the bed here", "0 %", "50 %", "100 %")
    return html + bar + style.text("White dots: safe. Orange ring: the bed.")
