import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.geometry.surface.cloud import build_cloud, merge_clouds
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)


def stroke(rng, n=200, rate_hz=60.0, noise_mm=0.2):
    times = np.arange(n) / rate_hz
    points = np.column_stack((40 * times, 5 * np.sin(times), 0 * times))
    return points + rng.normal(0, noise_mm, (n, 3)), times


@given(seed=seeds, average_s=st.sampled_from([0.0, 0.1]))
@few
def test_moving_the_samples_moves_the_cloud(seed, average_s):
    rng = np.random.default_rng(seed)
    points, times = stroke(rng)
    points[rng.integers(10, 190)] += 40.0
    T = random_pose(rng)
    cloud = build_cloud(points, times, average_s=average_s)
    moved = build_cloud(T @ points, times + 7.0, average_s=average_s)
    np.testing.assert_allclose(moved.points_base, T @ cloud.points_base, atol=1e-8)
    assert moved.n_dropped == cloud.n_dropped == 1


def test_stray_samples_and_flights_are_dropped_and_counted():
    rng = np.random.default_rng(0)
    points, times = stroke(rng)
    points[50] += (0, 0, 30)
    points[100:104] += (0, 0, 50)
    cloud = build_cloud(points, times)
    expected = np.delete(np.arange(200), [50, 100, 101, 102, 103])
    np.testing.assert_array_equal(cloud.points_base, points[expected])
    np.testing.assert_array_equal(cloud.times_s, times[expected])
    assert (cloud.n_raw, cloud.n_dropped, len(cloud)) == (200, 5, 195)
    np.testing.assert_array_equal(np.bincount(cloud.strokes), [50, 49, 96])


def test_a_slide_without_jumps_stays_complete():
    points, times = stroke(np.random.default_rng(1), noise_mm=0.35)
    cloud = build_cloud(points, times)
    np.testing.assert_array_equal(cloud.points_base, points)
    assert cloud.n_dropped == 0
    assert (cloud.strokes == 0).all()


def test_the_average_keeps_even_motion_and_cuts_noise():
    times = np.arange(120) / 60.0
    line = np.outer(times, (30.0, -20.0, 5.0)) + 1000.0
    smooth = build_cloud(line, times, average_s=0.15).points_base
    np.testing.assert_allclose(smooth, line, atol=1e-9)
    noise = np.random.default_rng(2).normal(0, 0.3, line.shape)
    noisy = build_cloud(line + noise, times, average_s=0.15)
    inner = slice(6, -6)
    ratio = (noisy.points_base - line)[inner].std() / noise[inner].std()
    assert ratio == pytest.approx(1 / 3, rel=0.15)  # nine samples in each mean
    assert noisy.average_s == 0.15


def test_the_average_is_the_plain_mean_of_its_window():
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.01, 0.03, 60))
    points = rng.normal(0, 0.5, (60, 3))
    cloud = build_cloud(points, times, average_s=0.2)
    for i in (0, 3, 30, 59):
        half = min(0.1, times[i] - times[0], times[-1] - times[i])
        near = np.abs(times - times[i]) <= half + 1e-9
        np.testing.assert_allclose(cloud.points_base[i], points[near].mean(axis=0), atol=1e-9)


def test_the_average_never_reaches_across_a_pause_or_jump():
    times = np.concatenate((np.arange(30) / 60, 5 + np.arange(30) / 60))
    points = np.zeros((60, 3))
    points[30:] = 80.0
    cloud = build_cloud(points, times, average_s=0.3)
    np.testing.assert_allclose(cloud.points_base, points, atol=1e-12)
    np.testing.assert_array_equal(np.bincount(cloud.strokes), [30, 30])


def test_captures_add_up():
    rng = np.random.default_rng(4)
    first, second = (build_cloud(*stroke(rng)) for _ in range(2))
    both = merge_clouds((first, second))
    np.testing.assert_array_equal(
        both.points_base, np.vstack((first.points_base, second.points_base))
    )
    np.testing.assert_array_equal(np.bincount(both.strokes), [200, 200])
    assert (both.n_raw, both.n_dropped) == (400, 0)


def test_empty_captures_give_empty_clouds():
    cloud = build_cloud(np.zeros((0, 3)), [])
    assert (len(cloud), cloud.n_raw, cloud.n_dropped) == (0, 0, 0)
    assert len(build_cloud(np.zeros((3, 3)), [0.0, 0.1, 0.2])) == 0
    assert len(merge_clouds((cloud, cloud))) == 0


def test_wrong_input_is_refused():
    points, times = stroke(np.random.default_rng(0), n=10)
    with pytest.raises(InvalidInputError, match="increase"):
        build_cloud(points, times[::-1])
    with pytest.raises(InvalidInputError, match="as many times"):
        build_cloud(points, times[:-1])
    with pytest.raises(InvalidInputError, match="average_s"):
        build_cloud(points, times, average_s=-0.1)
    with pytest.raises(InvalidInputError, match="no clouds"):
        merge_clouds(())
