"""A place on the measured surface: the cloud alone says how deep it lies."""

import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.surface.surface_pick import pick_surface_point, project_to_surface
from tests.helpers.strategies import random_pose, seeds

few = settings(max_examples=25, deadline=None)
RADIUS_MM = 80.0


def cap(rng, n=3000, noise_mm=0.0):
    """Return points on the top of a sphere about the origin."""
    xy = rng.uniform(-30.0, 30.0, (n, 2))
    z = np.sqrt(RADIUS_MM**2 - (xy**2).sum(axis=1)) + noise_mm * rng.normal(size=n)
    return np.column_stack((xy, z))


@given(seed=seeds)
@few
def test_the_place_moves_with_cloud_and_eye(seed):
    rng = np.random.default_rng(seed)
    cloud, T = cap(rng, noise_mm=0.3), random_pose(rng)
    eye = np.array([*rng.uniform(-50.0, 50.0, 2), 300.0])
    ray = np.array([*rng.uniform(-15.0, 15.0, 2), 75.0]) - eye
    place = pick_surface_point(cloud, eye, ray)
    np.testing.assert_allclose(
        pick_surface_point(T @ cloud, T @ eye, T.rotate(ray)), T @ place, atol=1e-6
    )


@given(seed=seeds)
@few
def test_it_lies_on_the_line_of_sight_and_on_the_sphere_that_was_sampled(seed):
    rng = np.random.default_rng(seed)
    eye = np.array([*rng.uniform(-50.0, 50.0, 2), 300.0])
    ray = np.array([*rng.uniform(-15.0, 15.0, 2), 78.0]) - eye
    place = pick_surface_point(cap(rng), eye, ray)
    assert np.linalg.norm(np.cross(place - eye, ray)) / np.linalg.norm(ray) < 1e-9
    assert np.linalg.norm(place) == pytest.approx(RADIUS_MM, abs=0.12)  # sag over 5 mm: 0.16


def test_a_cloud_that_is_off_takes_the_place_along():
    """Were the true surface looked at, the shift of the measured one would not be seen."""
    rng = np.random.default_rng(1)
    cloud, eye = cap(rng), np.array([0.0, 0.0, 300.0])
    for shift in (-2.0, 0.0, 2.0):
        place = pick_surface_point(np.add(cloud, (0.0, 0.0, shift)), eye, (0.0, 0.0, -1.0))
        assert place[2] == pytest.approx(RADIUS_MM + shift, abs=0.12)


def test_of_two_sheets_the_one_in_front_is_met():
    rng = np.random.default_rng(2)
    cloud = cap(rng)
    both = np.vstack((cloud, cloud - (0.0, 0.0, 40.0)))
    place = pick_surface_point(both, (0.0, 0.0, 300.0), (0.0, 0.0, -2.0))
    assert place[2] == pytest.approx(RADIUS_MM, abs=0.12)


@given(seed=seeds)
@few
def test_beside_a_place_means_along_the_normal(seed):
    rng = np.random.default_rng(seed)
    aim = np.array([*rng.uniform(-15.0, 15.0, 2), 78.0])
    aim *= RADIUS_MM / np.linalg.norm(aim)
    place = project_to_surface(cap(rng), aim * 1.01)
    np.testing.assert_allclose(place, aim, atol=0.25)


def test_where_nothing_was_measured_nothing_is_made_up():
    cloud = cap(np.random.default_rng(3))
    with pytest.raises(DegenerateGeometryError, match="slide the pointer"):
        pick_surface_point(cloud, (60.0, 0.0, 300.0), (0.0, 0.0, -1.0))
    with pytest.raises(DegenerateGeometryError, match="slide the pointer"):
        project_to_surface(cloud, (200.0, 0.0, 0.0))
    with pytest.raises(DegenerateGeometryError, match="slide the pointer"):
        pick_surface_point(cloud[:3], cloud[0] + (0.0, 0.0, 100.0), (0.0, 0.0, -1.0))
    with pytest.raises(DegenerateGeometryError, match="slide the pointer"):
        pick_surface_point(cloud, (0.0, 0.0, 300.0), (0.0, 0.0, 1.0))  # looking away
    with pytest.raises(InvalidInputError, match="direction"):
        pick_surface_point(cloud, (0.0, 0.0, 300.0), (0.0, 0.0, 0.0))
