"""What somebody adds to the room: kept and refused by name; the robot keeps away from it."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import obstacles_of, stale_reason
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.setup.clearance import clearance_violations, drawn_obstacles
from rona_core.app.steps.setup.messages import AddObstacle, RemoveObstacle, SetRobot, SetWorkcell
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.session.document import Session
from tests.helpers.session_file import reopened
from tests.scenes import demo_parts

WALL = AddObstacle("wall", (0.0, -1200.0, 0.0), (3000.0, 100.0, 2500.0))
LAMP = AddObstacle("lamp", (600.0, 200.0, 900.0), (300.0, 200.0, 80.0), 45.0)


def nothing_fresh(name):
    return False


def around(session):
    return obstacles_of(session, nothing_fresh)


def test_a_box_is_put_where_it_was_said_and_changed_by_its_name():
    session = handle(LAMP, handle(WALL, Session()))
    assert [thing.name for thing in around(session).things][-2:] == ["wall", "lamp"]
    lamp = next(thing for thing in drawn_obstacles(session) if thing.name == "lamp")
    corners = lamp.mesh.vertices - LAMP.center_mm
    turned = np.deg2rad(45.0)
    along = corners @ (np.cos(turned), np.sin(turned), 0.0)
    across = corners @ (-np.sin(turned), np.cos(turned), 0.0)
    np.testing.assert_allclose(np.abs(along), 150.0)
    np.testing.assert_allclose(np.abs(across), 100.0)
    np.testing.assert_allclose(np.abs(corners[:, 2]), 40.0)
    moved = handle(replace(WALL, center_mm=(0.0, -2000.0, 0.0)), session)
    boxes = moved.setup.surroundings.boxes
    assert [box.name for box in boxes] == ["wall", "lamp"]
    assert boxes[0].center_mm == (0.0, -2000.0, 0.0)
    gone = handle(RemoveObstacle("wall"), moved)
    assert [box.name for box in gone.setup.surroundings.boxes] == ["lamp"]


def test_a_box_stays_where_it_is_when_the_base_of_the_robot_is_moved():
    session = handle(WALL, Session())
    moved = handle(SetRobot(base_shift_mm=(100.0, 0.0, 0.0), base_turn_deg=90.0), session)
    wall = around(moved).things[-1]
    np.testing.assert_allclose(wall.pose.translation, (-1200.0, 100.0, 0.0), atol=1e-9)
    np.testing.assert_allclose(wall.pose.rotation @ (1.0, 0.0, 0.0), (0.0, -1.0, 0.0), atol=1e-12)


def test_the_robot_keeps_away_from_a_box_by_the_margin_that_was_said():
    home = np.zeros(6)
    free = clearance_violations(handle(WALL, Session()), home)
    assert not any(pair.too_close for pair in free)
    close = handle(AddObstacle("cupboard", (0.0, 0.0, 500.0), (300.0, 300.0, 500.0)), Session())
    hit = [pair for pair in clearance_violations(close, home) if pair.too_close]
    assert {pair.second for pair in hit} == {"cupboard"}
    room = {p.first: p.distance_mm for p in hit}["elbow"]
    assert 0.0 < room < 20.0, "not touched, but nearer than the margin"
    less = handle(SetWorkcell(margin_mm=room - 1.0), close)
    left = {pair.first for pair in clearance_violations(less, home) if pair.too_close}
    assert left
    assert "elbow" not in left


def test_the_room_is_changed_as_a_whole_and_keeps_its_boxes():
    session = handle(SetWorkcell(table=False, floor_mm=-400.0), handle(WALL, Session()))
    held = session.setup.surroundings
    assert (held.table, held.floor_mm, len(held.boxes)) == (False, -400.0, 1)
    assert [thing.name for thing in around(session).things] == ["head", "floor", "wall"]


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"name": ""}, "name must be 1 to 40 letters"),
        ({"name": "a/b"}, "name must be 1 to 40 letters"),
        ({"name": "<b>"}, "name must be 1 to 40 letters"),
        ({"name": "x" * 41}, "name must be 1 to 40 letters"),
        ({"name": "Table"}, "there already"),
        ({"name": "tracker stand"}, "there already"),
        ({"size_mm": (0.0, 10.0, 10.0)}, "size_mm must be 1 to 5000"),
        ({"size_mm": (10.0, -10.0, 10.0)}, "size_mm must be 1 to 5000"),
        ({"center_mm": (0.0, 6000.0, 0.0)}, "center_mm must be -5000 to 5000"),
        ({"center_mm": (0.0, float("nan"), 0.0)}, "center_mm must be -5000 to 5000"),
        ({"turn_deg": 181.0}, "turn_deg"),
    ],
)
def test_what_is_no_box_is_refused_by_name(parts, words):
    with pytest.raises(InvalidInputError, match=words):
        replace(WALL, **parts)


def test_a_box_is_renamed_in_its_place_or_stays_as_it_was():
    session = handle(LAMP, handle(WALL, Session()))
    renamed = handle(replace(WALL, name="north wall", instead_of="wall"), session)
    assert [box.name for box in renamed.setup.surroundings.boxes] == ["north wall", "lamp"]
    with pytest.raises(InvalidInputError, match="names of their own"):
        handle(replace(WALL, name="lamp", instead_of="wall"), session)
    with pytest.raises(NotFoundError, match="no obstacle 'door' to change; added: wall, lamp"):
        handle(replace(WALL, instead_of="door"), session)


def test_too_many_boxes_and_boxes_that_are_not_there_are_refused():
    session = Session()
    for i in range(20):
        session = handle(replace(WALL, name=f"wall {i}"), session)
    with pytest.raises(InvalidInputError, match="at most 20"):
        handle(replace(WALL, name="one more"), session)
    with pytest.raises(NotFoundError, match="no obstacle 'door'"):
        handle(RemoveObstacle("door"), session)
    with pytest.raises(InvalidInputError, match="margin_mm"):
        SetWorkcell(margin_mm=-1.0)


def test_a_new_box_makes_a_plan_stale_and_taking_it_away_makes_it_good_again():
    session = demo_parts.demo()
    assert stale_reason("roll", session) is None
    with_wall = handle(WALL, session)
    assert "what stands around the robot was changed" in stale_reason("roll", with_wall)
    assert stale_reason("tool", with_wall) is None, "what was measured stays"
    assert stale_reason("roll", handle(RemoveObstacle("wall"), with_wall)) is None


def test_boxes_are_saved_with_the_session():
    session = handle(LAMP, handle(WALL, Session()))
    again = reopened(session)
    assert again.setup == session.setup
