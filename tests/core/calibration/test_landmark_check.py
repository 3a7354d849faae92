"""Landmarks by robot and by pointer: distances, limits and verdict."""

import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.calibration.landmark_check import LandmarkCheck, require_enough
from rona_core.errors import DegenerateGeometryError
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=15, deadline=None)
NAMES = ("a", "b", "c", "d", "e")
PLACES = np.array([(-90.0, 170, 0), (-90, -170, 0), (90, 170, 0), (90, -170, 0), (170, 0, -20)])
SIGMAS = np.array((0.4, 0.5, 0.3, 0.3, 0.4))


def check(apart, seen=None, limit_mm=2.0, places=PLACES):
    seen = np.ones(5, dtype=bool) if seen is None else seen
    apart = np.where(seen[:, None], apart, 0.0)
    return LandmarkCheck(NAMES, places, places + apart, seen, SIGMAS * seen, 3.0, limit_mm)


@given(seed=seeds)
@few
def test_moving_the_frame_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    T, apart = random_pose(rng), rng.normal(0, 0.5, (5, 3))
    here, there = check(apart), check(T.rotate(apart), places=np.asarray(T @ PLACES))
    np.testing.assert_allclose(there.distances_mm, here.distances_mm, atol=1e-9)
    assert there.reasons == here.reasons


def test_each_landmark_has_a_limit_of_its_own_and_none_is_above_the_common_one():
    apart = np.zeros((5, 3))
    apart[3] = (0.0, 0.54, 0.72)
    found = check(apart)
    np.testing.assert_allclose(found.distances_mm, (0, 0, 0, 0.9, 0))
    np.testing.assert_allclose(found.limits_mm, 3.0 * SIGMAS)
    assert found.verdict == "pass"
    assert found.rms_mm == pytest.approx(0.9 / np.sqrt(5))
    assert found.expected_rms_mm == pytest.approx(np.sqrt((SIGMAS**2).mean()))
    assert check(1.01 * apart).verdict == "fail"
    tight = check(apart, limit_mm=0.8)
    assert tight.reasons == ("landmark 'd' is 0.90 mm off, at most 0.80 mm are allowed",)


def test_the_worst_landmark_is_named_first():
    apart = np.zeros((5, 3))
    apart[1], apart[4] = (3.0, 0.0, 0.0), (0.0, 4.0, 0.0)
    first, second = check(apart).reasons
    assert ("'e' is 4.00" in first, "'b' is 3.00" in second) == (True, True)


def test_a_landmark_that_was_not_seen_counts_for_nothing():
    seen = np.array([True, True, False, True, True])
    apart = np.full((5, 3), 0.1)
    apart[2] = 50.0
    found = check(apart, seen)
    assert found.verdict == "pass"
    assert found.rms_mm == pytest.approx(np.sqrt(0.03))
    with pytest.raises(DegenerateGeometryError, match="on 2 of 5 landmarks, 3 are the least"):
        require_enough(np.array([True, True, False, False, False]))
