"""Obstacles: plain values that can be stored and told apart; table, floor and tracker stand."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.settings import RobotSettings
from rona_core.devices.workcell import Surroundings, workcell_pose
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.obstacles import (
    NOTHING_AROUND,
    Box,
    Capsule,
    Hull,
    Obstacle,
    Obstacles,
    capsule_between,
    table_and_floor,
    tracker_stand,
)
from rona_core.session.codec import decode, digest, encode

PLACE_OF_WORK = (600.0, 60.0, 400.0)  # of the RX90, in the room

ROCK = np.array(((0, 0, 0), (50, 0, 0), (0, 50, 0), (0, 0, 50.0)))


def some():
    return Obstacles(
        (
            Obstacle("rock", Hull(ROCK), Pose.from_translation((1, 2, 3)), 10.0, 4.0),
            Obstacle("box", Box((1.0, 2.0, 3.0)), Pose.identity(), 0.0),
            capsule_between("pole", (0, 0, 0), (0, 100, 0), 20.0, 5.0),
        ),
        sentence="said by a test",
    )


def test_a_session_can_hold_them():
    arrays = {}
    plain = encode(some(), "obstacles", arrays)
    back = decode(plain, Obstacles, arrays)
    assert back.digest() == some().digest()
    assert digest(back) == digest(some())
    assert [type(thing.shape) for thing in back.things] == [Hull, Box, Capsule]


def test_every_change_of_shape_place_or_margin_changes_the_digest():
    base = some()
    rock, box, pole = base.things
    nudged = Pose.from_translation((1, 2, 3 + 2e-6))
    others = [
        replace(base, things=(rock, box)),
        replace(base, things=(box, rock, pole)),
        replace(base, things=(replace(rock, name="stone"), box, pole)),
        replace(base, things=(replace(rock, shape=Hull(ROCK * 1.000001)), box, pole)),
        replace(base, things=(replace(rock, pose=nudged), box, pole)),
        replace(base, things=(replace(rock, margin_mm=10.1), box, pole)),
        replace(base, things=(replace(rock, touch_mm=4.1), box, pole)),
        replace(base, things=(rock, replace(box, shape=Box((1.0, 2.0, 3.1))), pole)),
        replace(base, things=(rock, box, replace(pole, shape=Capsule(20.0, 101.0)))),
        replace(base, self_margin_mm=6.0),
        NOTHING_AROUND,
    ]
    digests = [one.digest() for one in (base, *others)]
    assert len(set(digests)) == len(digests)
    assert replace(base, sentence="said by another").digest() == base.digest()


def test_the_last_bits_of_another_processor_make_no_other_surroundings():
    base = some()
    rock, box, pole = base.things
    there = replace(rock, shape=Hull(ROCK * (1.0 + 1e-15)))
    elsewhere = replace(base, things=(there, box, pole))
    assert elsewhere.digest() == base.digest()
    assert base.digest() != replace(base, self_margin_mm=6.0).digest()


def test_a_capsule_lies_between_its_places():
    start, end = np.array((10.0, -20, 5)), np.array((-40.0, 60, 90))
    made = capsule_between("pole", start, end, 12.0, 5.0)
    half = np.array((0.0, 0.0, 0.5 * made.shape.length_mm))
    np.testing.assert_allclose(made.pose @ -half, start, atol=1e-9)
    np.testing.assert_allclose(made.pose @ half, end, atol=1e-9)
    ball = capsule_between("ball", start, start, 12.0, 5.0)
    assert ball.shape.length_mm == 0.0


def test_moving_the_base_moves_neither_table_nor_floor():
    robot = RobotSettings(base_shift_mm=(100.0, -50.0, 0.0), base_turn_deg=30.0)
    room = workcell_pose(robot)
    settings = Surroundings()
    first = table_and_floor(settings, Pose.identity(), PLACE_OF_WORK)
    then = table_and_floor(settings, room, PLACE_OF_WORK)
    moved_base = room.inv()  # the base in the room
    for before, after in zip(first, then, strict=True):
        in_room = moved_base @ after.pose
        np.testing.assert_allclose(in_room.matrix(), before.pose.matrix(), atol=1e-9)
    np.testing.assert_allclose(moved_base.translation, robot.base_shift_mm)
    table, floor = first
    top = table.pose.translation[2] + 0.5 * table.shape.size_mm[2]
    assert top == pytest.approx(PLACE_OF_WORK[2] - 175.0)
    assert floor.pose.translation[2] + 0.5 * floor.shape.size_mm[2] == settings.floor_mm
    assert [t.name for t in table_and_floor(replace(settings, table=False), room, (0, 0, 0))] == [
        "floor"
    ]


def test_the_tracker_stands_on_its_pole():
    T_base_tracker = Pose.from_rotvec((0.3, -2.0, 0.5), (2000.0, 500.0, 1200.0))
    cameras, pole = tracker_stand(Surroundings(), T_base_tracker)
    np.testing.assert_allclose(cameras.pose.translation, T_base_tracker.translation, atol=1e-9)
    along = cameras.pose.rotation[:, 2] @ T_base_tracker.rotation[:, 0]
    assert abs(along) == pytest.approx(1.0)
    np.testing.assert_allclose(pole.pose.translation, (2000.0, 500.0, 600.0))
    assert abs(pole.pose.rotation[2, 2]) == pytest.approx(1.0)


def test_nonsense_is_refused_by_name():
    with pytest.raises(InvalidInputError, match="at least 4 points"):
        Hull(ROCK[:3])
    with pytest.raises(DegenerateGeometryError, match="nearly in a plane"):
        Hull(ROCK * (1, 1, 0))
    with pytest.raises(InvalidInputError, match="size_mm must be positive"):
        Box((1.0, 0.0, 1.0))
    with pytest.raises(InvalidInputError, match="needs a radius"):
        Capsule(0.0, 10.0)
    with pytest.raises(InvalidInputError, match="margin_mm must be 0 to 1000"):
        replace(some().things[0], margin_mm=-1.0)
    with pytest.raises(InvalidInputError, match="touch_mm must be 0 to 100"):
        replace(some().things[0], touch_mm=-1.0)
    with pytest.raises(InvalidInputError, match="names of their own"):
        Obstacles((some().things[0], some().things[0]))
    with pytest.raises(InvalidInputError, match="self_margin_mm"):
        Obstacles((), self_margin_mm=-1.0)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("table_center_mm", (1e6, 0.0, 0.0)),
        ("table_size_mm", (0.0, 1.0, 1.0)),
        ("floor_mm", 9000.0),
        ("head_below_mm", 900.0),
        ("stand_radius_mm", 1.0),
        ("head_margin_mm", -1.0),
        ("margin_mm", 500.0),
        ("self_margin_mm", float("nan")),
    ],
)
def test_impossible_surroundings_are_refused(field, value):
    with pytest.raises(InvalidInputError, match=field):
        Surroundings(**{field: value})
