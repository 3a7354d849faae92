"""The virtual robot while it is corrected along the tool axis, and what the force sensor shows."""

import numpy as np
import pytest

from rona_core.devices.settings import ContactSettings, RobotSettings
from rona_core.devices.wrench import JR3
from rona_core.errors import DeviceError, InvalidInputError
from rona_core.robot.force_control.correction_corridor import correction_corridor
from rona_core.robot.force_control.gravity_compensation import GRAVITY_BASE
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.robot.force_sensor import NOISE, VirtualForceSensor
from rona_core.virtual.robot.robot import VirtualRobot
from tests.scenes.patch_scenes import dense_path

RX90 = robot_model("rx90")
CONTACT = ContactSettings()


@pytest.fixture(scope="module")
def band():
    plan = plan_scan(dense_path("S0", lines=2, per_line=4), RX90)
    return correction_corridor(RX90, plan.trajectory, CONTACT)


@pytest.fixture
def robot():
    clock = CaptureClock()
    robot = VirtualRobot(RX90, clock)
    robot.begin(RobotSettings(latency_ms=8.0), 0)
    return robot, clock


def guided(robot, band):
    return robot.guide(band.times_s, band.qs_rad, band.travels_mm)


def test_it_stands_until_it_is_told_and_then_follows_at_its_share(robot, band):
    robot, clock = robot
    motion = guided(robot, band)
    clock.wait_until(1.0)
    np.testing.assert_array_equal(robot.q_at(1.0), band.qs_rad[0, 2])
    motion.correct(0.0, 0.5)
    clock.wait_until(5.0)
    assert motion.reached_s() == pytest.approx(2.0)
    wanted = [np.interp(2.0, band.times_s, q) for q in band.qs_rad[:, 2].T]
    np.testing.assert_allclose(robot.q_at(5.0), wanted, atol=1e-12)
    np.testing.assert_allclose(robot.state().q_rad, robot.q_at(5.0 - 0.008), atol=1e-12)
    assert not motion.done()


def test_a_correction_moves_the_face_along_its_axis_after_the_delay(robot, band):
    robot, clock = robot
    motion = guided(robot, band)
    motion.correct(0.0, 1.0)
    at_s = float(band.times_s[band.guided][50])
    clock.wait_until(at_s)
    motion.correct(10.0, 0.0)
    clock.wait_until(at_s + 0.03)
    assert motion.travel_mm() == 0.0
    clock.wait_until(at_s + 0.3)
    motion.correct(0.0, 0.0)
    clock.wait_until(at_s + 1.0)
    travel_mm = motion.travel_mm()
    assert travel_mm == pytest.approx(3.0, abs=1e-6)  # 10 mm/s for 0.3 s, whatever the lag
    before, after = robot.q_at(at_s), robot.q_at(at_s + 1.0)
    probes = RX90.forward(np.stack((before, after))) @ RX90.T_flange_probe
    moved = probes.translations[1] - probes.translations[0]
    np.testing.assert_allclose(moved, travel_mm * probes.rotations[0, :, 2], atol=1e-5)


def test_it_ends_where_the_motion_ends(robot, band):
    robot, clock = robot
    motion = guided(robot, band)
    motion.correct(0.0, 1.0)
    clock.wait_until(float(band.times_s[-1]) - 0.01)
    assert not motion.done()
    assert robot.state().moving
    clock.wait_until(float(band.times_s[-1]) + 0.01)
    assert motion.done()
    assert motion.progress() == 1.0
    np.testing.assert_allclose(robot.q_at(1e6), band.qs_rad[-1, 2], atol=1e-12)


