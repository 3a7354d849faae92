"""Step 7: the roll about the probe axis with which the robot can follow the whole path."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.roll.certificate_view import certificate_view
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.roll.view import joint_curves, none_works
from rona_ui.panels.roll.base_placement import BasePlaceControls
from rona_ui.panels.roll.certificate import refusal_in_short
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import Door, follow
from rona_ui.panels.widgets.step_panel import StepPanel
from rona_ui.scene.colors import GREEN, VERMILLION, YELLOW, css
from rona_ui.view_state import Picture, ViewState

CHOICES = {"Most room": "best", "First that works (as the paper)": "first"}
MODES = {"Constant, else varying": "auto", "Constant": "constant", "Varying": "variable"}


class RollPanel(StepPanel):
    """Range and number of rolls; the map of them stands on the right."""

    step = "roll"
    explanation = (
        "Every roll is tried along the whole path: reach, joint limits, singularities and jumps. "
        "The chosen one is timed and checked by an independent verifier."
    )
    start = "Search the roll"

    def __init__(self, gui: Any, door: Door) -> None:
        super().__init__(gui, door)
        with self.folder:
            self._places = BasePlaceControls(gui, door)

    def build(self) -> None:
        """Add the range."""
        self.form.number("n_rolls", "Rolls", 72, 1, 720, 1)
        self.form.number("roll_from_deg", "From (deg)", 0.0, -360.0, 360.0, 5.0)
        self.form.number("roll_to_deg", "To (deg)", 360.0, -355.0, 720.0, 5.0)
        self.form.choice("choice", "Choose", CHOICES, "best")
        self.form.choice("mode", "Roll", MODES, "auto")
        seen = self._obstacles = self.gui.add_checkbox(
            "Obstacles", False, hint="What robot and tool keep away from, drawn faintly"
        )
        follow(seen, lambda e: self.door.view(lambda v: _with_obstacles(v, seen.value)))

    def message(self) -> Any:
        """Return the search."""
        return StartRollSearch(**self.form.values())

    def update(self, old: Picture | None, new: Picture) -> None:
        """Follow what is shown of the surroundings, and offer places of the base."""
        self._places.render(old, new)
        if old is None or old.view.hidden != new.view.hidden:
            self._obstacles.value = "obstacles" not in new.view.hidden

    def remarks(self, picture: Picture) -> str:
        """Say how many work, what the verifier says, and what the shown roll does."""
        derived = picture.session.results.roll
        if derived is None:
            return ""
        plan = derived.value
        works = sum(verdict.feasible for verdict in plan.verdicts)
        if plan.mode == "none" or plan.trajectory is None or plan.certificate is None:
            first = style.note(none_works(plan), "warn")
        else:
            view = certificate_view(picture.session)
            certified = view is not None and view.certified
            varies = plan.mode == "variable"
            turned = f"varying over {plan.roll_variation_deg:.0f}°"
            chosen = turned if varies else f"{plan.verdicts[plan.chosen].roll_deg:.0f}°"
            first = style.note(
                f"{works} of {len(plan.verdicts)} rolls work; {chosen} chosen, motion of "
                f"{plan.trajectory.times_s[-1]:.1f} s. The verifier "
                + ("certifies the motion." if certified else "refuses the motion."),
                "good" if certified else "warn",
            )
            if view is not None and not certified:
                first += style.note(refusal_in_short(view), "warn")
        curves = joint_curves(picture.session, picture.view.shown_roll)
        second = ""
        if curves is not None and not curves.feasible:
            second = style.note(curves.sentence[:1].upper() + curves.sentence[1:], "warn")
        legend = ((css(GREEN), "works"), (css(VERMILLION), "fails"), (css(YELLOW), "shown"))
        return first + second + style.key(legend)


def _with_obstacles(view: ViewState, seen: bool) -> ViewState:
    only = frozenset(("obstacles",))
    return replace(view, hidden=view.hidden - only if seen else view.hidden | only)
