"""Step 7: choice of the roll about the probe axis, motion planning, and placement of the base."""

from functools import partial
from typing import Any, Literal

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.roll.certificate_view import (
    CLEARANCE,
    DURATION,
    NO_CLEARANCE,
    CertificateView,
    CheckPlace,
    certificate_view,
    plan_reason,
)
from rona_core.app.steps.roll.inputs import last_roll_search
from rona_core.app.steps.roll.messages import (
    ApplyBasePlacement,
    StartBasePlacement,
    StartRollSearch,
    TakeMotion,
)
from rona_core.app.steps.roll.step import (
    EXPORTS,
    BasePlace,
    BasePlacement,
    fresh_placement,
    is_urscript,
    moves,
)
from rona_core.app.steps.roll.view import expected_duration, joint_curves, none_works
from rona_core.devices.limits import limits_of
from rona_core.devices.robots import UNIVERSAL
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_change
from rona_ui.panels.widgets.step_panel import ExportFolder, LoadFolder, StepPanel
from rona_ui.presentation.colors import (
    BLOCKED,
    BLUE,
    GREEN,
    ORANGE,
    SKY,
    VERMILLION,
    css,
    viridis_css,
)
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.viewer.bindings import escape

EXPECTED = FIGURES["scan_duration_predicted_s"]
NOTHING = "The verification appears here once a motion is planned (step 7)."
NOWHERE = "Select a check"


class ChecksPanel:
    """A verdict, a choice that drives the replay to a check's worst place, and the whole list."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._words = gui.add_html(style.text(NOTHING))
        hint = "Moves the replay to the worst value of this check"
        self._choice = gui.add_dropdown("Go to worst", (NOWHERE,), visible=False, hint=hint)
        self._table = gui.add_html("")
        self._rows: dict[str, CheckPlace] = {}

        def go(event: Any) -> None:
            row = self._rows.get(self._choice.value)
            if row is not None:
                context.set_view(cursor=row.share, playing=False)
                context.set_camera("Probe" if row.path_percent is not None else "Robot")

        on_change(self._choice, go)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the plan."""
        if not changed(old, new, "session.results.roll", "steps"):
            return
        view = certificate_view(new.session)
        self._choice.visible = view is not None
        if view is None:
            self._words.content, self._table.content = style.text(NOTHING), ""
            return
        stale = new.step("roll").state == "stale"
        self._words.content = verdict(view, stale=stale)
        if changed(old, new, "session.results.roll"):
            self._rows = {
                ("✖ " if not row.check.holds else "") + row.check.name: row for row in view.rows
            }
            self._choice.options = (NOWHERE, *self._rows)
            self._choice.value = NOWHERE
            self._table.content = table(view)


def verdict(view: CertificateView, *, stale: bool) -> str:
    """Return the overall verdict; for a refusal with cause and place."""
    number = len(view.rows)
    if not view.certified:
        return style.note(refusal(view), "warn")
    if stale:
        return style.note(
            f"All {number} checks held, but inputs have changed since. Plan again.", "warn"
        )
    words = f"Verified: all {number} checks hold. {DURATION.named(view.duration_s)}."
    if view.min_clearance_mm is not None:
        words += f" {CLEARANCE.named(view.min_clearance_mm)}."
    return style.note(words, "good")


def refusal(view: CertificateView) -> str:
    """Return why and where the motion is refused."""
    failures = view.failures
    if not failures:
        return (
            "Refused: the certificate belongs to another motion, robot or tolerances. Plan again."
        )
    parts = "; ".join(f"{row.check.sentence} ({row.place})" for row in failures[:3])
    more = f"; and {len(failures) - 3} more" if len(failures) > 3 else ""
    unchecked = f" {NO_CLEARANCE}." if view.min_clearance_mm is None else ""
    return f"Refused: {parts}{more}.{unchecked} The robot will not execute it."


def refusal_in_short(view: CertificateView) -> str:
    """Return what is refused, for beside the plan."""
    names = ", ".join(
        f"{row.check.name} ({row.value_words}, {row.limit_words})" for row in view.failures[:3]
    )
    more = len(view.failures) - 3
    names += f" and {more} more" if more > 0 else ""
    return f"Refused: {names or 'another motion, robot or tolerances'}. See Checks on the right."


