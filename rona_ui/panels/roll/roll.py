"""Step 7: choice of the roll about the probe axis, and motion planning."""

from typing import Any

from rona_core.app.steps.roll.certificate_view import certificate_view
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.roll.view import joint_curves, none_works
from rona_ui.panels.roll.base_placement import BasePlacementControls
from rona_ui.panels.roll.certificate import refusal_in_short
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.presentation.colors import GREEN, VERMILLION, YELLOW, css
from rona_ui.presentation.snapshot import Snapshot, changed

CHOICES = {"Largest margin": "best", "First feasible (paper)": "first"}
MODES = {"Constant, else varying": "auto", "Constant": "constant", "Varying": "variable"}


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

    def build(self) -> None:
        """Add the range."""
        self.form.numbers(
            ("n_rolls", "Roll angles", 72, 1, 720, 1),
            ("roll_from_deg", "From (deg)", 0.0, -360.0, 360.0, 5.0),
            ("roll_to_deg", "To (deg)", 360.0, -355.0, 720.0, 5.0),
        )
        self.form.choice("choice", "Select by", CHOICES, "best")
        self.form.choice("mode", "Roll mode", MODES, "auto")
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
        if changed(old, new, "view.hidden"):
            self._obstacles.value = "obstacles" not in new.view.hidden

    def remarks(self, snapshot: Snapshot) -> str:
        """Say how many work, what the verifier says, and what the shown roll does."""
        derived = snapshot.session.results.roll
        if derived is None:
            return ""
        plan = derived.value
        works = sum(verdict.feasible for verdict in plan.search.verdicts)
        if plan.search.mode == "none" or plan.trajectory is None or plan.certificate is None:
            first = style.note(none_works(plan), "warn")
        else:
            view = certificate_view(snapshot.session)
            certified = view is not None and view.certified
            varies = plan.search.mode == "variable"
            turned = f"a roll varying over {plan.search.roll_variation_deg:.0f}°"
            chosen = (
                turned if varies else f"{plan.search.verdicts[plan.search.chosen].roll_deg:.0f}°"
            )
            first = style.note(
                f"{works} of {len(plan.search.verdicts)} roll angles feasible. Selected {chosen}, "
                f"duration {plan.trajectory.times_s[-1]:.1f} s, "
                + ("verified." if certified else "refused by the verifier."),
                "good" if certified else "warn",
            )
            if view is not None and not certified:
                first += style.note(refusal_in_short(view), "warn")
        curves = joint_curves(snapshot.session, snapshot.view.shown_roll)
        second = ""
        if curves is not None and not curves.feasible:
            second = style.note(style.sentence(curves.sentence), "warn")
        legend = ((css(GREEN), "feasible"), (css(VERMILLION), "infeasible"), (css(YELLOW), "shown"))
        return first + second + style.key(legend)
