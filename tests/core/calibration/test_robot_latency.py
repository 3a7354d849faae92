"""The delay between poses and echoes, planted and found again."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.calibration.timing.robot_latency import (
    EchoSegment,
    estimate_pose_delay,
    segment_places,
)
from rona_core.errors import DegenerateGeometryError, InvalidInputError


def lifting(t):
    """Place of a face that is drawn back, slowly at first."""
    return -6.0 * np.maximum(t - 0.3, 0.0) ** 2


def touching(t):
    """Place of a face that closes at 2 mm/s and comes to rest."""
    u = np.clip(t - 0.2, 0.0, None)
    return np.where(u < 0.5, 2.0 * u, 1.0 + 0.4 * (1.0 - np.exp(-5.0 * (u - 0.5))))


def segment(place, delay_s, *, seed=0, noise_mm=0.0, scale=1.0, n=50):
    rng = np.random.default_rng(seed)
    scans = np.linspace(0.1, 0.9, n)
    joints = np.arange(0.0, 1.2, 0.016)
    standoff = 0.7 - scale * place(scans) + rng.normal(0.0, noise_mm, n)
    return EchoSegment(scans, standoff, joints, place(joints - delay_s))


@settings(max_examples=25, deadline=None)
@given(delay_s=st.floats(-0.03, 0.05), scale=st.floats(0.97, 1.03))
def test_a_planted_delay_is_found_whatever_the_scale(delay_s, scale):
    parts = [segment(touching, delay_s, scale=scale), segment(lifting, delay_s, scale=scale)]
    found = estimate_pose_delay(parts)
    assert found.delay_s == pytest.approx(delay_s, abs=3e-4)
    assert found.scale == pytest.approx(scale, abs=2e-3)


@pytest.mark.slow
def test_its_deviation_is_what_it_says():
    found = [
        estimate_pose_delay([segment(lifting, 0.008, seed=seed, noise_mm=0.004)])
        for seed in range(60)
    ]
    errors = np.array([f.delay_s - 0.008 for f in found])
    stated = np.mean([f.sigma_s for f in found])
    assert errors.std() == pytest.approx(stated, rel=0.35)
    assert abs(errors.mean()) < 4.0 * errors.std() / np.sqrt(60)


def test_a_robot_that_settles_elsewhere_spoils_one_step_and_not_the_result():
    part = segment(lifting, 0.012, noise_mm=0.002)
    jumped = part.standoff_mm + np.where(np.arange(50) > 30, 0.05, 0.0)
    found = estimate_pose_delay([replace(part, standoff_mm=jumped)])
    assert found.delay_s == pytest.approx(0.012, abs=1.5e-3)
    assert found.n_pieces == 2


@pytest.mark.slow
def test_a_robot_that_wanders_states_more_than_noise_alone_would():
    ratios, walks = [], 0.01 * np.sqrt(np.diff(np.linspace(0.1, 0.9, 51)))
    for seed in range(60):
        part = segment(lifting, 0.008, seed=seed, noise_mm=0.0005)
        wander = np.cumsum(np.random.default_rng(1000 + seed).normal(0.0, walks))
        found = estimate_pose_delay([replace(part, standoff_mm=part.standoff_mm + wander)])
        ratios.append((found.delay_s - 0.008) / found.sigma_s)
    assert np.mean(np.square(ratios)) < 8.0  # 15 if every A-scan erred by itself


def test_the_shift_along_the_path_is_speed_times_delay():
    found = estimate_pose_delay([segment(lifting, 0.016)])
    assert found.way_mm(20.0) == pytest.approx(0.32, abs=0.01)
    assert found.sigma_mm(20.0) == pytest.approx(20.0 * found.sigma_s)


def test_a_motion_that_is_too_even_tells_nothing():
    part = segment(lambda t: 1.0 * t, 0.01, noise_mm=0.004)
    with pytest.raises(DegenerateGeometryError, match="not evenly"):
        estimate_pose_delay([part])


def test_too_few_a_scans_are_refused():
    with pytest.raises(DegenerateGeometryError, match="too few"):
        estimate_pose_delay([segment(lifting, 0.01, n=8)])
    with pytest.raises(DegenerateGeometryError, match="too few"):
        estimate_pose_delay([])


def test_arrays_that_do_not_fit_are_refused():
    part = segment(lifting, 0.01)
    with pytest.raises(InvalidInputError):
        estimate_pose_delay([replace(part, standoff_mm=part.standoff_mm[:-1])])
    with pytest.raises(InvalidInputError, match="grow"):
        estimate_pose_delay([replace(part, joint_times_s=part.joint_times_s[::-1])])


def test_places_are_measured_along_the_axis_of_the_chosen_pose():
    points = np.array([[0.0, 0.0, 5.0], [1.0, 0.0, 4.0], [0.0, 2.0, 3.0]])
    axes = np.tile((0.0, 0.0, -1.0), (3, 1))
    np.testing.assert_allclose(segment_places(points, axes, 1), [-1.0, 0.0, 1.0])


@pytest.mark.slow
def test_a_robot_that_drives_straight_between_its_way_points_is_not_taken_for_breaks():
    """Way points 20 ms apart, joint angles every 16 ms: what is between is not known."""
    errors, stated = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        begins, phase_s = rng.uniform(0.25, 0.35), rng.uniform(0.0, 0.02)
        way_points = np.arange(-0.2, 1.4, 0.02) + phase_s
        speeds = -np.clip(130.0 * (way_points - begins), 0.0, 15.0)
        places = np.concatenate(([0.0], np.cumsum(0.01 * (speeds[1:] + speeds[:-1]))))

        def place(t, at=way_points, places=places):
            return np.interp(t, at, places)

        scans, joints = np.arange(0.1, 0.6, 0.016), np.arange(0.0, 1.0, 0.016)
        noise_mm = rng.normal(0.0, 0.0005, len(scans))
        part = EchoSegment(scans, 0.7 - place(scans) + noise_mm, joints, place(joints - 0.008))
        found = estimate_pose_delay([part])
        assert found.n_pieces == 1
        errors.append(found.delay_s - 0.008)
        stated.append(found.sigma_s)
    ratio = float(np.mean((np.array(errors) / np.array(stated)) ** 2))
    assert ratio < 1.35
    assert np.sqrt(np.mean(np.square(errors))) < 3e-4
