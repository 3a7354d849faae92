"""The smoothed path of step 6: beside the original, and its points by number."""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.path.messages import DeletePathPoint, InsertPathPoint, MovePathPoint
from rona_core.app.steps.smoothing.path_view import PathView
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_ui.panels.widgets import style
from rona_ui.panels.widgets.form import Form, PanelContext, on_change, on_click
from rona_ui.presentation.colors import BLUE, css, viridis
from rona_ui.presentation.mouse_input import corners_of, held_point, holding
from rona_ui.presentation.snapshot import Snapshot, changed, shown_path, shown_path_key
from rona_ui.presentation.view_state import ViewState

WIDTH, HEIGHT, MARGIN = 170.0, 190.0, 8.0  # of one graph, in pixels
MOST_DOTS = 900  # drawn of the original
EMPTY = "The demonstrated and the simplified path appear here after step 6."


class PathGraph:
    """Two graphs to the same scale; the original by its deviation, the smoothed with its points."""

    def __init__(self, gui: Any) -> None:
        self._html = gui.add_html(style.text(EMPTY))

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the path, and the bound while it is dragged."""
        if old is not None and shown_path_key(old) == shown_path_key(new):
            return
        view = shown_path(new)
        self._html.content = style.text(EMPTY) if view is None else graph(view)


def graph(view: PathView) -> str:
    """Return both graphs with their words and the colour bar."""
    points = np.concatenate((view.raw_patch, view.corners_patch))
    low, high = points.min(axis=0), points.max(axis=0)
    room = np.array((WIDTH, HEIGHT)) - 2.0 * MARGIN
    scale = float((room / np.maximum(high - low, 1e-6)).min())
    middle = 0.5 * (low + high)

    def pixels(points: Floats, left: float) -> Floats:
        at = scale * (points - middle) * (1.0, -1.0)
        return np.add(at, (left + WIDTH / 2.0, HEIGHT / 2.0))

    every = 1 + len(view.raw_patch) // MOST_DOTS
    raw, smooth = pixels(view.raw_patch[::every], 0.0), pixels(view.corners_patch, WIDTH)
    colors = viridis(view.from_raw_mm[::every] / max(view.tolerance_mm, 1e-9))
    dots = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.5" fill="rgb({r},{g},{b})"/>'
        for (x, y), (r, g, b) in zip(raw, colors.tolist(), strict=True)
    )
    corners = "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.2" fill="{css(BLUE)}"/>' for x, y in smooth
    )
    about = "about " if view.preview else ""
    title = f"{len(view.raw_patch)} points before, {about}{len(view.corners_base)} after smoothing"
    return (
        f'<div style="padding:0 12px"><svg viewBox="0 0 {2 * WIDTH:.0f} {HEIGHT:.0f}" '
        f'width="100%" role="img" aria-label="{title}">'
        f"{_line(raw, '#c9d1d9', 1.0)}{dots}{_line(smooth, css(BLUE), 1.4)}{corners}"
        f"{_ruler(scale)}</svg></div>"
        f'<div class="r-ticks"><span>Original: {len(view.raw_patch)} points</span>'
        f"<span>Smoothed: {about}{len(view.corners_base)} points</span></div>"
        + deviation_bar("Deviation of the original from the smoothed path (mm)", view.tolerance_mm)
    )


def deviation_bar(title: str, high: float) -> str:
    """Return the colour bar from 0 to ``high`` with its limits."""
    return style.color_bar(title, "0", f"{high / 2:.2g}", f"≥ {high:.2g}")


def _line(points: Floats, color: str, width: float) -> str:
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polyline points="{places}" fill="none" stroke="{color}" stroke-width="{width}"/>'


def _ruler(scale: float) -> str:
    """Return a bar of 10 mm as a measure."""
    x, y = MARGIN, HEIGHT - 4.0
    return (
        f'<line x1="{x}" y1="{y}" x2="{x + 10.0 * scale:.1f}" y2="{y}" stroke="#3e4c59" '
        f'stroke-width="2"/><text x="{x}" y="{y - 4.0}" font-size="9" fill="#3e4c59">10 mm</text>'
    )


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
