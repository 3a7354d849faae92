"""Cubic B-splines: what they must reproduce exactly, and derivatives against differences."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from rona_core.virtual.specimen.bsplines import SplineVolume, cubic_weights

INSIDE = 7.0  # nodes from the rim, where its end conditions have died away


def volume(function, n=24):
    grid = np.stack(np.meshgrid(*3 * [np.arange(float(n))], indexing="ij"), axis=-1)
    return SplineVolume(function(grid.reshape(-1, 3)).reshape(n, n, n))


def places(seed=0, count=40, n=24):
    return np.random.default_rng(seed).uniform(INSIDE, n - 1 - INSIDE, (count, 3))


@given(st.floats(0.0, 1.0))
def test_weights_share_out_one_and_lie_about_their_place(t):
    value, slope, bend = cubic_weights(np.array(t))
    nodes = np.arange(-1.0, 3.0)
    assert (value >= 0.0).all()
    np.testing.assert_allclose([value.sum(), slope.sum(), bend.sum()], (1.0, 0.0, 0.0), atol=1e-14)
    np.testing.assert_allclose([value @ nodes, slope @ nodes, bend @ nodes], (t, 1, 0), atol=1e-14)
    np.testing.assert_allclose(bend @ nodes**2, 2.0, atol=1e-13)


def test_a_quadric_has_its_values_slopes_and_bends():
    bends = np.array(((0.4, -0.1, 0.2), (-0.1, 0.3, 0.05), (0.2, 0.05, -0.6)))
    slopes = np.array((1.0, -2.0, 0.5))
    made = volume(lambda p: 3.0 + p @ slopes + 0.5 * np.einsum("ni,ij,nj->n", p, bends, p))
    p = places()
    wanted = 3.0 + p @ slopes + 0.5 * np.einsum("ni,ij,nj->n", p, bends, p)
    np.testing.assert_allclose(made.value(p), wanted, atol=0.02)
    np.testing.assert_allclose(made.gradient(p), slopes + p @ bends, atol=0.02)
    np.testing.assert_allclose(made.hessian(p), np.broadcast_to(bends, (len(p), 3, 3)), atol=0.05)


def test_derivatives_are_those_of_the_value():
    rng = np.random.default_rng(1)
    made, p, h = SplineVolume(rng.normal(size=(20, 20, 20))), places(2, 30, 20), 1e-5
    steps = h * np.eye(3)
    value = np.stack([(made.value(p + s) - made.value(p - s)) / (2 * h) for s in steps], axis=1)
    np.testing.assert_allclose(made.gradient(p), value, atol=1e-7)
    slope = [(made.gradient(p + s) - made.gradient(p - s)) / (2 * h) for s in steps]
    np.testing.assert_allclose(made.hessian(p), np.stack(slope, axis=1), atol=1e-6)


def test_nodes_keep_their_values():
    values = np.random.default_rng(3).normal(size=(12, 12, 12))
    nodes = 1 + np.argwhere(np.ones((10, 10, 10), dtype=bool))  # not those of the rim
    np.testing.assert_allclose(
        SplineVolume(values).value(nodes.astype(float)), values[1:-1, 1:-1, 1:-1].ravel(), atol=1e-9
    )
