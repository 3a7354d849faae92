"""Hand-eye calibration of recorded poses: laws, an oracle for what is left out, and refusals."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.recorded_poses import calibrate_hand_eye
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import deviation_between
from tests.helpers.strategies import random_pose

SENSOR = {
    "eye-to-hand": Pose.from_rotvec((0.4, 2.0, -1.0), (700.0, -1200.0, 900.0)),
    "eye-in-hand": Pose.from_rotvec((0.1, -0.2, 1.5), (40.0, -25.0, 60.0)),
}
MARKER = {
    "eye-to-hand": Pose.from_rotvec((1.0, 0.3, 0.2), (20.0, -30.0, 90.0)),
    "eye-in-hand": Pose.from_rotvec((3.0, 0.1, 0.0), (450.0, 60.0, 20.0)),
}


def made(seed, setup="eye-to-hand", n=24, turn_rad=0.6, turn_noise=3e-4, shift_noise=0.08):
    """Poses of robot and sensor with white errors of the sensor, three times as large in depth."""
    rng = np.random.default_rng((11, seed))
    start = Pose.from_rotvec((np.pi, 0.0, 0.0), (480.0, 0.0, 350.0))
    robot = Poses.stack(
        [
            start @ Pose.from_rotvec(turn_rad * rng.uniform(-1, 1, 3), rng.uniform(-90.0, 90.0, 3))
            for _ in range(n)
        ]
    )
    sensor, marker = SENSOR[setup], MARKER[setup]
    true = (
        sensor.inv() @ (robot @ marker)
        if setup == "eye-to-hand"
        else sensor.inv() @ (robot.inv() @ marker)
    )
    turns = Rotation.from_rotvec(rng.normal(0.0, turn_noise, (n, 3))).as_matrix()
    shifts = rng.normal(0.0, shift_noise, (n, 3)) * (1.0, 1.0, 3.0)
    return robot, Poses(turns @ true.rotations, true.translations + shifts)


@pytest.mark.parametrize("setup", SENSOR)
def test_exact_poses_give_the_sensor_and_the_marker(setup):
    robot, seen = made(0, setup, turn_noise=0.0, shift_noise=0.0)
    found = calibrate_hand_eye(robot, seen, setup=setup)
    for pose, true in ((found.sensor, SENSOR[setup]), (found.marker, MARKER[setup])):
        np.testing.assert_allclose(pose.matrix(), true.matrix(), atol=1e-5)
    assert found.used.all()
    assert found.sigma_mm < 1e-3


@pytest.mark.parametrize("setup", SENSOR)
def test_another_base_and_another_sensor_frame_change_nothing_else(setup):
    robot, seen = made(1, setup)
    rng = np.random.default_rng(5)
    base = random_pose(rng, 300.0)
    first = calibrate_hand_eye(robot, seen, setup=setup)
    moved = calibrate_hand_eye(base @ robot, seen, setup=setup)
    expected = base @ first.sensor if setup == "eye-to-hand" else first.sensor
    np.testing.assert_allclose(moved.sensor.matrix(), expected.matrix(), atol=1e-6)
    np.testing.assert_allclose(moved.sigma_mm, first.sigma_mm, rtol=1e-5)
    np.testing.assert_allclose(moved.left_out_mm, first.left_out_mm, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("setup", SENSOR)
def test_errors_are_as_large_as_the_covariance_says(setup):
    squares = []
    for seed in range(100, 160):
        found = calibrate_hand_eye(*made(seed, setup), setup=setup)
        for pose, true, rows in (
            (found.sensor, SENSOR[setup], slice(0, 6)),
            (found.marker, MARKER[setup], slice(6, 12)),
        ):
            off = deviation_between(true, pose)
            squares.append(off @ np.linalg.solve(found.covariance[rows, rows], off) / 6.0)
    assert 0.75 < np.mean(squares) < 1.35


def test_the_noise_is_found():
    found = calibrate_hand_eye(*made(2, n=200))
    np.testing.assert_allclose(found.turn_sigma_rad, 3e-4, rtol=0.15)
    np.testing.assert_allclose(found.shift_sigma_mm, (0.08, 0.24), rtol=0.15)


def test_what_is_left_out_is_predicted_as_by_a_fit_without_it():
    robot, seen = made(3, n=14)
    found = calibrate_hand_eye(robot, seen)
    for i in (0, 6, 13):
        rest = np.arange(14) != i
        again = calibrate_hand_eye(robot.select(rest), seen.select(rest))
        expected = again.sensor.inv() @ robot[i] @ again.marker
        turn = Rotation.from_matrix(seen[i].rotation @ expected.rotation.T).magnitude()
        assert found.left_out_deg[i] == pytest.approx(np.rad2deg(turn), rel=0.3, abs=0.005)
        off = np.linalg.norm(seen[i].translation - expected.translation)
        assert found.left_out_mm[i] == pytest.approx(off, rel=0.3, abs=0.03)


def test_gross_errors_are_dropped_and_named():
    robot, seen = made(4)
    bad = [3, 17]
    spoiled = list(seen)
    for i in bad:
        spoiled[i] = spoiled[i] @ Pose.from_rotvec((0.0, 0.2, 0.0), (5.0, 0.0, 20.0))
    found = calibrate_hand_eye(robot, Poses.stack(spoiled))
    assert np.flatnonzero(~found.used).tolist() == bad
    assert sorted(found.worst()[:2]) == bad
    clean = calibrate_hand_eye(robot, seen)
    off = np.linalg.norm(found.sensor.translation - clean.sensor.translation)
    assert off < 3.0 * np.sqrt(np.trace(clean.covariance[3:6, 3:6]))


@pytest.mark.parametrize("setup", SENSOR)
def test_the_next_pose_tells_what_it_promises(setup):
    robot, seen = made(5, setup, n=8)
    found = calibrate_hand_eye(robot, seen, setup=setup)
    following = found.next_pose
    assert following.sigma_mm < found.sigma_mm
    T = following.T_base_tip
    there = T if setup == "eye-to-hand" else T.inv()
    marker = (found.sensor.inv() @ there @ found.marker).translation
    apart = np.linalg.norm(seen.translations - marker, axis=1)
    assert apart.min() < 1.0  # the marker stays where the sensor saw it
    start = int(np.argmin(apart))
    turned = Rotation.from_matrix(robot[start].rotation.T @ T.rotation).as_rotvec(degrees=True)
    np.testing.assert_allclose(
        turned, following.angle_deg * following.axis_tip, atol=0.15 * following.angle_deg
    )


def transposed(poses):
    return Poses(np.swapaxes(poses.rotations, 1, 2), poses.translations)


def real_part_last(poses):
    rolled = np.roll(Rotation.from_matrix(poses.rotations).as_quat(), 1, axis=1)
    return Poses(Rotation.from_quat(rolled).as_matrix(), poses.translations)


def scaled(by):
    return lambda poses: Poses(poses.rotations, by * poses.translations)


def same(poses):
    return poses


MISTAKES = {
    "robot inverted": (Poses.inv, same, "inverted|--inverse robot"),
    "sensor inverted": (same, Poses.inv, "--inverse sensor"),
    "robot transposed": (transposed, same, "of the robot: the rotations are transposed"),
    "sensor transposed": (same, transposed, "of the sensor: the rotations are transposed"),
    "quaternions": (same, real_part_last, "of the sensor: .*quaternions in another order"),
    "sensor in cm": (same, scaled(0.1), "the sensor's positions are in centimetres"),
    "robot in m": (scaled(0.001), same, "the robot's positions are in metres"),
    "sensor in m": (same, scaled(0.001), "the sensor's positions are in metres"),
    "squares measured wrong": (
        same,
        scaled(1.08),
        "multiplied by 0.92[56] .* squares",
    ),
    "rows do not belong together": (
        lambda p: p.select(np.random.default_rng(0).permutation(len(p))),
        same,
        "row by row the poses belong together",
    ),
}


@pytest.mark.parametrize("setup", SENSOR)
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named(name, setup):
    robot, sensor, said = MISTAKES[name]
    poses, seen = made(6, setup)
    with pytest.raises(InvalidInputError, match=said):
        calibrate_hand_eye(robot(poses), sensor(seen), setup=setup)


@pytest.mark.parametrize("setup", SENSOR)
@pytest.mark.sweep(6)
@pytest.mark.parametrize("seed", range(20, 50))
def test_right_poses_are_not_taken_for_mistakes(setup, seed):
    few = 6 + seed % 20
    noisy = made(seed, setup, n=few, turn_noise=2e-3, shift_noise=0.5)
    found = calibrate_hand_eye(*noisy, setup=setup)
    off_mm = np.linalg.norm(found.sensor.translation - SENSOR[setup].translation)
    assert off_mm < 5.0 * np.sqrt(np.trace(found.covariance[3:6, 3:6]))


def test_the_other_set_up_is_named():
    robot, seen = made(7, "eye-in-hand")
    with pytest.raises(InvalidInputError, match="the other --setup"):
        calibrate_hand_eye(robot, seen, setup="eye-to-hand")


def test_motions_that_tell_too_little_are_named():
    robot, seen = made(8)
    with pytest.raises(DegenerateGeometryError, match="poses of the sensor stand still"):
        calibrate_hand_eye(robot, seen[0].repeated(24))
    with pytest.raises(DegenerateGeometryError, match="poses of the robot stand still"):
        calibrate_hand_eye(robot[0].repeated(24), seen)
    turned = Poses.stack([Pose.from_rotvec((0, 0, 0.1 * k), (k, 2 * k, 0)) for k in range(12)])
    with pytest.raises(DegenerateGeometryError, match="one axis only"):
        calibrate_hand_eye(turned, SENSOR["eye-to-hand"].inv() @ turned)
    for n, said in ((4, "at least 5 poses, not 4"), (23, "24 robot poses and 23 sensor poses")):
        with pytest.raises(InvalidInputError, match=said):
            calibrate_hand_eye(robot.select(slice(0, 24 if n == 23 else n)), seen.select(range(n)))
    with pytest.raises(InvalidInputError, match="setup is eye-to-hand or eye-in-hand"):
        calibrate_hand_eye(robot, seen, setup="eye")


def test_verdict_and_remedies():
    assert calibrate_hand_eye(*made(9)).verdict == "good"
    flat = calibrate_hand_eye(*made(9, turn_rad=0.06))
    assert flat.verdict != "good"
    assert "about its second axis; its axes are nearly parallel" in " ".join(flat.reasons)
    assert "turn the tool further, first by" in flat.reasons[0]
    few = calibrate_hand_eye(*made(9, n=6))
    assert any("only 6 poses count" in reason for reason in few.reasons)
