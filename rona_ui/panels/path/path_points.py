"""Points of the smoothed path in step 6: listed, and changed by their number."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.path.messages import DeletePathPoint, InsertPathPoint, MovePathPoint
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form
from rona_ui.panels.widgets.panel_context import PanelContext, on_change, on_click
from rona_ui.presentation.held_point import corners_of, held_point, holding
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import ViewState

HELP = "A point is placed on the measured surface. The arrow keys move the selected one."
FOLLOWED = ("session.results.smoothing", "session.path_edits", "view.moved_point", "view.drawing")


class PathPoints:
    """A closed folder: number and place of a point, what can be done with it, and all of them."""

    def __init__(self, gui: Any, context: PanelContext) -> None:
        self._context, self._session = context, Session()
        self._folder = gui.add_folder("Path points", expand_by_default=False)
        with self._folder:
            self._number = gui.add_number("Point no.", 1, min=1, max=1, step=1)
            form = self._form = Form(gui, self._move)
            form.of(MovePathPoint, "point_base_mm", point_base_mm=(0.0, 0.0, 0.0))
            self._insert = gui.add_button("Insert point after", icon="plus", color="gray")
            self._delete = gui.add_button("Delete this point", icon="trash", color="gray")
            gui.add_html(style.text(HELP))
            self._list = gui.add_html("")
        on_change(self._number, lambda e: context.change_view(self._select))
        on_click(self._insert, lambda e: context.send(self._halfway, e))
        on_click(self._delete, lambda e: context.send(lambda: DeletePathPoint(self._index()), e))

    def _index(self) -> int:
        return int(self._number.value) - 1

    def _select(self, view: ViewState) -> ViewState:
        return holding(view, self._session, self._index())

    def _move(self, name: str, event: Any) -> None:
        index, (x, y, z) = self._index(), self._form.value(name)
        place = float(x), float(y), float(z)
        self._context.change_view(lambda v: replace(self._select(v), move_target=place))
        self._context.send_debounced("point", lambda: MovePathPoint(index, place), event)

    def _halfway(self) -> InsertPathPoint:
        """Return the command that puts a point between this one and the next."""
        index, corners = self._index(), corners_of(self._session)
        x, y, z = (float(part) for part in corners[index : index + 2].mean(axis=0))
        return InsertPathPoint(index, (x, y, z))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the path, and which of its points is held."""
        self._session = new.session
        corners, smooth = corners_of(new.session), new.session.results.smoothing
        fresh = smooth is not None and new.step("smoothing").state != "stale"
        self._folder.visible = fresh and not new.busy
        if not len(corners) or not changed(old, new, *FOLLOWED):
            return
        self._number.max = len(corners)
        held = held_point(new.view, new.session)
        if held is not None:
            self._number.value = held + 1
        elif self._index() >= len(corners):
            self._number.value = len(corners)
        index = self._index()
        self._form.show({"point_base_mm": tuple(np.round(corners[index], 2).tolist())})
        self._insert.disabled = index == len(corners) - 1
        self._delete.disabled = len(corners) < 3
        self._list.content = listed(corners, held)


def listed(corners_base: Any, held: int | None) -> str:
    """Return points (k, 3) as a table; the one that is held is marked."""
    rows = (
        (f"{number + 1}{' ◂' if number == held else ''}", *(f"{part:.1f}" for part in corner))
        for number, corner in enumerate(corners_base)
    )
    return style.table(("n", "n", "n", "n"), ("No.", "x (mm)", "y (mm)", "z (mm)"), rows)
