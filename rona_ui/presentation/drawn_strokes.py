"""Strokes drawn on the skull by mouse: picks, and where the pointer is lifted."""

from dataclasses import replace

import numpy as np

from rona_core.app.steps.surface.messages import MAX_PICKS
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
