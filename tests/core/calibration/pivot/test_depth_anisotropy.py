"""The depth ratio of a tracker, from what a rigid fit leaves over."""

import numpy as np
import pytest

from rona_core.calibration.pivot.depth_anisotropy import MAX_RATIO, estimate_marker_noise
from rona_core.geometry.batch_fit import fit_line_many, fit_rigid_many
from tests.helpers.strategies import random_pose

BODY = np.array([[-45.0, -28.0, 0.0], [43.0, -34.0, 0.0], [36.0, 31.0, 0.0], [-34.0, 33.0, 0.0]])
LINE = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 60.0], [0.0, 0.0, 130.0]])


def told(ratio, body, n=300, seed=0, unseen=0):
    rng = np.random.default_rng(seed)
    made = [random_pose(rng, 300.0) for _ in range(n)]
    points = np.stack([pose @ body for pose in made])
    points += rng.normal(size=points.shape) * (0.1, 0.1, 0.1 * ratio)
    seen = np.ones(points.shape[:2], dtype=np.bool_)
    seen[:unseen, 0] = False
    if body is LINE:
        poses = fit_line_many(body[:, 2], points, seen).Ts_b_a
    else:
        poses = fit_rigid_many(body, points, seen).Ts_b_a
    return estimate_marker_noise(points, seen, poses, body).depth_ratio


@pytest.mark.parametrize("body", [BODY, LINE], ids=["6D", "5D"])
@pytest.mark.parametrize("ratio", [1.5, 3.0, 4.5])
def test_the_ratio_of_the_errors_is_found(body, ratio):
    found = [told(ratio, body, seed=seed) for seed in range(8)]
    assert np.median(found) == pytest.approx(ratio, rel=0.12)


def test_a_tracker_that_is_better_in_depth_counts_as_even():
    assert told(0.3, BODY) == 1.0


def test_nothing_is_claimed_from_a_few_frames_and_little_is_not_overstated():
    assert told(3.0, BODY, n=4) == 1.0
    assert told(3.0, BODY, n=100, unseen=100) == 1.0
    assert told(1000.0, BODY) == MAX_RATIO
