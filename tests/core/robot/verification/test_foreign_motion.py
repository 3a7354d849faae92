"""Motions from elsewhere: planted faults are refused where they are, good ones are certified."""

import re

import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.robot.kinematics.catalog import described_robot, robot_model
from rona_core.robot.kinematics.universal_robots import urdf_path
from rona_core.robot.verification.foreign_motion import verify_foreign
from rona_core.robot.verification.joint_motion import JointMotion, driven, require_places
from tests.helpers.foreign_motions import FAULTS, ROBOTS, faulty, good, planned

UR5 = robot_model("ur5")
N_FAULTS, N_GOOD = 25, 50  # seeds of each fault; motions
CASES = [(ROBOTS[seed % 3], fault, seed) for seed in range(N_FAULTS) for fault in FAULTS]


def test_there_are_as_many_cases_as_promised():
    assert len(CASES) == 200


@pytest.mark.sweep(8)
@pytest.mark.parametrize(("robot", "fault", "seed"), CASES)
def test_a_planted_fault_is_refused_where_it_is(robot, fault, seed):
    motion, around, sample = faulty(robot, fault, seed)
    verdict = verify_foreign(robot_model(robot), motion, obstacles=around)
    assert not verdict.certificate.certified
    near = [one for one in verdict.refused() if abs(one.sample - sample) <= 1.0]
    assert near, [one.sentence for one in verdict.refused()]
    assert f"sample {near[0].sample:g}" in near[0].sentence


@pytest.mark.sweep(5)
@pytest.mark.parametrize("seed", range(N_GOOD))
def test_a_good_motion_is_certified(seed):
    robot = ROBOTS[seed % 3]
    verdict = verify_foreign(robot_model(robot), good(robot, seed))
    assert verdict.certificate.certified, [one.sentence for one in verdict.refused()]


def test_few_samples_are_refused_as_a_line_and_certified_as_the_curve_that_they_state():
    at, duration_s = planned("ur5", 2)
    times = np.linspace(0.0, duration_s, 12)
    found = at(times)
    line = verify_foreign(UR5, JointMotion(times, found.q))
    assert [one.check.name for one in line.refused()] == ["bend between samples"]
    assert "corners" in line.hints[0]
    motion = JointMotion(times, found.q, found.v, found.a)
    curve = verify_foreign(UR5, motion)
    assert (curve.interpolation, curve.certificate.certified) == ("quintic", True)
    assert not verify_foreign(UR5, motion, "linear").certificate.certified
    with pytest.raises(InvalidInputError, match="states none"):
        verify_foreign(UR5, JointMotion(times, found.q), "cubic")


def test_a_curve_goes_through_its_samples_with_their_speeds_and_accelerations():
    times = np.array((0.0, 1.0, 1.5))
    rng = np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 3, 6))
    for kind in ("cubic", "quintic"):
        way = driven(JointMotion(times, q, v, a), kind)
        rows = np.searchsorted(way.times_s, times)
        np.testing.assert_allclose(way.qs_rad[rows], q, atol=1e-12)
        np.testing.assert_allclose(way.numbers[rows], (0.0, 1.0, 2.0))
        # a polynomial of such a degree through these is the only one
        t, degree = way.times_s[: rows[1] + 1], 3 if kind == "cubic" else 5
        fit = np.polynomial.Polynomial.fit(t, way.qs_rad[: rows[1] + 1, 0], degree)
        np.testing.assert_allclose(fit(t), way.qs_rad[: rows[1] + 1, 0], atol=1e-9)
        for at_s, row in ((0.0, 0), (1.0, 1)):
            assert fit.deriv()(at_s) == pytest.approx(v[row, 0], abs=1e-6)
            if kind == "quintic":
                assert fit.deriv(2)(at_s) == pytest.approx(a[row, 0], abs=1e-5)


def test_degrees_under_the_name_of_radians_are_refused_with_a_hint():
    at, duration_s = planned("ur5", 2)
    times = np.linspace(0.0, duration_s, 400)
    verdict = verify_foreign(UR5, JointMotion(times, np.rad2deg(at(times).q)))
    assert "margin to the joint limits" in {one.check.name for one in verdict.refused()}
    assert "q1_deg" in verdict.hints[0]


