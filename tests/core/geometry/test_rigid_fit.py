import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.rigid_fit import fit_line_direction, fit_plane, register_points
from tests.helpers.strategies import random_pose, seeds, thin_points

few = settings(max_examples=25, deadline=None)


@given(seed=seeds)
@few
def test_a_rigid_motion_is_recovered_exactly(seed):
    rng = np.random.default_rng(seed)
    points_a, T_b_a = rng.normal(0, 60, (4, 3)), random_pose(rng)
    found = register_points(points_a, T_b_a @ points_a).T_b_a
    np.testing.assert_allclose(found.matrix(), T_b_a.matrix(), atol=1e-8)


@given(seed=seeds)
@few
def test_coplanar_markers_are_enough_for_a_rigid_motion(seed):
    rng = np.random.default_rng(seed)
    points_a = rng.uniform(-50, 50, (4, 3)) * (1, 1, 0) + (
        (40, 40, 0),
        (-40, 40, 0),
        (0,) * 3,
        (0,) * 3,
    )
    T_b_a = random_pose(rng)
    np.testing.assert_allclose(
        register_points(points_a, T_b_a @ points_a).T_b_a.matrix(), T_b_a.matrix(), atol=1e-8
    )


@given(seed=seeds)
@few
def test_moving_either_side_moves_the_rigid_fit(seed):
    rng = np.random.default_rng(seed)
    points_a, points_b = rng.normal(0, 60, (6, 3)), rng.normal(0, 60, (6, 3))
    T_c_b, T_d_a = random_pose(rng, 300), random_pose(rng, 300)
    fit = register_points(points_a, points_b)
    moved = register_points(T_d_a @ points_a, T_c_b @ points_b)
    expected = T_c_b @ fit.T_b_a @ T_d_a.inv()
    np.testing.assert_allclose(moved.T_b_a.matrix(), expected.matrix(), atol=1e-7)
    assert moved.rms_mm == pytest.approx(fit.rms_mm, rel=1e-9)


def test_the_rotation_agrees_with_scipy_on_noisy_points():
    rng = np.random.default_rng(3)
    a = rng.normal(0, 60, (12, 3))
    T_b_a = random_pose(rng)
    b = T_b_a @ a + rng.normal(0, 0.5, a.shape)
    expected, root = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    fit = register_points(a, b)
    np.testing.assert_allclose(fit.T_b_a.rotation, expected.as_matrix(), atol=1e-12)
    assert fit.rms_mm == pytest.approx(root / np.sqrt(12), rel=1e-9)
    np.testing.assert_allclose(fit.residuals_mm, np.linalg.norm(fit.T_b_a @ a - b, axis=1))


def test_strong_noise_never_gives_a_mirror():
    rng = np.random.default_rng(8)
    for _ in range(50):
        a = rng.normal(0, 10, (5, 3)) * (1, 1, 0.01)
        pose = register_points(a, a + rng.normal(0, 3, a.shape)).T_b_a
        assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("a", "b", "error"),
    [
        (np.zeros((2, 3)), np.zeros((2, 3)), InvalidInputError),
        (np.eye(3), np.eye(4)[:, :3], InvalidInputError),
        (np.full((3, 3), np.nan), np.eye(3), InvalidInputError),
        (np.zeros((4, 3)), np.zeros((4, 3)), DegenerateGeometryError),
        (np.outer(range(4), (1, 2, 3)), np.outer(range(4), (1, 2, 3)), DegenerateGeometryError),
        (
            np.vstack((np.eye(3), -np.eye(3))),
            np.vstack((-np.eye(3), np.eye(3))),
            DegenerateGeometryError,
        ),
    ],
    ids=["two points", "unpaired", "nan", "one place", "one line", "mirrored"],
)
def test_points_that_do_not_determine_a_pose_are_refused(a, b, error):
    with pytest.raises(error):
        register_points(a, b)


@given(seed=seeds)
@few
def test_moving_the_points_moves_plane_and_line(seed):
    rng = np.random.default_rng(seed)
    flat, T = thin_points(rng, 30, 0.5), random_pose(rng)
    plane, moved = fit_plane(flat), fit_plane(T @ flat)
    np.testing.assert_allclose(moved.point, T @ plane.point, atol=1e-8)
    assert abs(moved.normal @ T.rotate(plane.normal)) == pytest.approx(1.0, abs=1e-10)
    assert moved.rms_mm == pytest.approx(plane.rms_mm, rel=1e-7)
    thin = np.sort(rng.uniform(0, 100, 20))[:, None] * (0.6, 0.0, 0.8) + rng.normal(0, 0.3, (20, 3))
    line, moved_line = fit_line_direction(thin), fit_line_direction(T @ thin)
    np.testing.assert_allclose(moved_line.direction, T.rotate(line.direction), atol=1e-10)
    assert moved_line.rms_mm == pytest.approx(line.rms_mm, rel=1e-7)
    assert moved_line.length_mm == pytest.approx(line.length_mm, rel=1e-9)


def test_no_other_plane_is_closer():
    rng = np.random.default_rng(4)
    p = thin_points(rng, 40, 2.0) @ Rotation.from_rotvec((0.4, -0.7, 0.2)).as_matrix()

    def cost(x):
        normal = x[:3] / np.linalg.norm(x[:3])
        return (((p - p.mean(axis=0)) @ normal + x[3]) ** 2).mean()

    plane = fit_plane(p)
    best = minimize(cost, np.append(plane.normal + 0.2, 0.1), method="BFGS", options={"gtol": 1e-9})
    assert plane.rms_mm**2 == pytest.approx(best.fun, rel=1e-6)
    assert plane.normal[np.argmax(np.abs(plane.normal))] > 0


def test_the_line_points_from_first_to_last():
    p = np.outer(np.linspace(0, 50, 8), (0.0, -0.6, 0.8))
    np.testing.assert_allclose(fit_line_direction(p).direction, (0, -0.6, 0.8), atol=1e-12)
    np.testing.assert_allclose(fit_line_direction(p[::-1]).direction, (0, 0.6, -0.8), atol=1e-12)
    assert fit_line_direction(p).length_mm == pytest.approx(50)


def test_points_without_a_plane_or_line_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(DegenerateGeometryError, match="plane"):
        fit_plane(np.outer(range(5), (1.0, 0.0, 0.0)))
    with pytest.raises(DegenerateGeometryError, match="plane"):
        fit_plane(np.vstack((np.eye(3), -np.eye(3))))
    with pytest.raises(DegenerateGeometryError, match="direction"):
        fit_line_direction(np.ones((3, 3)))
    with pytest.raises(DegenerateGeometryError, match="direction"):
        fit_line_direction(np.vstack((np.eye(2, 3), -np.eye(2, 3))))
    with pytest.raises(InvalidInputError):
        fit_plane(rng.normal(size=(2, 3)))
