"""A base that stands too far away: the search is stored, applied by a command, and helps."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.app.dependencies.staleness import session_obstacles, stale_reason, workcell_pose
from rona_core.app.procedure import run_procedure, stages
from rona_core.app.runtime.session_step import Undo, replay
from rona_core.app.steps.roll.derivation import obstacles_from
from rona_core.app.steps.roll.messages import ApplyBasePlacement, StartBasePlacement
from rona_core.app.steps.roll.step import advice, moves, placement_view
from rona_core.app.steps.setup.messages import SetContact, SetRobot
from rona_core.compose import evaluate_virtual, new_workbench
from rona_core.devices.settings import ContactSettings
from rona_core.errors import (
    InvalidInputError,
    NotReachableError,
    StaleResultError,
    StepBlockedError,
)
from rona_core.robot.base_placement.reachability import base_pose
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session

UP_TO_ROLL = stages("roll")


@pytest.fixture(scope="module")
def stuck():
    """A workbench whose robot stands 420 mm too far away, and how the procedure ended there."""
    bench = new_workbench(Session())
    bench.dispatch(SetRobot(base_shift_mm=(-420.0, 0.0, 0.0)))
    ending = run_procedure(bench, UP_TO_ROLL)
    yield bench, ending
    bench.close()


@pytest.mark.slow
def test_a_procedure_that_no_roll_can_follow_names_the_move_that_helps(stuck):
    bench, ending = stuck
    found = bench.session.results.placement.value
    assert (ending.completed, ending.failed_step) == (False, "roll")
    assert "Move the robot base" in ending.reason
    assert found.smallest.sentence in ending.reason
    assert found.best.sentence in ending.reason
    assert 0.0 < found.smallest.moved_mm <= found.best.moved_mm


@pytest.mark.slow
def test_the_figures_of_a_robot_too_far_away_say_so(stuck):
    bench, _ = stuck
    figures = evaluate_virtual(bench.session, bench.rig())
    assert (figures["completed"], figures["rolls_feasible"]) == (False, 0)
    assert figures["outer_rms_mm"] is None


@pytest.mark.slow
def test_the_search_is_kept_in_the_file_and_follows_from_the_captures(stuck, tmp_path):
    session = load_session(save_session(stuck[0].session, tmp_path / "far.rona"))
    same = {row.result: row.same for row in replay(session)}
    assert same["placement"]


@pytest.mark.slow
def test_a_place_is_drawn_where_the_base_will_stand(stuck):
    session = stuck[0].session
    view, place = placement_view(session), session.results.placement.value.smallest
    old = base_pose((-420.0, 0.0, 0.0), 0.0)
    there = old @ view.smallest
    np.testing.assert_allclose(there.translation, place.shift_mm, atol=1e-9)
    assert view.margins.shape == (len(view.x_mm), len(view.y_mm))


@pytest.mark.slow
def test_the_base_is_moved_by_a_command_and_then_the_scan_is_certified(stuck):
    bench, _ = stuck
    before = bench.session
    place = before.results.placement.value.smallest
    bench.dispatch(SetContact(force_n=2.5))
    bench.dispatch(ApplyBasePlacement("smallest"))
    robot = bench.session.setup.devices.robot
    assert (robot.base_shift_mm, robot.base_turn_deg) == (place.shift_mm, place.turn_deg)
    assert robot.contact.force_n == 2.5  # as it was
    assert placement_view(bench.session) is None
    for name in ("tool", "surface", "path", "roll", "placement"):
        assert stale_reason(name, bench.session) is not None, name
    assert stale_reason("pointer", bench.session) is None
    with pytest.raises(StaleResultError, match="look for a place"):
        bench.dispatch(ApplyBasePlacement("best"))
    bench.dispatch(Undo())
    assert bench.session.setup.devices.robot.base_shift_mm == (-420.0, 0.0, 0.0)
    assert placement_view(bench.session) is not None
    bench.dispatch(ApplyBasePlacement("smallest"))
    assert run_procedure(bench, UP_TO_ROLL).completed
    assert bench.session.results.roll.value.may_move
    bench.run(StartBasePlacement(half_x_mm=0.0, half_y_mm=0.0))
    found = bench.session.results.placement.value
    assert not moves(found.smallest)
    assert "may stay" in advice(found)
    with pytest.raises(NotReachableError, match="works from there"):
        bench.dispatch(ApplyBasePlacement("smallest"))


def test_what_stands_around_keeps_its_place_in_the_room():
    session = Session()
    old = session_obstacles(session)
    robot = replace(
        session.setup.devices.robot, base_shift_mm=(120.0, -60.0, 30.0), base_turn_deg=25.0
    )
    devices = replace(session.setup.devices, robot=robot)
    moved = session_obstacles(replace(session, setup=replace(session.setup, devices=devices)))
    seen = obstacles_from(old, workcell_pose(robot))
    for there, here in zip(moved.things, seen.things, strict=True):
        np.testing.assert_allclose(there.pose.translation, here.pose.translation, atol=1e-9)
        if there.name == "table":  # the others are round about the vertical, or endless
            np.testing.assert_allclose(there.pose.matrix(), here.pose.matrix(), atol=1e-9)
        assert (there.name, there.margin_mm) == (here.name, here.margin_mm)


def test_a_place_is_not_searched_nor_taken_before_there_is_a_path():
    bench = new_workbench(Session())
    try:
        with pytest.raises(StepBlockedError, match="smooth the path"):
            bench.run(StartBasePlacement())
        with pytest.raises(StepBlockedError, match="look for a place"):
            bench.dispatch(ApplyBasePlacement())
    finally:
        bench.close()


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"step_mm": 1.0}, "step_mm"),
        ({"half_x_mm": -1.0}, "half_x_mm"),
        ({"levels_mm": ()}, "levels_mm must have 1 to 20"),
        ({"levels_mm": (5000.0,)}, "levels_mm"),
        ({"half_x_mm": 2000.0, "half_y_mm": 2000.0, "step_mm": 25.0}, "too many"),
    ],
)
def test_a_search_without_end_or_sense_is_refused(wrong, words):
    with pytest.raises(InvalidInputError, match=words):
        StartBasePlacement(**wrong)


def test_contact_is_set_apart_from_the_arm_and_checked():
    bench = new_workbench(Session())
    try:
        bench.dispatch(SetContact(force_n=4.0, monitor_n=9.0))
        bench.dispatch(SetRobot(model="ur5"))
        contact = bench.session.setup.devices.robot.contact
        assert contact == ContactSettings(force_n=4.0, monitor_n=9.0)
        bench.dispatch(SetContact(pressed=False))
        assert bench.session.setup.devices.robot.contact is None
        assert bench.session.setup.devices.robot.model == "ur5"
    finally:
        bench.close()
    with pytest.raises(InvalidInputError, match="monitor_n"):
        SetContact(force_n=8.0, monitor_n=5.0)
