"""What a page goes on with when it connects anew, and what it does not."""

from dataclasses import replace

from rona_ui.presentation.view_state import ViewState
from rona_ui.window.browser import KEPT, KeptViews, resumed_view

PICKS = ((1.0, 0.0, 0.0), (2.0, 0.0, 0.0))


def test_a_view_is_known_by_the_page_and_by_its_session() -> None:
    views = KeptViews()
    views.keep("a", 1, "session", ViewState(step="roll"))
    kept = views.of("a", "session")
    assert kept is not None
    assert kept.step == "roll"
    assert views.of("a", "another session") is None
    assert views.of("b", "session") is None


def test_a_connection_that_is_lost_keeps_nothing_once_there_is_a_later_one() -> None:
    views = KeptViews()
    for client_id, step in ((1, "roll"), (2, "scan"), (1, "path"), (2, "maps"), (1, "tool")):
        views.keep("a", client_id, "session", ViewState(step=step))
    kept = views.of("a", "session")
    assert kept is not None
    assert kept.step == "maps"


def test_only_the_latest_pages_are_kept() -> None:
    views = KeptViews()
    for number in range(KEPT):
        views.keep(f"page {number}", number, "session", ViewState())
    views.keep("page 0", 0, "session", ViewState())
    views.keep("one more", KEPT, "session", ViewState())
    assert views.of("page 1", "session") is None
    assert views.of("page 0", "session") is not None
    assert views.of("one more", "session") is not None


def test_what_has_a_field_in_the_docks_begins_anew() -> None:
    opened = ViewState(step="setup", open_tabs=frozenset(("Log",)))
    kept = replace(
        ViewState(),
        step="maps",
        hidden=frozenset(("outer", "inner", "milling", "robot")),
        cut_direction="lengthwise",
        cut_offset_mm=3.0,
        cut_maps=True,
        all_layers=True,
        quantity="outer",
        brush_mm=9.0,
        playing=True,
        dragged_boundary=(7, 16.4),
        drawing="paint_scan",
        stroke=PICKS,
    )
    view = resumed_view(opened, kept)
    assert view == replace(
        opened,
        step="maps",
        hidden=frozenset(("robot", "outer", "fused", "milling", "chance")),
        cut_direction="lengthwise",
        cut_offset_mm=3.0,
        cut_maps=True,
        all_layers=True,
    )


def test_a_stroke_goes_on_until_it_was_sent() -> None:
    drawn = ViewState(step="surface", drawing="surface", picks=PICKS, lifts=(1,))
    view = resumed_view(ViewState(), drawn)
    assert (view.drawing, view.picks, view.lifts) == ("surface", PICKS, (1,))
    assert not resumed_view(ViewState(), replace(drawn, drawing=None)).picks
