"""Planes and quadrics through neighbourhoods against surfaces whose normals are known."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.geometry.surface.normals.normal_estimator import (
    Neighbourhoods,
    fit_jets,
    fit_planes,
)
from rona_core.geometry.surface.normals.point_grid import PointGrid


def near(offsets):
    """Return neighbourhoods (b, k, 3), the last of each one short."""
    there = np.ones(offsets.shape[:2], dtype=bool)
    there[:, -1] = False
    offsets[:, -1] = 0.0
    rows = np.random.default_rng(0).permutation(10 * there.size)[: there.size]
    return Neighbourhoods(np.arange(len(offsets)), offsets, there, rows.reshape(there.shape))


def turns(seed, n=6):
    return Rotation.random(n, rng=np.random.default_rng(seed)).as_matrix()


def discs(seed, n=6, k=40, radius=4.0):
    return np.random.default_rng(seed).uniform(-radius, radius, (n, k, 2))


def plane(points):
    """Return the normal, variances and centroid of the plane through ``points`` (k, 3)."""
    found = fit_planes(PointGrid(points, 100.0).moments(np.zeros((1, 3))))
    return found.normals[0], found.eigenvalues[0], found.centroids[0]


def test_points_of_a_plane_have_its_normal_and_its_distance():
    for R, flat in zip(turns(0), discs(1), strict=True):
        points = np.column_stack((flat, np.full(len(flat), 0.7))) @ R.T
        normal, variances, centroid = plane(points)
        np.testing.assert_allclose(np.abs(normal @ R[:, 2]), 1.0, atol=1e-12)
        np.testing.assert_allclose(centroid @ R[:, 2], 0.7, atol=1e-12)
        assert variances[0] == 0.0


def test_normals_turn_with_the_points():
    turn = turns(3, 1)[0]
    for points in np.random.default_rng(2).normal(size=(5, 30, 3)) * (4.0, 3.0, 0.4):
        before, after = plane(points)[0], plane(points @ turn.T)[0]
        np.testing.assert_allclose(np.abs(turn @ before @ after), 1.0, atol=1e-9)


@pytest.mark.parametrize("count", [1, 2, 30])
def test_points_of_one_place_or_one_line_have_no_width(count):
    place, line = np.array((7.1, -3.3, 2.7)), np.array((0.6, -0.3, 0.7))
    _, variances, centroid = plane(np.tile(place, (count, 1)))
    np.testing.assert_array_equal(variances, 0.0)
    np.testing.assert_allclose(centroid, place, rtol=1e-14)
    _, variances, _ = plane(place + np.arange(count)[:, None] * line)
    np.testing.assert_array_equal(variances[:2], 0.0)


def test_a_quadric_has_its_normal_curvatures_and_no_noise():
    flat, R = discs(6, radius=3.0), turns(7)
    slope, bends = np.array((0.12, -0.08)), np.array((0.05, -0.02))
    z = flat @ slope + 0.5 * (flat**2) @ bends
    points = np.concatenate((flat, z[..., None]), axis=2) @ R.transpose(0, 2, 1)
    truth = np.append(-slope, 1.0) / np.sqrt(1.0 + slope @ slope)
    start = R[:, :, 2]  # not the normal: the plane leans by the slope
    found = fit_jets(near(points), start, 3.0)
    assert found.solved.all()
    angles = np.arccos(np.clip(np.einsum("bi,bi->b", found.normals, R @ truth), -1.0, 1.0))
    assert np.rad2deg(angles).max() < 0.05  # a tilted quadric is one up to the third order
    np.testing.assert_allclose(found.curvatures, np.tile(bends, (6, 1)), atol=4e-3)
    assert found.noise_mm2.max() < 1e-4


def test_a_sphere_has_equal_curvatures_and_the_radial_normal():
    flat = discs(8, radius=5.0)
    cap = np.sqrt(80.0**2 - (flat**2).sum(axis=2)) - 80.0
    points = near(np.concatenate((flat, cap[..., None]), axis=2))
    found = fit_jets(points, np.tile((0.0, 0.0, 1.0), (6, 1)), 5.0)
    np.testing.assert_allclose(found.normals, np.tile((0.0, 0.0, 1.0), (6, 1)), atol=2e-4)
    np.testing.assert_allclose(found.curvatures, -1.0 / 80.0, rtol=0.02)


def test_points_on_a_line_determine_no_quadric():
    line = np.linspace(-3.0, 3.0, 20)[None, :, None] * np.array((1.0, 0.0, 0.0))
    assert not fit_jets(near(line), np.array(((0.0, 0.0, 1.0),)), 3.0).solved.any()
