"""Points of the smoothed path by number, and one that is moved by the arrow keys."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.runtime.handling import handle
from rona_core.app.steps.path.messages import DeletePathPoint, InsertPathPoint, MovePathPoint
from rona_core.errors import DegenerateGeometryError
from rona_ui.panels.path.smoothed_path import PathPoints
from rona_ui.presentation.camera import CameraPose
from rona_ui.presentation.mouse_input import (
    corners_of,
    held_move,
    held_place,
    held_point,
    holding,
    nudged,
)
from rona_ui.presentation.view_state import ViewState
from rona_ui.scene.path.path import point_at
from tests.helpers.ui.fake_gui import FakeGui
from tests.ui.panels.test_panels import CLIENT, Recorder, snapshot

VIEW = ViewState(step="smoothing")


@pytest.fixture(scope="module")
def camera(demo):
    """Somebody looks down on the region, x of the base to the right."""
    middle = corners_of(demo).mean(axis=0)
    return CameraPose(middle + (0.0, 0.0, 300.0), middle, np.array((0.0, 1.0, 0.0)))


def panel_at(demo, view=VIEW):
    gui, recorder = FakeGui(), Recorder()
    recorder.shown = view
    panel = PathPoints(gui, recorder.context)
    panel.render(None, snapshot(demo, view=view))
    return gui, recorder, panel


def test_all_points_are_listed_and_one_is_chosen_by_its_number(demo):
    gui, recorder, panel = panel_at(demo)
    count = len(corners_of(demo))
    assert gui.html().count("<tr>") == count + 1
    number = gui.find("number", "Point no.")
    assert number.max == count
    number.value = 5
    number.happen(CLIENT)
    assert (recorder.shown.drawing, recorder.shown.moved_point) == ("move", 4)
    panel.render(snapshot(demo, view=VIEW), snapshot(demo, view=recorder.shown))
    assert "5 ◂" in gui.html()
    place = gui.find("vector3", "Position (mm)").value
    np.testing.assert_allclose(place, corners_of(demo)[4], atol=0.006)


def test_a_path_that_is_shown_takes_hold_of_no_point(demo):
    gui, recorder, panel = panel_at(demo)
    fewer = handle(DeletePathPoint(0), demo)  # the place of the first point is another now
    panel.render(snapshot(demo, view=VIEW), snapshot(fewer, view=VIEW))
    place = gui.find("vector3", "Position (mm)").value
    np.testing.assert_allclose(place, corners_of(fewer)[0], atol=0.006)
    assert recorder.shown == VIEW
    assert recorder.sent == []


def test_a_point_is_moved_inserted_and_deleted_by_number(demo):
    gui, recorder, _ = panel_at(demo, holding(VIEW, demo, 4))
    assert gui.find("number", "Point no.").value == 5
    place = gui.find("vector3", "Position (mm)")
    place.value = tuple(corners_of(demo)[4] + (1.0, 0.0, 0.0))
    place.happen(CLIENT)
    gui.find("button", "Insert point after").happen(CLIENT)
    gui.find("button", "Delete this point").happen(CLIENT)
    moved, inserted, deleted = recorder.sent
    assert isinstance(moved, MovePathPoint)
    assert moved.index == 4
    assert isinstance(inserted, InsertPathPoint)
    assert inserted.after == 4
    halfway = corners_of(demo)[4:6].mean(axis=0)
    np.testing.assert_allclose(inserted.point_base_mm, halfway)
    assert deleted == DeletePathPoint(4)
    after = handle(moved, demo)
    changed = np.linalg.norm(corners_of(after) - place.value, axis=1).min()
    assert changed < 0.5  # on the measured surface beside it


def test_a_click_moves_the_held_point_also_when_its_number_has_changed(demo, camera):
    view = holding(VIEW, demo, 6)
    for _ in range(6):
        view = nudged(view, demo, camera, "up")
    after = handle(held_move(view), demo)
    fewer = handle(DeletePathPoint(0), after)
    place = corners_of(demo)[10]
    ray = place - camera.eye_base
    let_go, moved = point_at(fewer, view, camera.eye_base, ray, "click")
    assert moved.index == held_point(view, fewer) != view.moved_point
    assert (let_go.moved_point, let_go.move_target, let_go.held_path) == (None, None, None)
    again, _ = point_at(
        fewer, view, camera.eye_base, corners_of(fewer)[3] - camera.eye_base, "start"
    )
    assert held_point(again, fewer) == 3


def test_nothing_goes_behind_the_last_point_and_a_path_keeps_two(demo):
    last = len(corners_of(demo)) - 1
    gui, _, _ = panel_at(demo, holding(VIEW, demo, last))
    assert gui.find("button", "Insert point after").disabled
    assert not gui.find("button", "Delete this point").disabled


def test_arrow_keys_move_the_held_point_across_the_picture_and_on_the_surface(demo, camera):
    begun = corners_of(demo)[6]
    for nudge, way, step in (
        ("right", (1, 0), 0.5),
        ("up", (0, 1), 0.5),
        ("fine left", (-1, 0), 0.1),
    ):
        view = nudged(holding(VIEW, demo, 6), demo, camera, nudge)
        off = np.subtract(view.move_target, begun)[:2]
        assert np.linalg.norm(off - step * np.array(way)) < 0.6 * step
        assert off @ way > 0.4 * step
    twice = nudged(nudged(holding(VIEW, demo, 6), demo, camera, "right"), demo, camera, "right")
    assert np.subtract(twice.move_target, begun)[0] > 0.7
    assert held_move(twice) == MovePathPoint(6, twice.move_target)


def test_nothing_held_or_taken_back_is_no_command(demo, camera):
    assert nudged(VIEW, demo, camera, "left") == VIEW
    assert held_move(VIEW) is None
    moved = nudged(holding(VIEW, demo, 6), demo, camera, "left")
    assert held_move(replace(moved, drawing=None)) is None
    assert held_move(replace(moved, move_target=None)) is None


def test_after_a_move_the_same_point_is_held_whatever_its_number(demo, camera):
    view = holding(VIEW, demo, 6)
    for _ in range(6):
        view = nudged(view, demo, camera, "up")
    after = handle(held_move(view), demo)
    held = held_point(view, after)
    np.testing.assert_allclose(corners_of(after)[held], view.move_target, atol=1e-6)
    again = nudged(view, after, camera, "up")
    assert again.moved_point == held
    fewer = handle(DeletePathPoint(0), after)
    assert np.linalg.norm(corners_of(fewer)[held_point(view, fewer)] - view.move_target) < 1e-6


def test_after_undo_the_keys_go_on_from_where_the_point_is(demo, camera):
    view = holding(VIEW, demo, 6)
    for _ in range(6):
        view = nudged(view, demo, camera, "up")
    assert held_place(view, demo) == view.move_target
    after = handle(held_move(view), demo)
    assert held_place(view, after) is None  # the point is there
    undone = replace(
        after, results=replace(after.results, smoothing=replace(demo.results.smoothing))
    )
    again = nudged(view, undone, camera, "up")
    assert np.linalg.norm(np.subtract(again.move_target, corners_of(demo)[again.moved_point])) < 1.0


def test_beyond_the_measured_surface_there_is_no_place(demo, camera):
    far = corners_of(demo)[0] + (0.0, 80.0, 0.0)
    view = replace(holding(VIEW, demo, 0), move_target=tuple(far))
    with pytest.raises(DegenerateGeometryError, match="slide the pointer there first"):
        nudged(view, demo, camera, "up")
