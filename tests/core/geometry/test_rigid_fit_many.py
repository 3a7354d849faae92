"""Many fits at once agree with the single ones, follow rigid motions, and refuse by name."""

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.geometry.rigid_fit import (
    fit_line_many,
    fit_rigid_many,
    register_points,
    smallest_rotations,
)
from tests.helpers.strategies import seeds

BODY = np.array([[-45.0, -28.0, 0.0], [43.0, -34.0, 0.0], [36.0, 31.0, 0.0], [-34.0, 33.0, 0.0]])
LINE = np.array([0.0, 60.0, 130.0])


def measured(seed, points, n=12, noise_mm=0.3):
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(n, rng=rng).as_matrix()
    shifts = rng.uniform(-2000.0, 2000.0, (n, 1, 3))
    clean = np.einsum("nij,mj->nmi", rotations, points) + shifts
    return clean + rng.normal(0.0, noise_mm, clean.shape), rng


@settings(max_examples=25)
@given(seed=seeds)
def test_each_fit_is_the_one_of_a_single_registration(seed):
    points, rng = measured(seed, BODY)
    there = np.ones((12, 4), dtype=bool)
    there[np.arange(6), rng.integers(0, 4, 6)] = False
    points[~there] = np.nan  # what is not there must not matter
    fits = fit_rigid_many(BODY, points, there)
    for i, pose in enumerate(fits.Ts_b_a):
        single = register_points(BODY[there[i]], points[i, there[i]])
        np.testing.assert_allclose(pose.matrix(), single.T_b_a.matrix(), atol=1e-9)
        assert fits.rms_mm[i] == pytest.approx(single.rms_mm, abs=1e-9)


@settings(max_examples=25)
@given(seed=seeds)
def test_moving_the_measurements_moves_every_pose(seed):
    points, rng = measured(seed, BODY)
    there = rng.random((12, 4)) < 0.8
    there[:, :3] |= there.sum(axis=1, keepdims=True) < 3
    motion = Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-500, 500, 3))
    fits = fit_rigid_many(BODY, points, there)
    moved = fit_rigid_many(BODY, motion @ points.reshape(-1, 3).reshape(12, 4, 3), there)
    expected = motion @ fits.Ts_b_a
    np.testing.assert_allclose(moved.Ts_b_a.rotations, expected.rotations, atol=1e-9)
    np.testing.assert_allclose(moved.Ts_b_a.translations, expected.translations, atol=1e-8)
    np.testing.assert_allclose(moved.rms_mm, fits.rms_mm, atol=1e-9)


@settings(max_examples=25)
@given(seed=seeds)
def test_a_line_is_found_and_its_turn_is_the_smallest(seed):
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(9, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    origins = rng.uniform(-2000, 2000, (9, 3))
    points = origins[:, None] + LINE[:, None] * directions[:, None]
    there = np.ones((9, 3), dtype=bool)
    there[:3, 1] = False
    fits = fit_line_many(LINE, points, there)
    np.testing.assert_allclose(fits.Ts_b_a.rotations[:, :, 2], directions, atol=1e-9)
    np.testing.assert_allclose(fits.Ts_b_a.translations, origins, atol=1e-9)
    turn = Rotation.from_matrix(fits.Ts_b_a.rotations).magnitude()
    np.testing.assert_allclose(turn, np.arccos(np.clip(directions[:, 2], -1, 1)), atol=1e-6)


def test_the_smallest_rotation_exists_in_every_direction():
    tiny = 1e-9
    directions = np.array(
        [[0, 0, 1], [0, 0, -1], [tiny, 0, -1], [0, -tiny, 1], [1, 0, 0], [0, 0.6, -0.8]], float
    )
    rotations = smallest_rotations(directions)
    np.testing.assert_allclose(rotations @ np.swapaxes(rotations, 1, 2), [np.eye(3)] * 6, atol=1e-9)
    np.testing.assert_allclose(rotations[:, :, 2], directions, atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)


def test_what_determines_no_pose_is_refused_with_its_row():
    points, _ = measured(0, BODY, n=3)
    there = np.ones((3, 4), dtype=bool)
    few = there.copy()
    few[1, :2] = False
    with pytest.raises(InvalidInputError, match="measurement 1 has 2 points"):
        fit_rigid_many(BODY, points, few)
    flat = points.copy()
    flat[2] = flat[2, 0] + np.arange(4)[:, None] * 20.0
    with pytest.raises(DegenerateGeometryError, match="measurement 2") as refused:
        fit_rigid_many(BODY, flat, there)
    assert refused.value.data == {"row": 2}
    with pytest.raises(InvalidInputError, match="finite"):
        fit_rigid_many(BODY, np.full_like(points, np.nan), there)
    with pytest.raises(InvalidInputError, match="expected points_b"):
        fit_rigid_many(BODY, points[:, :3], there)
    with pytest.raises(DegenerateGeometryError, match="coincide"):
        fit_line_many(LINE, np.zeros((1, 3, 3)), np.ones((1, 3), dtype=bool))
