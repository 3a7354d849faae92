"""Roll browser: the roll image, which is also the slider that selects a roll."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.roll.messages import ChooseRoll
from rona_core.app.steps.roll.view import (
    joint_curves,
    place_of_roll,
    point_at,
    roll_strip,
    shown_roll,
    shows_chosen,
    shows_varying,
)
from rona_ui.panels.roll.margins import MarginControls
from rona_ui.panels.roll.roll_image import legend, roll_picture
from rona_ui.panels.roll.roll_ranking import RollRanking
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.image_slider import sheet
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.snapshot import Snapshot

HEIGHT_PX = 190
NOTHING = "The roll map appears after step 7."
WORDS = (
    "Across: roll angle. Down: position along the path. Click or drag to select a roll; a "
    "feasible one is planned and verified."
)


class RollsPanel:
    """Click in the picture: the roll is shown; one that works is planned and verified at once."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._gui, self._context = gui, context
        self._words = gui.add_html(style.text(NOTHING))
        self._sheet = gui.add_html("")
        self._folder = gui.add_folder(None, visible=False)
        self._slider: Any = None
        self._remark = gui.add_html("")
        self._back = gui.add_button(
            "Show selected roll", icon="arrow-back-up", color="gray", visible=False
        )
        self._place = gui.add_slider(
            "Path position (%)",
            0.0,
            100.0,
            0.5,
            50.0,
            visible=False,
            hint="Where along the path the robot is shown",
        )
        self._legend = gui.add_html("")
        self._margins = MarginControls(gui, context)
        self._ranking = RollRanking(gui, context)
        self._works: tuple[bool, ...] = ()
        on_change(self._place, self._moved)
        on_click(
            self._back,
            lambda e: context.change_view(lambda v: replace(v, shown_roll=None, place=None)),
        )

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow search and shown roll."""
        roll = new.session.results.roll
        before = None if old is None else old.session.results.roll
        self._margins.render(old, new)
        self._ranking.render(old, new)
        if old is None or before is not roll:
            self._build(new)
        elif (
            old.view.shown_roll == new.view.shown_roll
            and old.view.place == new.view.place
            and old.steps is new.steps
        ):
            return
        index = column_shown(new)
        if index is not None and self._slider is not None:
            self._slider.value = index
        self._back.visible = roll is not None and not shows_chosen(roll.value, new.view.shown_roll)
        self._back.disabled = roll is None or roll.value.search.mode == "none"
        self._remark.content = remark(new)
        if index is not None:
            place = place_of_roll(new.session, new.view.shown_roll, new.view.place)
            self._place.value = round(200.0 * place) / 2.0

    def _build(self, new: Snapshot) -> None:
        strip = roll_strip(new.session)
        if self._slider is not None:
            self._slider.remove()
            self._slider = None
        there = strip is not None and len(strip.rolls_deg) > 1
        self._folder.visible = there
        self._place.visible = strip is not None
        self._words.content = style.text(WORDS if there else NOTHING)
        if strip is None or not there:
            self._sheet.content = self._legend.content = ""
            return
        self._works = tuple(bool(works) for works in strip.feasible)
        self._legend.content = legend(strip)
        with self._folder:
            self._sheet.remove()
            image = roll_picture(strip)
            self._sheet = self._gui.add_html(sheet("r-rolls", HEIGHT_PX, "image/svg+xml", image))
            last = len(strip.rolls_deg) - 1
            marks = tuple(
                (i, f"{strip.rolls_deg[i]:.0f}°")
                for i in np.unique(np.linspace(0, last, 5).round().astype(int)).tolist()
            )
            self._slider = self._gui.add_slider(
                "Roll", 0, last, 1, max(strip.chosen, 0), marks=marks
            )
        on_change(self._slider, self._chosen)

    def _chosen(self, event: Any) -> None:
        index = int(self._slider.value)
        self._context.change_view(
            lambda v: replace(v, shown_roll=index, place=None, cursor=None, playing=False)
        )
        if 0 <= index < len(self._works) and self._works[index]:
            self._context.send_debounced("roll", lambda: ChooseRoll(index), event)

    def _moved(self, event: Any) -> None:
        place = float(self._place.value) / 100.0
        self._context.change_view(lambda v: replace(v, place=place, cursor=None, playing=False))


def column_shown(snapshot: Snapshot) -> int | None:
    """Return the slider position: the shown roll, or a varying roll at its path position."""
    view, searched = snapshot.view, snapshot.session.results.roll
    index = shown_roll(snapshot.session, view.shown_roll)
    if index is None or searched is None or not shows_varying(searched.value, view.shown_roll):
        return index
    plan = searched.value
    place = place_of_roll(snapshot.session, view.shown_roll, view.place)
    roll_deg = np.rad2deg(plan.search.rolls_rad[point_at(plan, place)])
    apart = [abs((v.roll_deg - roll_deg + 180.0) % 360.0 - 180.0) for v in plan.search.verdicts]
    return int(np.argmin(apart))


def remark(snapshot: Snapshot) -> str:
    """Return the verdict on the shown roll as HTML."""
    curves = joint_curves(snapshot.session, snapshot.view.shown_roll)
    if curves is None:
        return ""
    words = curves.sentence[:1].upper() + curves.sentence[1:]
    if not curves.feasible and curves.worst_joint:
        words += f". Red in the scene: this place, and the links after joint {curves.worst_joint}"
    if snapshot.step("roll").state == "stale":
        return style.note(f"{words}. Stale: plan again.", "warn")
    return style.note(words, "good" if curves.feasible else "warn")
