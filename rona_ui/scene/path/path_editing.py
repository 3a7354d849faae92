"""Path editing by mouse in steps 5 and 6: path points, pattern centre and boundary.

A click gives a ray. It is intersected with the measured surface, not with the drawn skull, so that
the true shape never enters the path.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from rona_core.app.steps.path.messages import (
    DeletePathPoint,
    InsertPathPoint,
    MovePathPoint,
    PaintRegion,
    PinPathSample,
)
from rona_core.app.steps.path.step import is_kept, nearest_piece, nearest_point, sight
from rona_core.errors import InvalidInputError, RonaError
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.session.document import Session
from rona_ui.presentation.colors import PURPLE, SKY, YELLOW, Rgb
from rona_ui.presentation.mouse_input import corners_of, extended, held_place, held_point, holding
from rona_ui.presentation.snapshot import Snapshot, changed
from rona_ui.presentation.view_state import PAINTING, Point, ViewState
from rona_ui.scene.layer import Layer, lift
from rona_ui.scene.viser_nodes import NO_LINES, segments

LIFT_MM = 2.0
MARK_MM = 1.4
MOVED_POINT, MOVE_TARGET = "/edit/grabbed", "/edit/place"
BOUNDARY, CENTER = "/pattern/boundary", "/pattern/center"
MARKS = ("view.drawing", "view.moved_point", "view.move_target", "view.center", "view.boundary")


def point_at(
    session: Session, view: ViewState, eye_base: Vector3, ray: Vector3, phase: str
) -> tuple[ViewState, Any | None]:
    """Return the view after a click on the skull, and the command to send, or None.

    Args:
        session: As it is now.
        view: Its ``drawing`` says what is being done.
        eye_base: Where the eye is (3,), mm.
        ray: Direction of sight (3,).
        phase: "click", or "start", "update" and "end" of a drag.

    Raises:
        RonaError: there is nothing at this place; it says what to do.
    """
    if view.drawing == "move":
        return _move(session, view, eye_base, ray, phase)
    if view.drawing == "boundary":
        if phase == "end":
            return view, None
        corner = _point(sight(session, eye_base, ray))
        return replace(view, boundary=extended(view.boundary, corner)), None
    if view.drawing in PAINTING:
        return _paint(session, view, eye_base, ray, phase)
    if phase not in ("click", "end"):
        return view, None
    if view.drawing == "center":
        return replace(view, center=_point(sight(session, eye_base, ray)), drawing=None), None
    if view.drawing == "pair":
        return replace(view, pair_place=_point(sight(session, eye_base, ray)), drawing=None), None
    if view.drawing == "insert":
        place = sight(session, eye_base, ray)
        after = nearest_piece(corners_of(session), place)
        return view, InsertPathPoint(after, _point(place), _point(eye_base))
    if view.drawing == "delete":
        return view, DeletePathPoint(_found(corners_of(session), eye_base, ray))
    if view.drawing == "pin" and session.results.path is not None:
        sample = _found(session.results.path.value.points_base, eye_base, ray)
        return view, PinPathSample(sample, not is_kept(session, sample))
    return view, None


def _paint(
    session: Session, view: ViewState, eye_base: Vector3, ray: Vector3, phase: str
) -> tuple[ViewState, Any | None]:
    """One drag is one stroke; so is a click."""
    begun = view.stroke if phase in ("update", "end") else ()
    try:
        stroke = extended(begun, _point(sight(session, eye_base, ray)))
    except RonaError:  # beside the surface: reported only if nothing else was painted
        if phase == "click" or (phase == "end" and not begun):
            raise
        stroke = begun
    if phase in ("start", "update"):
        return replace(view, stroke=stroke), None
    kind = PAINTING[view.drawing or ""]
    return replace(view, stroke=()), PaintRegion(kind, stroke, view.brush_mm)


def _move(
    session: Session, view: ViewState, eye_base: Vector3, ray: Vector3, phase: str
) -> tuple[ViewState, Any | None]:
    """Two clicks, or one drag: from a point to its new place."""
    if phase == "start" or (phase == "click" and view.moved_point is None):
        return holding(view, session, _found(corners_of(session), eye_base, ray)), None
    held = held_point(view, session)
    if held is None:
        return view, None
    if phase == "update":
        try:
            return replace(view, move_target=_point(sight(session, eye_base, ray))), None
        except RonaError:  # beside the surface: reported only if it is let go there
            return replace(view, move_target=None), None
    let_go = replace(view, moved_point=None, move_target=None, held_path=None)
    try:
        place = _point(sight(session, eye_base, ray))
    except RonaError:
        if phase == "end":
            return let_go, None
        raise
    return let_go, MovePathPoint(held, place, _point(eye_base))


def _found(points: Floats, eye_base: Vector3, ray: Vector3) -> int:
    number = nearest_point(points, eye_base, ray)
    if number is None:
        raise InvalidInputError("no point of the path lies there: point nearer to one")
    return number


def _point(place: Vector3) -> Point:
    x, y, z = (float(part) for part in place)
    return x, y, z


class EditLayer(Layer):
    """Draws the point being moved, and centre and boundary of a pattern."""

    layer = "path"

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Follow the view."""
        view = new.view
        if changed(old, new, "static_scene", "session", *MARKS):
            corners = corners_of(new.session)
            held = held_point(view, new.session)
            up = lift(new, LIFT_MM)
            self._mark(MOVED_POINT, None if held is None else corners[held], YELLOW, up)
            self._mark(MOVE_TARGET, held_place(view, new.session), SKY, up)
            ring = np.array(view.boundary, dtype=np.float64).reshape(-1, 3)
            closed = np.vstack((ring, ring[:1])) + up
            pairs = segments(closed) if len(ring) > 1 else NO_LINES
            self.nodes.lines(BOUNDARY, pairs, PURPLE, width_px=4.0)
            self._mark(CENTER, view.center, PURPLE, up)
        for node in (BOUNDARY, CENTER):
            self.nodes.show(node, self.shown(new) and (view.step == "path" or view.all_layers))

    def _mark(self, node: str, place: object, color: Rgb, up: Vector3) -> None:
        points = np.array([] if place is None else [place], dtype=np.float64).reshape(-1, 3)
        self.nodes.cloud(node, points + up, color, size_mm=MARK_MM)
