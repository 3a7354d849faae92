import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.path.path_samples import densify, insert_waypoints
from tests.helpers.strategies import random_pose, seeds, unit_vectors

few = settings(max_examples=25, deadline=None)


def way_points(rng, n=12):
    axes = unit_vectors(rng, n) * 0.4 + (0, 0, 1)
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return np.cumsum(rng.normal(0, 4, (n, 3)), axis=0), axes


def turns_deg(axes):
    a, b = axes[:-1], axes[1:]
    return np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))


@given(seed=seeds)
@few
def test_moving_the_way_points_moves_the_dense_path(seed):
    rng = np.random.default_rng(seed)
    (points, axes), T = way_points(rng), random_pose(rng)
    path, moved = densify(points, axes), densify(T @ points, T.rotate(axes))
    np.testing.assert_allclose(moved.points_base, T @ path.points_base, atol=1e-8)
    np.testing.assert_allclose(moved.axes_base, T.rotate(path.axes_base), atol=1e-9)
    back = densify(points[::-1], axes[::-1])
    np.testing.assert_allclose(back.points_base[::-1], path.points_base, atol=1e-9)
    np.testing.assert_allclose(back.axes_base[::-1], path.axes_base, atol=1e-9)


@given(seed=seeds, step_mm=st.sampled_from([0.3, 1.0, 50.0]), step_deg=st.sampled_from([0.5, 90.0]))
@few
def test_steps_are_bounded_and_no_more_than_needed(seed, step_mm, step_deg):
    points, axes = way_points(np.random.default_rng(seed))
    path = densify(points, axes, step_mm=step_mm, step_deg=step_deg)
    assert np.linalg.norm(np.diff(path.points_base, axis=0), axis=1).max() <= step_mm + 1e-9
    assert turns_deg(path.axes_base).max() <= step_deg + 1e-6
    needed = np.maximum(
        np.ceil(np.linalg.norm(np.diff(points, axis=0), axis=1) / step_mm),
        np.ceil(turns_deg(axes) / step_deg),
    )
    assert len(path) == 1 + needed.sum()


@given(seed=seeds)
@few
def test_every_way_point_is_met_exactly_and_in_order(seed):
    points, axes = way_points(np.random.default_rng(seed))
    path = densify(points, axes)
    rows = [int(np.flatnonzero((path.points_base == p).all(axis=1))[0]) for p in points]
    assert rows == sorted(rows)
    assert (rows[0], rows[-1]) == (0, len(path) - 1)
    np.testing.assert_allclose(path.axes_base[rows], axes, rtol=0, atol=1e-15)


@given(seed=seeds, angle=st.sampled_from([1e-9, 1e-4, 1.0, 3.0]))
@few
def test_axes_follow_the_great_circle_as_slerp_does(seed, angle):
    rng = np.random.default_rng(seed)
    a = unit_vectors(rng, 1)[0]
    across = np.cross(a, unit_vectors(rng, 1)[0])
    rotvec = angle * across / np.linalg.norm(across)
    b = Rotation.from_rotvec(rotvec).apply(a)
    path = densify([[0, 0, 0], [8, 0, 0]], [a, b], step_mm=1.0, step_deg=179.0)
    slerp = Slerp([0, 8], Rotation.from_rotvec([np.zeros(3), rotvec]))
    np.testing.assert_allclose(path.axes_base, slerp(np.arange(9)).apply(a), atol=1e-12)
    np.testing.assert_allclose(path.points_base[:, 0], np.arange(9), atol=1e-12)


def test_repeated_way_points_appear_once_and_turns_in_place_are_divided():
    z, x = (0, 0, 1.0), (1.0, 0, 0)
    path = densify([[0, 0, 0], [0, 0, 0], [2, 0, 0], [2, 0, 0]], [z, z, z, x], step_deg=30.0)
    np.testing.assert_allclose(path.points_base[:, 0], (0, 1, 2, 2, 2, 2))
    np.testing.assert_allclose(turns_deg(path.axes_base), (0, 0, 30, 30, 30), atol=1e-9)
    assert len(densify([[1, 2, 3.0]], [z])) == 1
    assert len(densify([[1, 2, 3.0]] * 4, [z] * 4)) == 1


def test_lengths_that_are_a_whole_number_of_steps_get_no_extra_step():
    z = (0, 0, 1.0)
    assert len(densify([[0.1, 0, 0], [3.1, 0, 0]], [z, z], step_mm=0.1)) == 31


def test_wrong_input_is_refused():
    z = np.array((0, 0, 1.0))
    with pytest.raises(DegenerateGeometryError, match="opposite"):
        densify(np.zeros((2, 3)), [z, -z])
    with pytest.raises(InvalidInputError, match="as many axes"):
        densify(np.zeros((2, 3)), [z])
    with pytest.raises(InvalidInputError, match="unit"):
        densify(np.zeros((1, 3)), [2 * z])
    with pytest.raises(InvalidInputError, match="positive"):
        densify(np.zeros((1, 3)), [z], step_mm=0.0)
    with pytest.raises(InvalidInputError, match="at least 1"):
        densify(np.zeros((0, 3)), np.zeros((0, 3)))


@given(seed=seeds, step=st.floats(0.5, 20.0))
@settings(max_examples=20, deadline=None)
def test_places_between_keep_the_way_points_and_the_lines(seed, step):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(0, 5, (8, 3)), axis=0)
    places = insert_waypoints(points, step)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() <= step * (1 + 1e-9)
    assert steps.sum() == pytest.approx(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    met = [int(np.flatnonzero((places == point).all(axis=1))[0]) for point in points]
    assert met == sorted(met)
    assert met[0] == 0
    assert met[-1] == len(places) - 1