def table(view: CertificateView) -> str:
    """Return one row a check: name and place, worst value, limit, verdict."""
    rows = (
        (
            f'{escape(row.check.name)}<br><span class="g">{escape(row.place)}</span>',
            f'<b>{escape(row.value_words)}</b><br><span class="g">{escape(row.limit_words)}</span>',
            style.verdict("pass" if row.check.holds else "fail"),
        )
        for row in view.rows
    )
    return style.table(("", "n", ""), ("Check, where it is worst", "Value, limit", ""), rows)


AGAIN = (
    "The tracker is registered to the base. After a move repeat steps 2 and 4 to 7; the "
    "pointer calibration stays valid."
)
USES: dict[Literal["smallest", "best"], str] = {
    "smallest": "Use nearest pose",
    "best": "Use pose with largest margin",
}


class BasePlacementControls:
    """Search button, summary, and a button for each verified base pose."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        form = self._form = Form(gui)
        self._search = context.send_button(
            gui, "Find base pose", "map-search", lambda: StartBasePlacement(**form.values())
        )
        self._words = gui.add_html("")
        self._use = {
            choice: context.send_button(
                gui, label, "check", partial(ApplyBasePlacement, choice), color=None, visible=False
            )
            for choice, label in USES.items()
        }
        self._key = gui.add_html("")
        with gui.add_folder("Search range", expand_by_default=False):
            form.of(StartBasePlacement, "half_x_mm", "half_y_mm", "step_mm")

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the search, and rest while something runs."""
        if not changed(old, new, "session", "busy"):
            return
        found = fresh_placement(new.session)
        self._search.disabled = new.busy or new.step("roll").state == "blocked"
        self._form.enable(not new.busy)
        offered = {} if found is None else offers(found)
        for name, button in self._use.items():
            button.visible, button.disabled = name in offered, new.busy
        self._words.content = placement_words(new.session, found)
        self._key.content = placement_key(found)


def offers(found: BasePlacement) -> dict[str, BasePlace]:
    """Return the places that can be taken; one that is both is offered once."""
    smallest, best = found.smallest, found.best
    both = {"smallest": smallest, "best": None if best is smallest else best}
    return {name: place for name, place in both.items() if place is not None and moves(place)}


def placement_words(session: Session, found: BasePlacement | None) -> str:
    """Return what the search found, as HTML."""
    if found is None:
        return _outdated_note(session)
    offered = offers(found)
    words = _rolls_note(last_roll_search(session))
    if found.smallest is None:
        reasons = "; ".join(found.reasons)
        words += style.note(f"No verified base pose found: {reasons}.", "warn")
    elif not moves(found.smallest):
        words += style.note("The scan is verified from the present base pose.", "good")
    for name, title in (("smallest", "Nearest pose"), ("best", "Largest margin")):
        if name in offered:
            words += style.note(f"{title}: {place_words(offered[name])}", "good")
    return words + (style.text(AGAIN) if offered else "")


def _rolls_note(rolls: StartRollSearch) -> str:
    """Return which rolls a place must work with, where they are not the default ones."""
    if rolls == StartRollSearch():
        return ""
    mode = limits_of(StartRollSearch)["mode"]["labels"][rolls.mode]
    return style.text(
        f"Rolls of the last search: {mode.lower()}, {rolls.n_rolls} from "
        f"{rolls.roll_from_deg:g}° to {rolls.roll_to_deg:g}°."
    )


def _outdated_note(session: Session) -> str:
    """Return what is left to say of a search that no longer holds."""
    searched, robot = session.results.placement, session.setup.devices.robot
    if searched is None:
        return ""
    stands = robot.base_shift_mm, robot.base_turn_deg
    if any((place.shift_mm, place.turn_deg) == stands for place in offers(searched.value).values()):
        return style.note("The base stands at the selected pose. " + AGAIN)
    return style.note("Base, path, rolls or obstacles have changed. Search again.")


def placement_key(found: BasePlacement | None) -> str:
    """Return the legend of the map on the floor."""
    if found is None:
        return ""
    most = float(found.margins[~found.blocked].max(initial=0.0))
    legend = (
        f'<div class="r-key"><span><i style="width:44px;background:{viridis_css()}"></i>'
        f"floor map: feasible, margin 0 to {most:.1f}</span></div>"
    )
    others = [(css(VERMILLION), "infeasible"), (css(BLOCKED), "too close to the head")]
    marks = {"smallest": (css(ORANGE), "nearest pose"), "best": (css(SKY), "largest margin")}
    return legend + style.key(tuple(others + [marks[name] for name in offers(found)]))


