import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.errors import InvalidInputError
from rona_core.path.path_samples import cutoff_hz, filter_path
from tests.helpers.paths import demonstration
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)


@given(seed=seeds)
@few
def test_moving_the_path_moves_the_filtered_one(seed):
    rng = np.random.default_rng(seed)
    (path, times), T = demonstration(rng, 100, 4.0), random_pose(rng)
    np.testing.assert_allclose(
        filter_path(T @ path, times + 9.0), T @ filter_path(path, times), atol=1e-7
    )
    back = filter_path(path[::-1], -times[::-1])[::-1]
    np.testing.assert_allclose(back, filter_path(path, times), atol=1e-9)  # nothing lags


@given(seed=seeds)
@few
def test_even_motion_passes_unchanged_with_missing_frames(seed):
    rng = np.random.default_rng(seed)
    times = np.sort(rng.choice(np.arange(300), 150, replace=False)) / 60.0
    line = 500.0 + np.outer(times, rng.normal(0, 30, 3))
    np.testing.assert_allclose(filter_path(line, times), line, atol=1e-9)


@pytest.mark.parametrize("frequency_hz", [1.0, 2.65, 5.0])
def test_the_gain_is_that_of_a_gaussian(frequency_hz):
    times = np.arange(600) / 60.0
    wave = np.sin(2 * np.pi * frequency_hz * times)[:, None]
    middle = slice(60, -60)
    expected = np.exp(-0.5 * (2 * np.pi * frequency_hz * 0.05) ** 2) * wave[middle]
    np.testing.assert_allclose(filter_path(wave, times)[middle], expected, atol=2e-3)


def test_the_cutoff_is_where_half_the_power_passes():
    f = cutoff_hz(0.05)
    assert f == pytest.approx(2.65, abs=0.005)
    assert np.exp(-((2 * np.pi * f * 0.05) ** 2)) == pytest.approx(0.5)


def test_uneven_sampling_gives_what_even_sampling_gives():
    rng = np.random.default_rng(0)

    def at(t):
        return np.column_stack((20 * t, 3 * np.sin(5 * t), 2 * np.cos(9 * t)))

    even = np.linspace(0, 3, 721)
    uneven = np.sort(np.concatenate((even[::2], rng.uniform(1.0, 1.5, 200))))
    expected = filter_path(at(even), even)
    found = filter_path(at(uneven), uneven)
    inner = (uneven > 0.3) & (uneven < 2.7)
    for axis in range(3):
        np.testing.assert_allclose(
            found[inner, axis], np.interp(uneven[inner], even, expected[:, axis]), atol=0.02
        )


def test_a_pause_keeps_both_sides_apart():
    times = np.concatenate((np.arange(50) / 60, 5 + np.arange(50) / 60))
    path = np.zeros((100, 3))
    path[50:] = 70.0
    np.testing.assert_allclose(filter_path(path, times), path, atol=1e-12)
    alone = filter_path([[1.0, 2], [3, 4], [9, 9]], [0.0, 10.0, 20.0])
    np.testing.assert_allclose(alone, [[1, 2], [3, 4], [9, 9]])


def test_wrong_input_is_refused_and_zero_width_is_no_filter():
    path, times = demonstration(np.random.default_rng(0), 20)
    np.testing.assert_array_equal(filter_path(path, times, 0.0), path)
    with pytest.raises(InvalidInputError, match="increasing"):
        filter_path(path, times[::-1])
    with pytest.raises(InvalidInputError, match="increasing"):
        filter_path(path, times[1:])
    with pytest.raises(InvalidInputError, match="sigma_s"):
        filter_path(path, times, -1.0)
