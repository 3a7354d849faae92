"""What the mouse draws and holds: strokes on the skull, a point of the path."""

from dataclasses import replace

import numpy as np

from rona_core.app.steps.path.messages import MovePathPoint
from rona_core.app.steps.path.step import place_on_surface
from rona_core.app.steps.surface.messages import MAX_PICKS
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.session.document import Session
from rona_ui.presentation.camera import CameraPose
from rona_ui.presentation.view_state import Drawing, Point, ViewState

LIFTED: Drawing = "surface"  # a path is one stroke: the probe stays on the bone
STROKES = ("surface", "path")  # drawn with the pointer itself
DRAG_STEP_MM = 1.5  # a drag adds a point once it has come so far


def extended(points: tuple[Point, ...], point: Point) -> tuple[Point, ...]:
    """Return points with one more, unless it is too near to the last or there are too many."""
    near = bool(points) and np.linalg.norm(np.subtract(points[-1], point)) < DRAG_STEP_MM
    return points if near or len(points) >= MAX_PICKS else (*points, point)


def with_pick(view: ViewState, point: Point, phase: str) -> ViewState:
    """Return the view with one point more in what is drawn.

    Args:
        view: Drawing.
        point: On the skull, in ``base``.
        phase: "click", or "start", "update" and "end" of a drag; its start lifts the pointer.
    """
    if not view.picks:
        view = replace(view, lifts=())
    elif phase == "start":
        view = lifted(view)
    begun = view.lifts[-1] if view.lifts else 0
    stroke = extended(view.picks[begun:], point)
    return replace(view, picks=(*view.picks[:begun], *stroke)[:MAX_PICKS])


def lifted(view: ViewState) -> ViewState:
    """Return the view with the next pick beginning a new stroke, where strokes may be several."""
    if not may_lift(view):
        return view
    return replace(view, lifts=(*view.lifts, len(view.picks)))


def may_lift(view: ViewState) -> bool:
    """Return whether the pointer touches the bone and may be lifted."""
    touches = len(view.picks) > (view.lifts[-1] if view.lifts else 0)
    return view.drawing == LIFTED and touches


def without_last_pick(view: ViewState) -> ViewState:
    """Return the view with one point less in what is drawn; a lift after it is taken back too."""
    picks = view.picks[:-1]
    return replace(view, picks=picks, lifts=tuple(n for n in view.lifts if n < len(picks)))


def n_strokes(view: ViewState) -> int:
    """Return how many strokes have a point."""
    return len(starts(view))


def starts(view: ViewState) -> tuple[int, ...]:
    """Return the number of the first pick of each stroke."""
    return tuple(n for n in (0, *view.lifts) if n < len(view.picks))


def without_mode(view: ViewState) -> ViewState:
    """Return the view without drawing or editing; a line that was begun can be gone on with."""
    picks = view.picks if view.drawing in STROKES or view.drawing is None else ()
    return replace(
        view,
        drawing=None,
        picks=picks,
        stroke=(),
        moved_point=None,
        move_target=None,
        held_path=None,
        dragged_boundary=None,
    )


WAYS = ("left", "right", "up", "down")
STEPS_MM = {"": 0.5, "fine ": 0.1}  # of one press, without and with Shift
NUDGES = {f"{how}{way}": (way, step) for how, step in STEPS_MM.items() for way in WAYS}


def across(camera: CameraPose, way: str) -> Vector3:
    """Return the unit vector (3,) in ``base`` that leads left, right, up or down in the picture."""
    forward = camera.target_base - camera.eye_base
    right = np.cross(forward, camera.up_base)
    axis = right if way in ("left", "right") else np.cross(right, forward)
    axis = axis / np.linalg.norm(axis)
    return -axis if way in ("left", "down") else axis


def corners_of(session: Session) -> Floats:
    """Return the points of the smoothed path (k, 3), none before there is one."""
    smooth = session.results.smoothing
    return np.zeros((0, 3)) if smooth is None else smooth.value.corners_base


def holding(view: ViewState, session: Session, number: int) -> ViewState:
    """Return the view in the mode *Move* with a point of the path (its number, from 0) held."""
    count = len(corners_of(session))
    held = min(max(number, 0), count - 1) if count else None
    smooth = session.results.smoothing
    return replace(view, drawing="move", moved_point=held, move_target=None, held_path=smooth)


def held_point(view: ViewState, session: Session) -> int | None:
    """Return the number of the point that is held; it may have another since the path was changed.

    The path is smoothed again after a move: the point is the one that lies where it was put.
    """
    corners = corners_of(session)
    if view.drawing != "move" or view.moved_point is None or not len(corners):
        return None
    if view.move_target is None or _counts(view, session):
        return min(view.moved_point, len(corners) - 1)
    return int(np.linalg.norm(corners - view.move_target, axis=1).argmin())


def held_place(view: ViewState, session: Session) -> Point | None:
    """Return where the held point is being moved to; None once the path was changed by it."""
    return view.move_target if view.drawing == "move" and _counts(view, session) else None


def _counts(view: ViewState, session: Session) -> bool:
    """Return whether the path is still the one that the number of the held point counts on."""
    return view.held_path is session.results.smoothing


def nudged(view: ViewState, session: Session, camera: CameraPose, nudge: str) -> ViewState:
    """Return the view with the held point a step further over the measured surface.

    ``nudge`` is one of ``NUDGES``.

    Raises:
        DegenerateGeometryError: no surface was measured there.
    """
    held = held_point(view, session)
    if held is None:
        return view
    way, step_mm = NUDGES[nudge]
    moved = held_place(view, session)
    begun = corners_of(session)[held] if moved is None else np.array(moved)
    x, y, z = (float(part) for part in begun + step_mm * across(camera, way))
    target: Point = place_on_surface((x, y, z), None, session)
    smooth = session.results.smoothing
    return replace(view, moved_point=held, move_target=target, held_path=smooth)


def held_move(view: ViewState) -> MovePathPoint | None:
    """Return the command that leaves the held point where it was moved by keys; None if nowhere."""
    if view.drawing != "move" or view.moved_point is None or view.move_target is None:
        return None
    return MovePathPoint(view.moved_point, view.move_target)