def test_what_is_no_number_is_refused_at_its_sample():
    q = np.zeros((9, 6))
    q[5, 2] = np.nan
    with pytest.raises(InvalidInputError, match="joint 3 is not a finite number at sample 5"):
        JointMotion(np.arange(9.0), q)
    motion = JointMotion(np.arange(9.0) * 1e4, np.zeros((9, 6)), np.zeros((9, 6)))
    with pytest.raises(InvalidInputError, match="are the times in seconds"):
        require_places(motion, "cubic", 1000)


def test_a_straight_wrist_is_told_and_refused_on_demand():
    home = robot_model("rx90").home_rad
    times = np.linspace(0.0, 4.0, 401)
    q = np.tile(home, (401, 1))  # from -15 degrees through a straight wrist, and back
    q[:, 4] += np.deg2rad(20.0) * (0.5 - 0.5 * np.cos(2.0 * np.pi * times / 4.0))
    verdict = verify_foreign(robot_model("rx90"), JointMotion(times, q))
    assert verdict.certificate.certified
    (wrist,) = [
        one for one in verdict.not_demanded if one.check.name.startswith("wrist from straight")
    ]
    assert wrist.check.value < 1.0
    refused = verify_foreign(robot_model("rx90"), JointMotion(times, q), demand_singular=True)
    assert [one.check.name for one in refused.refused()] == ["wrist from straight"]
    assert refused.certificate.digest != verdict.certificate.digest


def test_a_sentence_says_joint_place_time_and_posture():
    motion, _, sample = faulty("ur5", "jump of 15 degrees", 4)
    refused = verify_foreign(UR5, motion).refused()
    (step,) = [one for one in refused if one.check.name == "joint step"]
    pattern = rf"joint step fails: joint \d, 15.* ° at sample {sample} \(\d+\.\d+ s\), at most 10 °"
    assert re.match(pattern, step.sentence)
    assert step.sentence.count(",") >= 6


@pytest.mark.parametrize("quantity", ["speed", "acceleration"])
@pytest.mark.parametrize("joint", [1, 2, 3, 4, 5, 6])
def test_the_joint_that_is_named_is_the_one_furthest_over_its_own_limit(joint, quantity):
    model = robot_model("rx90")  # limits differ by joint
    limits = model.speed_rad_per_s if quantity == "speed" else model.acceleration_rad_per_s2
    times = np.linspace(0.0, 2.0, 201)
    if quantity == "speed":  # slowly up to a speed, and slowly back to none
        shape = times + np.sin(2.0 * np.pi * (times - 0.5) / 2.0) / np.pi
        shape /= np.diff(shape).max() / 0.01
    else:  # one sample's speed after rest
        shape = np.where(times > 1.0, 0.01**2, 0.0)
    over = np.where(np.arange(6) == joint - 1, 1.3, 0.9)
    q = model.home_rad + shape[:, None] * (over * limits)
    refused = verify_foreign(model, JointMotion(times, q)).refused()
    (found,) = [one for one in refused if one.check.name == f"joint {quantity}"]
    assert (found.joint, found.check.value) == (joint, pytest.approx(130.0, abs=1.0))
    assert "fails: joint" in found.sentence
    if quantity == "acceleration":
        assert abs(found.sample - 100.0) <= 1.0


def test_what_holds_says_so():
    verdict = verify_foreign(UR5, good("ur5", 1))
    assert all(" holds: " in check.sentence for check in verdict.certificate.checks)


def test_a_quintic_needs_accelerations_and_a_cubic_does_not():
    at, duration_s = planned("ur5", 2)
    times = np.linspace(0.0, duration_s, 12)
    found = at(times)
    motion = JointMotion(times, found.q, found.v)
    assert len(driven(motion, "cubic").times_s) > len(times)
    with pytest.raises(InvalidInputError, match="speeds and accelerations"):
        driven(motion, "quintic")


def test_a_description_has_the_limits_of_its_file(tmp_path):
    text = urdf_path("ur5").read_text()
    copy = tmp_path / "mine.urdf"
    copy.write_text(text)
    found = described_robot(copy)
    assert found.name == "ur5"
    assert found.upper_rad[1] > UR5.upper_rad[1] + 1.0
    np.testing.assert_array_equal(found.acceleration_rad_per_s2, UR5.acceleration_rad_per_s2)
    copy = tmp_path / "other.urdf"
    copy.write_text(text.replace('xyz="0.0 -0.1197 0.425"', 'xyz="0.0 -0.1197 0.500"'))
    assert described_robot(copy).name.startswith("arm of other") == (copy.read_text() != text)
