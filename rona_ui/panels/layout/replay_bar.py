"""Replay: one cursor along the planned motion for robot, joints, A-scan, scan point and bone."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.implant.milling_motion import layer_at
from rona_core.app.steps.roll.view import place_of_roll
from rona_core.app.steps.scan.planned_motion import motion_stale, motion_times
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.shown import replay_duration_s, shows_roll_preview
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import ViewState

REPLAYED = ("roll", "scan", "maps", "implant")  # steps in which the replay is offered
SPEEDS = {"1×": 1.0, "4×": 4.0, "16×": 16.0, "64×": 64.0}


class ReplayPanel:
    """Slider, play, back, and a choice of speeds."""

    def __init__(self, gui: Any, context: PanelContext, window: Any) -> None:
        self._window = window
        self._words = gui.add_html("")
        self._slider = gui.add_slider("Motion (%)", 0.0, 100.0, 0.1, 0.0)
        self._buttons = gui.add_button_group("Replay", ("Play", "Pause", "Back", "Live"))
        self._speed = gui.add_button_group("Speed", tuple(SPEEDS))
        on_change(
            self._slider,
            lambda e: context.change_view(lambda v: v.replayed_at(e.target.value / 100.0)),
        )
        on_click(self._buttons, lambda e: context.change_view(self._change))
        on_click(self._speed, lambda e: context.set_view(speed=SPEEDS[self._speed.value]))

    def _change(self, view: ViewState) -> ViewState:
        wanted, cursor = self._buttons.value, view.replay_cursor
        if wanted == "Play":
            start = cursor if cursor is not None and cursor < 1.0 else 0.0
            return view.replayed_at(start, playing=True)
        if wanted == "Pause":
            return replace(view, playing=False)
        return view.replayed_at(0.0 if wanted == "Back" else None)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the cursor; without a planned motion there is nothing to replay."""
        if not changed(old, new, "session", "view", "busy", "steps"):
            return
        duration_s, cursor = replay_duration_s(new.session, new.view), new.view.replay_cursor
        offered = cursor is not None or new.view.step in REPLAYED
        self._window.visible = duration_s is not None and offered
        words = scan_words(new) if new.view.step != "implant" else milling_words(new, duration_s)
        self._words.content = style.text(words)
        self._slider.value = round(100.0 * (cursor or 0.0), 1)


def milling_words(snapshot: Snapshot, duration_s: float | None) -> str:
    """Return where the replay of the milling is; empty where there is none."""
    cursor = snapshot.view.milling_cursor
    if duration_s is None:
        return ""
    whole = clock(duration_s)
    layer = None if cursor is None else layer_at(snapshot.session, cursor)
    if cursor is None or layer is None:
        return f"The planned milling takes {whole} min."
    return (
        f"{clock(cursor * duration_s)} of {whole} min, layer {layer[0]} of {layer[1]}; "
        f"{snapshot.view.speed:.0f}× real time"
    )


def clock(time_s: float) -> str:
    """Return a time as minutes and seconds."""
    minutes, seconds = divmod(round(time_s), 60)
    return f"{minutes}:{seconds:02d}"


def scan_words(snapshot: Snapshot) -> str:
    """Return where the replay of the scan is."""
    view, session = snapshot.view, snapshot.session
    times = motion_times(session, second=view.second)
    cursor, stale = view.cursor, motion_stale(session, second=view.second)
    if times is None:
        words = "The planned motion can be replayed after step 7."
    elif stale is not None:
        words = f"The planned motion is stale and not shown: {stale}."
    elif shows_roll_preview(snapshot):
        place = place_of_roll(session, view.shown_roll, view.place)
        words = (
            f"Shown: the selected roll at {100.0 * place:.0f} % of the path. Play runs "
            f"the planned motion ({times[0]:.1f} s)."
        )
    elif cursor is None:
        words = f"Live. The planned motion takes {times[0]:.1f} s."
    else:
        words = (
            f"{cursor * times[0]:.1f} of {times[0]:.1f} s, "
            f"{_phase(cursor * times[0], times)}; {view.speed:.0f}× real time"
        )
    return ("Second pass. " if view.second else "") + words


def _phase(time_s: float, times: tuple[float, float, float]) -> str:
    if time_s < times[1]:
        return "approach"
    return "scan" if time_s <= times[2] else "retract"