def place_words(place: BasePlace) -> str:
    """Return a place in plain words."""
    x, y, z = place.shift_mm
    rolls = f"{place.n_feasible} constant roll angles feasible, margin {place.margin:.2f}"
    if place.mode != "constant":
        rolls = "a varying roll is feasible"
    return (
        f"Moved by {place.moved_mm:.0f} mm and rotated by {place.turned_deg:.0f}°, to "
        f"({x:.0f}, {y:.0f}, {z:.0f}) mm and {place.turn_deg:.0f}°. Verified: {rolls}."
    )


EXPLANATION = (
    "Certified motion of the scan (rad, s), linear between its samples: as a table (.csv), a "
    "JointTrajectory of ROS (.json, .yaml, .mcap) or, for UR arms, as URScript (.script)."
)


class MotionExportFolder(ExportFolder):
    """Files of the certified motion."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        names = tuple(one.name for one in EXPORTS)
        super().__init__(
            gui, context, names, words=EXPLANATION, button="Download motion", title="Export motion"
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the plan; one that is stale or refused is not exported."""
        if not changed(old, new, "session"):
            return
        session = new.session
        plan = session.results.roll
        has_script = session.setup.devices.robot.model in UNIVERSAL
        names = tuple(one.name for one in EXPORTS if has_script or not is_urscript(one.name))
        there = plan is not None and plan.value.trajectory is not None
        self.show(
            there=there, names=names, reason=stale_reason("roll", session) or plan_reason(session)
        )


class RollPanel(StepPanel):
    """Range and number of rolls; the map of them stands on the right."""

    step = "roll"
    explanation = (
        "Evaluates each roll angle along the path (reach, joint limits, singularities, "
        "continuity). The selected plan is time-parameterised and verified independently."
    )
    start = "Plan motion"

    def __init__(self, gui: Any, context: PanelContext) -> None:
        super().__init__(gui, context)
        with self.folder:
            self._places = BasePlacementControls(gui, context)
            self._load = LoadFolder(gui, context, "motion")
            self._export = MotionExportFolder(gui, context)

    def build(self) -> None:
        """Add the range."""
        self.form.of(StartRollSearch)
        seen = self._obstacles = self.gui.add_checkbox(
            "Show obstacles", False, hint="Draws the obstacles of robot and tool"
        )
        on_change(seen, lambda e: self.context.show_layer("obstacles", bool(seen.value)))

    def message(self) -> Any:
        """Return the search."""
        return StartRollSearch(**self.form.values())

    def update(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow what is shown of the surroundings, and offer places of the base."""
        self._places.render(old, new)
        self._load.render(new)
        self._export.render(old, new)
        if changed(old, new, "view.hidden"):
            self._obstacles.value = "obstacles" not in new.view.hidden

    def remarks(self, snapshot: Snapshot) -> str:
        """Say how long the scan will take, how many rolls work, and what the verifier says."""
        expected_s, derived = expected_duration(snapshot.session), snapshot.session.results.roll
        expected = "" if expected_s is None else style.text(f"{EXPECTED.named(expected_s)}.")
        if derived is None:
            return expected
        plan, search = derived.value, derived.value.search
        works = sum(verdict.feasible for verdict in search.verdicts)
        if search.mode == "none" or plan.trajectory is None or plan.certificate is None:
            first = style.note(none_works(plan), "warn")
        else:
            view = certificate_view(snapshot.session)
            certified = view is not None and view.certified
            if derived.message == TakeMotion.__name__:
                chosen = "the imported motion"
            elif search.mode == "variable":
                chosen = f"a roll varying over {search.roll_variation_deg:.0f}°"
            else:
                chosen = f"{search.verdicts[search.chosen].roll_deg:.0f}°"
            first = style.note(
                f"{works} of {len(search.verdicts)} roll angles feasible. Selected {chosen}, "
                f"{'verified' if certified else 'refused by the verifier'}. "
                f"{DURATION.named(float(plan.trajectory.times_s[-1]))}.",
                "good" if certified else "warn",
            )
            if view is not None and not certified:
                first += style.note(refusal_in_short(view), "warn")
        curves = joint_curves(snapshot.session, snapshot.view.shown_roll)
        second = ""
        if curves is not None and not curves.feasible:
            second = style.note(style.sentence(curves.sentence), "warn")
        legend = (
            (css(GREEN), "feasible"),
            (css(VERMILLION), "infeasible"),
            (css(BLUE), "selected"),
        )
        return expected + first + second + style.key(legend)
