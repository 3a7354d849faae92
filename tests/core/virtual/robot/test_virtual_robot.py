"""The virtual robot and its true errors."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.settings import RobotSettings
from rona_core.errors import DeviceError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.trajectory.joint_moves import plan_joint_move
from rona_core.virtual.robot.accuracy_error import WORKSPACE_CENTER, WORKSPACE_SIZE, RobotError
from rona_core.virtual.robot.robot import VirtualRobot
from tests.helpers.strategies import angle_rad

RX90 = robot_model("rx90")
GOAL = RX90.home_rad + np.deg2rad((20, 10, -15, 30, 5, -40))


class FakeClock:
    def __init__(self):
        self.time_s = 0.0

    def now(self):
        return self.time_s

    def wait_until(self, time_s):
        self.time_s = max(self.time_s, time_s)


@pytest.fixture
def clock():
    return FakeClock()


@pytest.fixture
def robot(clock):
    robot = VirtualRobot(RX90, clock)
    robot.begin(RobotSettings(latency_ms=0.0), 0)
    return robot


@pytest.fixture
def move():
    return plan_joint_move(RX90.home_rad, GOAL, RX90)


def test_motion_is_a_function_of_time_however_often_somebody_looks(robot, clock, move):
    clock.time_s = 1.5
    motion = robot.move(move.times_s, move.qs_rad)
    for _ in range(2):
        for time_s in np.linspace(1.5, 1.5 + move.times_s[-1], 23):
            expected = [np.interp(time_s - 1.5, move.times_s, q) for q in move.qs_rad.T]
            np.testing.assert_allclose(robot.q_at(time_s), expected, atol=1e-14)
    np.testing.assert_array_equal(robot.q_at(0.0), RX90.home_rad)
    assert robot.state().moving
    assert not motion.done()
    assert motion.progress() == 0.0
    clock.time_s = 1.5 + move.times_s[-1] / 4
    assert motion.progress() == pytest.approx(0.25)
    clock.time_s = 99.0
    assert motion.done()
    assert motion.progress() == 1.0
    assert not robot.state().moving
    np.testing.assert_allclose(robot.state().q_rad, GOAL, atol=1e-15)
    assert robot.state().time_s == 99.0


def test_stop_freezes_the_robot_at_once_and_it_can_go_on_from_there(robot, clock, move):
    motion = robot.move(move.times_s, move.qs_rad)
    clock.time_s = move.times_s[-1] / 2
    robot.stop()
    here = robot.state().q_rad
    assert motion.done()
    share = motion.progress()
    assert share == pytest.approx(0.5)
    clock.time_s += 5.0
    robot.stop()
    np.testing.assert_array_equal(robot.state().q_rad, here)
    assert not robot.state().moving
    onwards = plan_joint_move(here, GOAL, RX90)
    second = robot.move(onwards.times_s, onwards.qs_rad)
    clock.time_s += onwards.times_s[-1] / 3
    assert motion.done()
    assert motion.progress() == share
    assert not second.done()
    clock.time_s += 60.0
    np.testing.assert_allclose(robot.state().q_rad, GOAL, atol=1e-12)


def test_a_new_capture_finds_the_robot_where_it_was(robot, clock, move):
    motion = robot.move(move.times_s, move.qs_rad)
    clock.time_s = 60.0
    clock.time_s = 0.0
    robot.begin(RobotSettings(), 1)
    np.testing.assert_allclose(robot.state().q_rad, GOAL, atol=1e-12)
    assert not robot.state().moving
    assert motion.done()
    robot.place(RX90.home_rad)
    np.testing.assert_array_equal(robot.state().q_rad, RX90.home_rad)


def test_what_must_not_be_driven_is_refused(robot, clock, move):
    with pytest.raises(DeviceError, match="joint 1 stands"):
        robot.move(move.times_s, move.qs_rad + np.array((0.01, 0, 0, 0, 0, 0)))
    robot.move(move.times_s, move.qs_rad + np.array((0.008, 0, 0, 0, 0, 0)))
    clock.time_s = 0.1
    with pytest.raises(DeviceError, match="still moving"):
        robot.move(move.times_s, move.qs_rad)
    clock.time_s = 60.0
    here = robot.state().q_rad
    beyond = np.linspace(here, here + np.deg2rad((0, 0, 0, 0, 140, 0)), 50)
    with pytest.raises(DeviceError, match="joint 5 would go to"):
        robot.move(np.arange(50.0), beyond)
    fast = np.linspace(here, here + np.deg2rad((50, 0, 0, 0, 0, 0)), 50)
    with pytest.raises(DeviceError, match="joint 1 would move at"):
        robot.move(np.linspace(0, 0.2, 50), fast)
    with pytest.raises(DeviceError, match="joint 2 would go to"):
        robot.place(np.deg2rad((0, 170, 0, 0, 0, 0)))
    with pytest.raises(DeviceError, match="not a ur5"):
        robot.begin(replace(RobotSettings(), model="ur5"), 2)
    np.testing.assert_array_equal(robot.state().q_rad, here)


def test_nonsense_is_refused_by_name(robot):
    home = RX90.home_rad
    with pytest.raises(InvalidInputError, match="times_s must grow"):
        robot.move((0.0, 0.0), np.stack((home, home)))
    with pytest.raises(InvalidInputError, match="qs_rad must be finite"):
        robot.move((0.0, 1.0), np.full((2, 6), np.nan))
    with pytest.raises(InvalidInputError, match="at least 2"):
        robot.move((0.0,), home[None])


def test_a_closed_robot_does_not_move(robot, move):
    robot.close()
    robot.close()
    with pytest.raises(DeviceError, match="closed"):
        robot.move(move.times_s, move.qs_rad)


def workspace_points(n, seed=0):
    rng = np.random.default_rng(seed)
    half = np.array(WORKSPACE_SIZE) / 2
    return np.array(WORKSPACE_CENTER) + rng.uniform(-half, half, (n, 3))


@pytest.mark.parametrize("seed", range(5))
def test_the_systematic_error_has_its_size_and_is_smooth(seed):
    error = RobotError(seed)
    points = workspace_points(4000)
    field = error.systematic_mm(points)
    assert np.sqrt((field**2).sum(axis=1).mean()) == pytest.approx(0.35, rel=0.05)
    step = error.systematic_mm(points + np.array((1.0, 0, 0))) - field
    assert np.linalg.norm(step, axis=1).max() < 0.01
    assert np.linalg.norm(field - field.mean(axis=0), axis=1).max() > 0.1  # not a mere shift


def test_repeatability_and_tilt_have_their_size():
    error = RobotError(7)
    nominal = Pose.from_rotvec((0.2, 0.1, 3.0), (600.0, 60.0, 400.0))
    systematic = error.systematic_mm(nominal.translation[None])[0]
    poses = error.Ts_base_tip_true(nominal.repeated(2000), None, 3, np.arange(2000))
    shifts = np.array([pose.translation - nominal.translation - systematic for pose in poses])
    assert np.sqrt((shifts**2).sum(axis=1).mean()) == pytest.approx(0.03, rel=0.05)
    assert np.abs(shifts.mean(axis=0)).max() < 0.002
    tilts = np.array([angle_rad(pose, nominal) for pose in poses])
    assert np.rad2deg(np.sqrt((tilts**2).mean())) == pytest.approx(0.02, rel=0.05)


@given(seed=st.integers(-5, 2**40), ordinal=st.integers(0, 1000), key=st.integers(-(2**40), 2**40))
@settings(max_examples=30, deadline=None)
def test_errors_are_a_pure_function_of_seed_capture_and_motion(seed, ordinal, key):
    nominal = Pose.from_translation((500.0, 100.0, 300.0))
    first, again = RobotError(seed), RobotError(seed)

    def tip(error, ordinal, *keys):
        poses = nominal.repeated(len(keys))
        return error.Ts_base_tip_true(poses, None, ordinal, np.array(keys))[0]

    tip(first, ordinal + 1, key)
    a, b = tip(first, ordinal, key), tip(again, ordinal, key, key + 3)
    np.testing.assert_array_equal(a.matrix(), b.matrix())
    for other in (
        tip(first, ordinal + 1, key),
        tip(first, ordinal, key + 1),
        tip(RobotError(seed + 1), ordinal, key),
    ):
        assert np.abs(other.translation - a.translation).max() > 1e-6


def test_switched_off_there_is_no_error():
    error = RobotError(1, enabled=False)
    nominal = Pose.from_translation((500.0, 100.0, 300.0)).repeated(1)
    assert error.Ts_base_tip_true(nominal, None, 0, np.zeros(1, int)) is nominal
    assert not error.systematic_mm(workspace_points(5)).any()
    with pytest.raises(InvalidInputError, match="points_base"):
        RobotError(1).systematic_mm((1.0, 2.0, 3.0))
