"""Replay: one cursor along the planned motion for robot, joints, A-scan and scan point."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.roll.view import place_of_roll
from rona_core.app.steps.scan.planned_motion import motion_stale, motion_times
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.shown import shows_roll_preview
from rona_ui.presentation.snapshot import Snapshot, changed

REPLAYED = ("roll", "scan", "maps")  # steps in which the replay is offered
SPEEDS = {"1×": 1.0, "4×": 4.0, "16×": 16.0}


class ReplayPanel:
    """Slider, play, back, and a choice of speeds."""

    def __init__(self, gui: Any, context: PanelContext, window: Any) -> None:
        self._window = window
        self._words = gui.add_html("")
        self._slider = gui.add_slider("Motion (%)", 0.0, 100.0, 0.1, 0.0)
        self._buttons = gui.add_button_group("Replay", ("Play", "Pause", "Back", "Live"))
        self._speed = gui.add_button_group("Speed", tuple(SPEEDS))
        on_change(
            self._slider, lambda e: context.set_view(cursor=e.target.value / 100.0, playing=False)
        )
        on_click(self._buttons, lambda e: context.change_view(self._change))
        on_click(self._speed, lambda e: context.set_view(speed=SPEEDS[self._speed.value]))

    def _change(self, view: Any) -> Any:
        wanted = self._buttons.value
        if wanted == "Play":
            start = view.cursor if view.cursor is not None and view.cursor < 1.0 else 0.0
            return replace(view, playing=True, cursor=start)
        if wanted == "Pause":
            return replace(view, playing=False)
        return replace(view, playing=False, cursor=0.0 if wanted == "Back" else None)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the cursor; without a planned motion there is nothing to replay."""
        parts = ("session.results.roll", "session.results.second", "view", "busy", "steps")
        if not changed(old, new, *parts):
            return
        times = motion_times(new.session, second=new.view.second)
        stale = motion_stale(new.session, second=new.view.second)
        cursor = new.view.cursor
        seen = times is not None and (cursor is not None or new.view.step in REPLAYED)
        self._window.visible = seen
        if times is None:
            words = "The planned motion can be replayed after step 7."
        elif stale is not None:
            words = f"The planned motion is stale and not shown: {stale}."
        elif shows_roll_preview(new):
            place = place_of_roll(new.session, new.view.shown_roll, new.view.place)
            words = (
                f"Shown: the selected roll at {100.0 * place:.0f} % of the path. Play runs "
                f"the planned motion ({times[0]:.1f} s)."
            )
        elif cursor is None:
            words = f"Live. The planned motion takes {times[0]:.1f} s."
        else:
            words = (
                f"{cursor * times[0]:.1f} of {times[0]:.1f} s, "
                f"{_phase(cursor * times[0], times)}; {new.view.speed:.0f}× real time"
            )
        self._words.content = style.text(("Second pass. " if new.view.second else "") + words)
        self._slider.value = round(100.0 * (cursor or 0.0), 1)


def _phase(time_s: float, times: tuple[float, float, float]) -> str:
    if time_s < times[1]:
        return "approach"
    return "scan" if time_s <= times[2] else "retract"