def test_many_looks_are_those_of_one_after_the_other(robot, band):
    robot, clock = robot
    motion = guided(robot, band)
    for k in range(40):
        clock.wait_until(0.016 * k)
        motion.correct(8.0 * (-1.0) ** (k // 7), 0.25 * (k % 5))
    robot.stop()
    times_s = np.arange(-0.02, 0.9, 0.001)
    reached_s, travel_mm = robot.guided.looks(times_s)
    one = [(robot.guided.reached_s(t), robot.guided.travel_mm(t)) for t in times_s.tolist()]
    np.testing.assert_array_equal(np.stack((reached_s, travel_mm), axis=1), one)


def test_stop_freezes_way_and_correction_at_once(robot, band):
    robot, clock = robot
    motion = guided(robot, band)
    motion.correct(0.0, 1.0)
    clock.wait_until(float(band.times_s[band.guided][20]))
    motion.correct(5.0, 1.0)
    clock.wait_until(clock.now() + 0.2)
    robot.stop()
    there = robot.q_at(clock.now()).copy()
    motion.correct(5.0, 1.0)  # too late
    clock.wait_until(clock.now() + 3.0)
    assert motion.done()
    np.testing.assert_array_equal(robot.q_at(clock.now()), there)


def test_a_band_beyond_the_limits_or_elsewhere_is_refused(robot, band):
    robot, _ = robot
    beyond = band.qs_rad.copy()
    beyond[100, 4, 2] = RX90.upper_rad[2] + 0.01
    with pytest.raises(DeviceError, match="joint 3"):
        robot.guide(band.times_s, beyond, band.travels_mm)
    with pytest.raises(DeviceError, match="starts"):
        robot.guide(band.times_s, band.qs_rad + 0.1, band.travels_mm)
    with pytest.raises(InvalidInputError, match="shape"):
        robot.guide(band.times_s, band.qs_rad[:, :3], band.travels_mm)
    with pytest.raises(InvalidInputError, match="0 must be"):
        robot.guide(band.times_s, band.qs_rad, band.travels_mm + 0.3)
    motion = guided(robot, band)
    motion.correct(0.0, 1.0)
    with pytest.raises(DeviceError, match="moving"):
        guided(robot, band)


# ------------------------------------------------------------------ the force sensor


def sensor(depth_mm=-100.0, seed=3):
    clock = CaptureClock()
    made = VirtualForceSensor(
        clock,
        RX90,
        lambda _: RX90.home_rad,
        lambda times: np.full(len(times), depth_mm),
    )
    made.begin(seed, 1)
    return made, clock


def mean_reading(device, clock, n=400):
    shown = []
    for i in range(n):
        clock.wait_until(1.0 + 0.016 * i)
        shown.append(device.read().wrench)
    return np.array(shown)


def test_in_free_air_it_shows_weight_and_offset_with_its_noise():
    device, clock = sensor()
    shown = mean_reading(device, clock)
    rotation = RX90.forward(RX90.home_rad[None])[0].rotation
    weight = device.mass_kg * rotation.T @ GRAVITY_BASE
    torque = np.cross(device.com_flange_mm, weight)
    wanted = np.concatenate((weight, torque)) + device.offset
    np.testing.assert_allclose(shown.mean(axis=0)[:3], wanted[:3], atol=0.006)
    np.testing.assert_allclose(shown.mean(axis=0)[3:], wanted[3:], atol=0.5)
    assert shown.std(axis=0)[:3] == pytest.approx(NOISE[0], rel=0.2)


def test_pressing_shows_along_the_axis_and_as_torque_over_the_lever():
    free, clock = sensor()
    pressed, other = sensor(depth_mm=1.5)
    change = mean_reading(pressed, other).mean(axis=0) - mean_reading(free, clock).mean(axis=0)
    np.testing.assert_allclose(change[:3], (-3.0, 0.0, 0.0), atol=0.01)
    np.testing.assert_allclose(change[3:], (0.0, -180.0, 0.0), atol=1.0)


def test_readings_come_in_the_steps_of_the_converter_and_saturate():
    device, clock = sensor()
    steps = mean_reading(device, clock, 20)[:, :3] / (JR3.force_range_n / JR3.steps)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert JR3.force_range_n / JR3.steps == pytest.approx(0.01575)
    wall, clock = sensor(depth_mm=40.0)
    clock.wait_until(1.0)
    sample = wall.read()
    assert sample.saturated
    assert np.abs(sample.wrench[:3]).max() == JR3.force_range_n
    assert not sensor()[0].read().saturated


def test_the_same_seed_and_capture_give_the_same_readings():
    first, second, other = (mean_reading(*sensor(seed=s), 10) for s in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, other)


def test_a_closed_sensor_says_so():
    device, _ = sensor()
    device.close()
    device.close()
    with pytest.raises(DeviceError, match="closed"):
        device.read()
