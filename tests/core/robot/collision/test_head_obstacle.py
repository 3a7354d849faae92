"""The head to keep clear of: what a measured patch, a registered mesh or a place tell."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.obstacles import (
    FLATTEST_MM,
    LARGE_HEAD_MM,
    TOUCH_MM,
    head_as_placed,
    head_from_cloud,
    head_from_mesh,
)


def ellipsoid(rng, sizes_mm):
    """Return points of an ellipsoid, a patch of it with its outward normal, turned at random."""
    axes = np.array(sizes_mm) / 2.0
    ways = rng.normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    turn = Rotation.random(rng=rng).as_matrix()
    middle = rng.normal(size=3)
    middle /= np.linalg.norm(middle)
    near = middle + rng.uniform(-0.35, 0.35, (1500, 3))
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    patch = near * axes
    center = middle * axes
    patch = patch[np.linalg.norm(patch - center, axis=1) < 32.0]
    normal = middle / axes
    shift = rng.uniform(-500, 500, 3)
    return (
        ways * axes @ turn.T + shift,
        patch @ turn.T + shift,
        turn @ normal / np.linalg.norm(normal),
    )


def outside_mm(points, hull_vertices):
    planes = ConvexHull(hull_vertices).equations
    return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000), shrink=st.tuples(*[st.floats(0.75, 1.0)] * 3), noise=st.booleans()
)
def test_a_large_head_lies_within_whatever_part_of_it_was_touched(seed, shrink, noise):
    """Blaschke: no radius of curvature exceeds that of the ball, so the ball contains the body."""
    rng = np.random.default_rng(seed)
    sizes = np.array(LARGE_HEAD_MM) * shrink
    half = np.sort(sizes) / 2.0
    flattest = half[2] ** 2 / half[0]
    if flattest > FLATTEST_MM:
        sizes = np.array(LARGE_HEAD_MM) * shrink[0]
    head, patch, normal = ellipsoid(rng, sizes)
    if noise:
        patch = patch + rng.normal(0, 0.3, patch.shape)
    outward = normal + rng.normal(0, 0.3, 3)
    obstacle = head_from_cloud(patch, outward / np.linalg.norm(outward), 10.0)
    assert outside_mm(head, obstacle.shape.vertices).max() <= (5.0 if noise else 3.0)
    assert outside_mm(patch, obstacle.shape.vertices).max() <= 1e-6 + 2.0 * noise
    # and not everything is head: the space above the patch is free
    above = patch.mean(axis=0) + 20.0 * normal
    assert outside_mm(above[None], obstacle.shape.vertices)[0] > 10.0
    assert TOUCH_MM <= obstacle.touch_mm <= TOUCH_MM + 25.0


def test_the_head_moves_with_the_patch():
    rng = np.random.default_rng(4)
    _, patch, normal = ellipsoid(rng, LARGE_HEAD_MM)
    motion = Pose(Rotation.random(rng=rng).as_matrix(), rng.uniform(-300, 300, 3))
    one = head_from_cloud(patch, normal, 10.0)
    other = head_from_cloud(motion @ patch, motion.rotate(normal), 10.0)
    there = motion @ one.shape.vertices
    ways = rng.normal(size=(200, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    support = [(points @ ways.T).max(axis=0) for points in (there, other.shape.vertices)]
    np.testing.assert_allclose(*support, atol=3.0)  # the corners of the ball lie elsewhere
    assert one.touch_mm == pytest.approx(other.touch_mm, abs=1.0)


def test_a_lifted_tip_does_not_raise_the_head():
    rng = np.random.default_rng(6)
    _, patch, normal = ellipsoid(rng, LARGE_HEAD_MM)
    patch = patch + rng.normal(0, 0.2, patch.shape)
    stray = patch[:15] + 40.0 * normal
    clean = head_from_cloud(patch, normal, 10.0).shape.vertices
    lifted = head_from_cloud(np.vstack((patch, stray)), normal, 10.0).shape.vertices
    assert (lifted @ normal).max() - (clean @ normal).max() < 1.5


def test_the_other_side_of_the_patch_is_never_taken():
    rng = np.random.default_rng(8)
    head, patch, normal = ellipsoid(rng, LARGE_HEAD_MM)
    wrong = head_from_cloud(patch, -normal, 10.0).shape.vertices
    assert outside_mm(head, wrong).max() > 100.0


def test_too_little_for_a_head_is_refused():
    rng = np.random.default_rng(1)
    flat = np.column_stack((rng.uniform(-20, 20, (40, 2)), np.zeros(40)))
    with pytest.raises(DegenerateGeometryError, match="12 points are too few"):
        head_from_cloud(flat[:12], (0, 0, 1), 10.0)
    line = np.outer(np.linspace(0, 80, 40), (1.0, 0, 0))
    with pytest.raises(DegenerateGeometryError, match="along a line"):
        head_from_cloud(line, (0, 0, 1), 10.0)
    with pytest.raises(InvalidInputError, match="outward_base"):
        head_from_cloud(flat, (0, 0, 0), 10.0)
    assert head_from_cloud(flat, (0, 0, 1), 10.0).shape.vertices[:, 2].max() < 1.0


def test_the_registered_mesh_and_what_was_touched_are_within():
    rng = np.random.default_rng(2)
    mesh, patch, _ = ellipsoid(rng, LARGE_HEAD_MM)
    T_base_skull = Pose(Rotation.random(rng=rng).as_matrix(), (600, 0, 300))
    touched = T_base_skull @ patch + 2.0
    obstacle = head_from_mesh(mesh, T_base_skull, touched, 10.0)
    every = np.vstack((T_base_skull @ mesh, touched))
    assert outside_mm(every, obstacle.shape.vertices).max() <= 1e-6
    assert len(obstacle.shape.vertices) < len(every)
    with pytest.raises(DegenerateGeometryError, match="enclose nothing"):
        head_from_mesh(patch[:20] * (1, 1, 0), Pose.identity(), patch[:20] * (1, 1, 0), 10.0)


def test_before_it_is_touched_a_head_may_lie_in_any_way_and_be_touched_nowhere():
    placed = head_as_placed((600, 60, 310), 10.0)
    assert 2.0 * placed.shape.radius_mm == max(LARGE_HEAD_MM)
    assert placed.touch_mm == 0.0
    np.testing.assert_array_equal(placed.pose.translation, (600, 60, 310))
