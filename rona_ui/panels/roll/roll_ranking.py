"""Ranking of constant rolls by margin, with the branch of the arm."""

from dataclasses import replace
from typing import Any

from rona_core.app.steps.roll.messages import ChooseRoll
from rona_core.app.steps.roll.view import RankedWay, ranked_ways
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.panel_context import PanelContext, on_change
from rona_ui.presentation.snapshot import Snapshot
from rona_ui.presentation.view_state import ViewState
from rona_ui.viewer.bindings import escape

LISTED = 12  # ways in the table; the choice has more


class RollRanking:
    """A closed folder: the table of the best ways, and a choice that plans with one of them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._ways: tuple[RankedWay, ...] = ()
        self._folder = gui.add_folder("Ranking", expand_by_default=False, visible=False)
        with self._folder:
            self._choice = gui.add_dropdown(
                "Use", ("–",), hint="Plans and verifies this configuration"
            )
            self._table = gui.add_html("")

        def take(event: Any) -> None:
            names = [name_of(number, way) for number, way in enumerate(self._ways, start=1)]
            if self._choice.value in names:
                way = self._ways[names.index(self._choice.value)]
                context.change_view(_plan_shown)
                context.send(lambda: ChooseRoll(way.index, way.branch), event)

        on_change(self._choice, take)

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the search."""
        if old is not None and old.session.results.roll is new.session.results.roll:
            if old.busy != new.busy:
                self._choice.disabled = new.busy
            return
        self._ways = ranked_ways(new.session)
        self._folder.visible = bool(self._ways)
        names = [name_of(number, way) for number, way in enumerate(self._ways, start=1)]
        chosen = next((n for n, way in zip(names, self._ways, strict=True) if way.chosen), "–")
        self._choice.options = ("–", *names)
        self._choice.value = chosen
        self._table.content = table(self._ways)


def _plan_shown(view: ViewState) -> ViewState:
    return replace(view, shown_roll=None, place=None, cursor=None, playing=False)


def name_of(number: int, way: RankedWay) -> str:
    """Return what the choice says of a way."""
    return f"{number}: {way.roll_deg:.0f}°, margin {way.margin:.2f}"


def table(ways: tuple[RankedWay, ...]) -> str:
    """Return the best ways and the chosen one."""
    rows = ""
    for number, way in enumerate(ways, start=1):
        if number > LISTED and not way.chosen:
            continue
        mark = " ✔" if way.chosen else ""
        rows += (
            f'<tr><td class="n">{number}{mark}</td><td class="n">{way.roll_deg:.0f}°</td>'
            f'<td>{escape(way.label)}</td><td class="n">{way.margin:.2f}</td></tr>'
        )
    head = (
        '<tr><th class="n">#</th><th class="n">Roll</th><th>Arm</th><th class="n">Margin</th></tr>'
    )
    return (
        f'<table class="r-table">{head}{rows}</table>'
        + style.text(
            "Margin: smallest distance from limits, singularities and jumps along the path."
        )
        if ways
        else ""
    )
