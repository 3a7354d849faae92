"""What clicks and drags on the skull make: strokes, and where the pointer is lifted."""

from dataclasses import replace

from rona_core.app.steps.surface.messages import MAX_PICKS
from rona_ui.presentation.mouse_input import (
    lifted,
    may_lift,
    n_strokes,
    starts,
    with_pick,
    without_last_pick,
)
from rona_ui.presentation.view_state import ViewState

SURFACE = ViewState(step="surface", drawing="surface")


def dragged(view: ViewState, first: float, count: int = 3) -> ViewState:
    """Return the view after a drag over places 2 mm apart."""
    for number in range(count):
        place = (first + 2.0 * number, 0.0, 0.0)
        view = with_pick(view, place, "update" if number else "start")
    return with_pick(view, (first + 2.0 * count, 0.0, 0.0), "end")


def test_each_drag_over_the_surface_is_a_stroke_and_clicks_go_on_with_it() -> None:
    view = dragged(dragged(SURFACE, 0.0), 20.0)
    assert starts(view) == (0, 4)
    view = with_pick(view, (40.0, 0.0, 0.0), "click")
    assert (len(view.picks), starts(view)) == (9, (0, 4))


def test_a_path_is_one_stroke() -> None:
    view = dragged(dragged(ViewState(step="path", drawing="path"), 0.0), 20.0)
    assert (len(view.picks), starts(view)) == (8, (0,))
    assert lifted(view) == view


def test_after_a_lift_the_next_click_begins_a_stroke_even_beside_the_last_point() -> None:
    view = lifted(dragged(SURFACE, 0.0))
    assert not may_lift(view)
    assert lifted(view) == view
    assert n_strokes(view) == 1  # nothing is in the second yet
    view = with_pick(view, (6.5, 0.0, 0.0), "click")
    assert starts(view) == (0, 4)


def test_a_point_taken_back_takes_its_lift_with_it() -> None:
    view = dragged(SURFACE, 0.0)
    second = with_pick(lifted(view), (20.0, 0.0, 0.0), "click")
    assert without_last_pick(second) == view
    assert may_lift(view)


def test_lifts_of_strokes_that_were_dropped_do_not_come_back() -> None:
    dropped = replace(dragged(dragged(SURFACE, 0.0), 20.0), picks=())
    assert n_strokes(dropped) == 0
    assert dragged(dropped, 0.0) == dragged(SURFACE, 0.0)


def test_no_more_points_than_can_be_sent() -> None:
    view = SURFACE
    for number in range(MAX_PICKS // 2):
        view = dragged(view, 10.0 * number)
    assert len(view.picks) == MAX_PICKS
    assert len(starts(view)) == MAX_PICKS // 4
