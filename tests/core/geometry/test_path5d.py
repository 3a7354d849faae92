from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.path5d import Path5D
from tests.helpers.strategies import random_rotation, seeds, unit_vectors

few = settings(max_examples=25, deadline=None)


def wavy(rng, n=30):
    axes = np.cumsum(rng.normal(0, 0.15, (n, 3)), axis=0) + unit_vectors(rng, 1)
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return Path5D(np.cumsum(rng.normal(0, 2, (n, 3)), axis=0), axes)


def carried(axes, reference):
    """Carry a reference along, each step as a rotation about the normal of both axes."""
    for a, b in pairwise(axes):
        v, c = np.cross(a, b), a @ b
        reference = c * reference + np.cross(v, reference) + v * (v @ reference) / (1 + c)
    return reference


@given(seed=seeds)
@few
def test_references_are_carried_by_the_smallest_turns(seed):
    path = wavy(np.random.default_rng(seed))
    references = path.references()
    np.testing.assert_allclose(np.linalg.norm(references, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose((references * path.axes_base).sum(axis=1), 0.0, atol=1e-12)
    for i in (1, 10, 29):
        expected = carried(path.axes_base[: i + 1], references[0])
        np.testing.assert_allclose(references[i], expected, atol=1e-9)


@given(seed=seeds)
@few
def test_carrying_there_and_back_returns_the_reference(seed):
    path = wavy(np.random.default_rng(seed))
    both = Path5D(
        np.vstack((path.points_base, path.points_base[::-1])),
        np.vstack((path.axes_base, path.axes_base[::-1])),
    )
    references = both.references()
    np.testing.assert_allclose(references[::-1], references, atol=1e-9)


@given(seed=seeds)
@few
def test_turning_the_path_turns_the_transport(seed):
    rng = np.random.default_rng(seed)
    path, R = wavy(rng), random_rotation(rng)
    turned = Path5D(path.points_base @ R.T, path.axes_base @ R.T)
    here, there = path.references() @ R.T, turned.references()
    z = turned.axes_base
    side = np.cross(z, here)
    roll = np.arctan2((there * side).sum(axis=1), (there * here).sum(axis=1))
    difference = np.angle(np.exp(1j * (roll - roll[0])))  # the start is tied to base, the rest not
    np.testing.assert_allclose(difference, 0.0, atol=1e-9)


def test_a_loop_on_a_sphere_turns_the_reference_by_the_enclosed_angle():
    tilt, angle = np.deg2rad(35.0), np.linspace(0, 2 * np.pi, 3601)
    across = np.sin(tilt)
    axes = np.column_stack(
        (across * np.cos(angle), across * np.sin(angle), np.cos(tilt) + 0 * angle)
    )
    references = Path5D(axes * 80, axes).references()
    start, end = references[[0, -1]]
    turn = np.arctan2(np.cross(start, end) @ axes[0], start @ end)
    enclosed = 2 * np.pi * (1 - np.cos(tilt))  # solid angle, for transport is curvature
    assert np.angle(np.exp(1j * (turn - enclosed))) == pytest.approx(0.0, abs=1e-5)


def test_roll_zero_starts_at_base_x_or_else_base_y():
    down = Path5D([[0, 0, 0]], [[0, 0, -1.0]])
    np.testing.assert_allclose(down.references(), [[1, 0, 0]], atol=1e-15)
    for degrees, expected in ((29.0, 1), (31.0, 0)):
        a = np.deg2rad(degrees)
        reference = Path5D([[0, 0, 0]], [[np.cos(a), 0, np.sin(a)]]).references()[0]
        assert abs(reference[expected]) == pytest.approx(1.0 if expected else np.sin(a))


@given(seed=seeds)
@few
def test_poses_hold_position_axis_and_roll(seed):
    rng = np.random.default_rng(seed)
    path = wavy(rng)
    rolls = rng.uniform(-np.pi, np.pi, 30)
    Ts_base_probe = path.Ts_base_probe(rolls)
    np.testing.assert_array_equal(Ts_base_probe.translations, path.points_base)
    np.testing.assert_allclose(Ts_base_probe.rotations[:, :, 2], path.axes_base, atol=1e-12)
    x, reference = Ts_base_probe.rotations[:, :, 0], path.references()
    side = np.cross(path.axes_base, reference)
    measured = np.arctan2((x * side).sum(axis=1), (x * reference).sum(axis=1))
    np.testing.assert_allclose(measured, rolls, atol=1e-9)
    one = path.Ts_base_probe(0.3).rotations
    np.testing.assert_allclose(one, path.Ts_base_probe(np.full(30, 0.3)).rotations)


def test_arc_length_is_travelled_distance():
    path = Path5D([[0, 0, 0], [3, 4, 0], [3, 4, 0], [3, 4, 2]], [[0, 0, 1.0]] * 4)
    np.testing.assert_allclose(path.arc_length_mm(), (0, 5, 5, 7))
    assert len(path) == 4


def test_what_is_not_a_path_is_refused():
    z = [0, 0, 1.0]
    with pytest.raises(DegenerateGeometryError, match="opposite"):
        Path5D(np.zeros((2, 3)), [z, [0, 0, -1.0]]).references()
    for points, axes in (([[0, 0, 0]], [z, z]), ([[0, 0, 0]], [[0, 0, 2.0]]), ([], [])):
        with pytest.raises(InvalidInputError):
            Path5D(points, axes)
    with pytest.raises(ValueError, match="read-only"):
        Path5D([[0, 0, 0]], [z]).points_base[0] = 1
