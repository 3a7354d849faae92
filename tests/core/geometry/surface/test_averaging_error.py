import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.geometry.surface.cloud import (
    averaging_covariances,
    build_cloud,
    frame_covariance,
    merge_clouds,
)
from tests.helpers.strategies import random_pose, seeds

AVERAGE_S, FRAMES = 0.1, 7
TIMES = np.arange(1200) / 60.0


def clouds(points, times=TIMES):
    return build_cloud(points, times), build_cloud(points, times, average_s=AVERAGE_S)


def way(rough_mm=0.0, wave_mm=4.0):
    """Along x at 30 mm/s over waves that are high where x is large."""
    x = 30.0 * TIMES
    z = rough_mm * x / x.max() * np.sin(2.0 * np.pi * x / wave_mm)
    return np.column_stack((x, 0.0 * x, z))


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_covariances_turn_with_the_points(seed):
    rng = np.random.default_rng(seed)
    points, T = way(0.1) + rng.normal(0.0, 0.02, (len(TIMES), 3)), random_pose(rng)
    R, found = T.rotation, averaging_covariances(*clouds(points), FRAMES)
    turned = averaging_covariances(*clouds(T @ points), FRAMES)
    np.testing.assert_allclose(turned, R @ found @ R.T, atol=1e-10)


def test_noise_of_a_frame_is_found_along_a_way_and_falls_with_their_number():
    noise = np.array((0.02, 0.05, 0.1))
    points = way(0.1) + np.random.default_rng(0).normal(0.0, noise, (len(TIMES), 3))
    single, _ = clouds(points)
    np.testing.assert_allclose(np.sqrt(np.diag(frame_covariance(single))), noise, rtol=0.1)
    white = clouds(way() + np.random.default_rng(1).normal(0.0, 0.1, (len(TIMES), 3)))
    errors = white[1].points_base - way()
    predicted = np.einsum("nii->n", averaging_covariances(*white, FRAMES))
    assert np.mean((errors**2).sum(axis=1)) == pytest.approx(predicted.mean(), rel=0.15)
    once = averaging_covariances(single, single, 1)
    np.testing.assert_allclose(once, np.broadcast_to(frame_covariance(single), once.shape))


def test_what_an_average_rounds_off_is_found_where_it_is():
    true = way(0.15)
    points = true + np.random.default_rng(2).normal(0.0, 0.005, true.shape)
    single, averaged = clouds(points)
    errors = (averaged.points_base - true)[:, 2]
    sigmas = np.sqrt(averaging_covariances(single, averaged, FRAMES)[:, 2, 2])
    assert np.mean(sigmas**2) == pytest.approx(np.mean(errors**2), rel=0.15)
    assert np.corrcoef(sigmas, np.abs(errors))[0, 1] > 0.9


def test_differences_span_neither_strokes_nor_hidden_frames():
    points = way() + np.random.default_rng(3).normal(0.0, 0.02, (len(TIMES), 3))
    seen = np.arange(len(TIMES)) % 40 > 9
    broken = points + np.where(TIMES < 10.0, 0.0, 500.0)[:, None]
    single = build_cloud(broken[seen], TIMES[seen])
    both = merge_clouds([single, build_cloud(points, TIMES)])
    assert np.sqrt(np.trace(frame_covariance(both)) / 3.0) == pytest.approx(0.02, rel=0.1)
    short = build_cloud(points[:5], TIMES[:5])
    assert np.isfinite(averaging_covariances(short, short, FRAMES)).all()


def test_still_frames_without_noise_have_no_error():
    still = np.zeros((20, 3))
    assert not averaging_covariances(*clouds(still, TIMES[:20]), FRAMES).any()
