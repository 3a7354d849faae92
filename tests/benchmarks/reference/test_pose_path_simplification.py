import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from benchmarks.reference.path.brute_force_simplification import within_frechet
from benchmarks.reference.path.pose_path_simplification import simplify_poses
from rona_core.errors import InvalidInputError
from rona_core.path.simplification.simplify import METHODS, simplify
from tests.helpers.paths import demonstration
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=15, deadline=None)


def swinging(rng, n=60, noise_rad=0.02):
    """Positions and rotations of a hand that turns as it goes."""
    path, _ = demonstration(rng, n, 35.0 * n / 307)
    slow = np.cumsum(rng.normal(0, 0.03, (n, 3)), axis=0)
    return path, Rotation.from_rotvec(slow) * Rotation.from_rotvec(rng.normal(0, noise_rad, (n, 3)))


def worst(points, rotations, a, b):
    """Distance, and angle to slerp at the foot, of the originals from a to b."""
    chord = points[b] - points[a]
    along = Slerp([0.0, 1.0], rotations[[a, b]])
    shares = [
        np.clip((points[k] - points[a]) @ chord / (chord @ chord), 0, 1) for k in range(a, b + 1)
    ]
    places = points[a] + np.array(shares)[:, None] * chord
    turns = (along(shares).inv() * rotations[a : b + 1]).magnitude()
    return np.linalg.norm(places - points[a : b + 1], axis=1).max(), np.rad2deg(turns.max())


@given(seed=seeds, method=st.sampled_from(METHODS))
@few
def test_both_bounds_hold_and_are_reported(seed, method):
    points, rotations = swinging(np.random.default_rng(seed))
    quaternions = rotations.as_quat() * np.where(np.arange(60) % 3 == 0, -1.0, 1.0)[:, None]
    found = simplify_poses(points, quaternions, 1.0, 4.0, method=method)
    pairs = list(zip(found.index[:-1], found.index[1:], strict=True))
    figures = np.array([worst(points, rotations, a, b) for a, b in pairs])
    assert found.k1_mm == pytest.approx(figures[:, 0].max(), abs=1e-9)
    assert found.turn_deg == pytest.approx(figures[:, 1].max(), abs=1e-6)
    assert found.k1_mm <= 1.0 + 1e-9
    assert found.turn_deg <= 4.0 + 1e-9
    assert found.where_turn == pairs[int(figures[:, 1].argmax())][0] or found.turn_deg < 1e-6
    assert within_frechet(points, found.index, 1.0 + 1e-9)
    assert found.lower_bound <= len(found)


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=4, deadline=None)
def test_optimal_keeps_as_few_poses_as_trying_everything(seed):
    points, rotations = swinging(np.random.default_rng(seed), 24)
    steps = [0] + [99] * 23
    for j in range(1, 24):
        for i in range(j):
            mm, deg = worst(points, rotations, i, j)
            if j == i + 1 or (mm <= 1.0 and deg <= 3.0):
                steps[j] = min(steps[j], steps[i] + 1)
    found = simplify_poses(points, rotations.as_quat(), 1.0, 3.0, frechet=False)
    assert len(found) == steps[-1] + 1
    assert found.exact


@given(seed=seeds)
@few
def test_a_wide_bound_on_the_angle_leaves_the_positions_alone(seed):
    points, rotations = swinging(np.random.default_rng(seed))
    axes = rotations.apply((0.0, 0.0, 1.0))
    wide = simplify_poses(points, axes, 1.0, 179.0)
    np.testing.assert_array_equal(wide.index, simplify(points, 1.0).index)
    tight = simplify_poses(points, axes, 1e3, 2.0)
    assert tight.turn_deg <= 2.0 + 1e-9
    assert len(tight) > 2


@given(seed=seeds)
@few
def test_moving_the_poses_keeps_the_same_ones(seed):
    rng = np.random.default_rng(seed)
    points, rotations = swinging(rng)
    T = random_pose(rng, 100.0)
    axes = rotations.apply((0.0, 0.0, 1.0))
    found = simplify_poses(points, axes, 1.0, 4.0)
    moved = simplify_poses(T @ points, T.rotate(axes), 1.0, 4.0)
    np.testing.assert_array_equal(moved.index, found.index)


def test_a_turn_in_place_is_kept_in_proportion():
    angles = np.deg2rad(np.concatenate((np.linspace(0, 60, 31), np.linspace(60, 0, 31)[1:])))
    axes = np.column_stack((np.sin(angles), 0 * angles, np.cos(angles)))
    found = simplify_poses(np.ones((61, 3)), axes, 1.0, 1.0)
    assert found.index.tolist() == [0, 30, 60]
    opposite = simplify_poses(np.zeros((3, 3)), [[0, 0, 1], [1, 0, 0], [0, 0, -1]], 1.0, 170.0)
    assert len(opposite) == 3  # between opposite axes the way is undefined


def test_poses_that_must_stay_do():
    points, rotations = swinging(np.random.default_rng(0))
    found = simplify_poses(points, rotations.as_quat(), 5.0, 90.0, keep=[7, 33])
    assert {7, 33} <= set(found.index.tolist())


def test_wrong_input_is_refused():
    points = np.zeros((2, 3))
    with pytest.raises(InvalidInputError, match="shape"):
        simplify_poses(points, np.zeros((2, 2)), 1.0, 1.0)
    with pytest.raises(InvalidInputError, match="length"):
        simplify_poses(points, np.zeros((2, 3)), 1.0, 1.0)
    with pytest.raises(InvalidInputError, match="tolerances"):
        simplify_poses(points, [[0, 0, 1], [0, 0, 1]], 1.0, 0.0)
    with pytest.raises(InvalidInputError, match="method"):
        simplify_poses(points, [[0, 0, 1], [0, 0, 1]], 1.0, 1.0, method="magic")
