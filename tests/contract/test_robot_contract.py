"""What every robot keeps to, whatever is behind it."""

import dataclasses

import numpy as np
import pytest

from rona_core.devices.robots import ROBOTS
from rona_core.devices.settings import RobotSettings
from rona_core.errors import DeviceError
from rona_core.virtual.clock import CaptureClock

catalog = pytest.importorskip(
    "rona_core.robot.kinematics.catalog", reason="there is no robot model"
)
virtual_robot = pytest.importorskip(
    "rona_core.virtual.robot.robot", reason="there is no virtual robot"
)


def virtual(name):
    def build():
        model, clock = catalog.robot_model(name), CaptureClock()
        robot = virtual_robot.VirtualRobot(model, clock)
        robot.begin(RobotSettings(model=name, latency_ms=0.0), 1)
        return robot, clock, model

    return build


IMPLEMENTATIONS = {f"virtual-{name}": virtual(name) for name in ROBOTS}
TIMES_S = np.linspace(0.0, 2.0, 41)


@pytest.fixture(params=IMPLEMENTATIONS.values(), ids=IMPLEMENTATIONS.keys())
def device(request):
    robot, clock, model = request.param()
    yield robot, clock, model
    robot.close()


def swing(q_rad, amount_rad=0.1):
    """A gentle motion of all joints from ``q_rad`` and back, at rest at both ends."""
    share = 0.5 - 0.5 * np.cos(np.pi * TIMES_S)
    return q_rad + share[:, None] * amount_rad * np.array((1, -1, 1, -1, 1, -1.0))


def test_it_stands_still_within_its_limits_until_it_is_told_to_move(device):
    robot, clock, model = device
    before = robot.state()
    clock.wait_until(1.0)
    after = robot.state()
    np.testing.assert_array_equal(before.q_rad, after.q_rad)
    assert not after.moving
    assert ((before.q_rad >= model.lower_rad) & (before.q_rad <= model.upper_rad)).all()
    assert after.time_s == pytest.approx(1.0)


def test_a_motion_is_followed_in_time_and_ends(device):
    robot, clock, _ = device
    clock.wait_until(0.5)
    qs = swing(robot.state().q_rad)
    motion = robot.move(TIMES_S, qs)
    assert not motion.done()
    progress, times = [], []
    for t, q in zip(TIMES_S, qs, strict=True):
        clock.wait_until(0.5 + t)
        sample = robot.state()
        np.testing.assert_allclose(sample.q_rad, q, atol=1e-9)
        progress.append(motion.progress())
        times.append(sample.time_s)
    assert (np.diff(times) > 0).all()
    assert (np.diff(progress) >= 0).all()
    assert progress[0] == pytest.approx(0.0)
    assert motion.progress() == pytest.approx(1.0)
    clock.wait_until(3.0)
    assert motion.done()
    assert not robot.state().moving


def test_stop_freezes_it_at_once_and_twice_is_safe(device):
    robot, clock, _ = device
    motion = robot.move(TIMES_S, swing(robot.state().q_rad))
    clock.wait_until(0.7)
    robot.stop()
    there = robot.state().q_rad.copy()
    robot.stop()
    clock.wait_until(2.5)
    np.testing.assert_array_equal(robot.state().q_rad, there)
    assert motion.done()
    assert motion.progress() < 0.5
    assert not robot.state().moving


def test_a_motion_that_starts_elsewhere_is_refused_and_nothing_moves(device):
    robot, clock, _ = device
    q = robot.state().q_rad.copy()
    with pytest.raises(DeviceError):
        robot.move(TIMES_S, swing(q + np.deg2rad(2.0)))
    clock.wait_until(1.0)
    np.testing.assert_array_equal(robot.state().q_rad, q)


def test_a_motion_beyond_a_joint_limit_is_refused_and_nothing_moves(device):
    robot, clock, model = device
    q = robot.state().q_rad.copy()
    far = np.linspace(0.0, 1.0, 200)[:, None] * (model.upper_rad + 0.05 - q) + q
    with pytest.raises(DeviceError):
        robot.move(np.linspace(0.0, 60.0, 200), far)
    clock.wait_until(1.0)
    np.testing.assert_array_equal(robot.state().q_rad, q)


def test_samples_cannot_be_changed(device):
    robot, _, _ = device
    sample = robot.state()
    with pytest.raises(dataclasses.FrozenInstanceError):
        sample.moving = True
    with pytest.raises(ValueError, match="read-only"):
        sample.q_rad[0] = 1.0


def test_it_can_be_placed_before_a_capture(device):
    robot, _, model = device
    q = model.home_rad + 0.05
    robot.place(q)
    np.testing.assert_allclose(robot.state().q_rad, q, atol=1e-12)


def test_closed_twice_it_stands_still_and_refuses_motions(device):
    robot, _, model = device
    robot.close()
    robot.close()
    assert not robot.state().moving
    with pytest.raises(DeviceError):
        robot.move(TIMES_S, swing(model.home_rad))
