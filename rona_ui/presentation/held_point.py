"""Point of the smoothed path that is held in the mode *Move*, by mouse, number or keys."""

from dataclasses import replace

import numpy as np

from rona_core.app.messages.message import Point
from rona_core.app.steps.path.messages import MovePathPoint
from rona_core.app.steps.path.step import place_on_surface
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.session.document import Session
from rona_ui.presentation.camera import CameraPose
from rona_ui.presentation.view_state import ViewState

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
