"""Surface nets of closed forms are closed, face outwards and lie where they should."""

import numpy as np
import pytest

from rona_core.geometry.mesh import surface_nets

RADIUS = 8.3


@pytest.fixture(scope="module")
def ball():
    grid = np.stack(np.meshgrid(*[np.arange(21.0)] * 3, indexing="ij"), axis=-1) - 10.2
    values = RADIUS - np.linalg.norm(grid, axis=-1)
    points, faces = surface_nets(values)
    return points - 10.2, faces


def test_the_surface_of_a_ball_has_its_radius(ball):
    radii = np.linalg.norm(ball[0], axis=1)
    np.testing.assert_allclose(radii, RADIUS, atol=0.12)
    assert abs(radii.mean() - RADIUS) < 0.05


def test_it_is_closed_and_of_one_piece(ball):
    points, faces = ball
    edges = np.concatenate((faces[:, :2], faces[:, 1:], faces[:, ::2][:, ::-1]))
    there = {tuple(edge) for edge in edges.tolist()}
    assert len(there) == len(edges)  # each direction once
    assert all((b, a) in there for a, b in there)
    assert len(points) - len(edges) // 2 + len(faces) == 2  # Euler


def test_it_faces_outwards_and_encloses_the_volume(ball):
    a, b, c = (ball[0][ball[1][:, k]] for k in range(3))
    volume = np.einsum("ni,ni->", a, np.cross(b, c)) / 6.0
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.02)


def test_it_is_open_where_voxels_are_not_known():
    grid = np.stack(np.meshgrid(*[np.arange(21.0)] * 3, indexing="ij"), axis=-1) - 10.2
    values = RADIUS - np.linalg.norm(grid, axis=-1)
    known = grid[..., 2] < 0.0
    points, faces = surface_nets(values, known)
    assert len(faces)
    assert (points[:, 2] - 10.2).max() <= 0.0


def test_nothing_crossed_is_an_empty_surface():
    points, faces = surface_nets(np.ones((4, 5, 6)))
    assert points.shape == (0, 3)
    assert faces.shape == (0, 3)
