"""Sphere tracing against the closed form of a ball."""

import numpy as np

from rona_core.virtual.specimen.sphere_tracing import find_roots, first_entries, sphere_span

RADIUS = 7.0


def rays(seed=0, n=400):
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return rng.uniform(-15.0, 15.0, (n, 3)), directions


def test_the_span_of_a_ball_ends_on_its_surface():
    o, d = rays()
    enter, leave = sphere_span(o, d, RADIUS)
    nearest = np.linalg.norm(o - np.einsum("ij,ij->i", o, d)[:, None] * d, axis=1)
    np.testing.assert_array_equal(leave >= 0.0, (nearest < RADIUS) & (leave >= 0.0))
    assert (leave[nearest >= RADIUS] == -1.0).all()
    ahead = leave > 0.0
    at_end = np.linalg.norm(o[ahead] + leave[ahead, None] * d[ahead], axis=1)
    np.testing.assert_allclose(at_end, RADIUS, atol=1e-9)
    outside = ahead & (np.linalg.norm(o, axis=1) > RADIUS)
    assert outside.any()
    at_begin = np.linalg.norm(o[outside] + enter[outside, None] * d[outside], axis=1)
    np.testing.assert_allclose(at_begin, RADIUS, atol=1e-9)
    inside = np.linalg.norm(o, axis=1) < RADIUS
    assert (enter[inside] == 0.0).all()


def test_rays_enter_a_ball_where_geometry_says():
    o, d = rays(1)
    expected, leave = sphere_span(o, d, RADIUS)
    clear = leave - expected > 2.0  # others may slip through a dip that is too shallow
    ends = np.where(leave >= expected, 40.0, -1.0)

    def gap(t, i):
        return np.linalg.norm(o[i] + t[:, None] * d[i], axis=1) - RADIUS

    found = first_entries(gap, np.zeros(len(o)), ends)
    assert clear.sum() > 30
    np.testing.assert_allclose(found[clear], expected[clear], atol=1e-8)
    assert np.isinf(found[leave < 0.0]).all()
    seen = np.isfinite(found) & (found > 0.0)
    np.testing.assert_allclose(gap(found[seen], np.flatnonzero(seen)), 0.0, atol=1e-8)


def test_a_ray_that_begins_inside_has_its_start_and_one_that_ends_before_has_none():
    def gap(t, i):
        return 10.0 - t

    starts, ends = np.array((12.0, 0.0, 0.0, 5.0)), np.array((20.0, 9.0, 20.0, 4.0))
    np.testing.assert_allclose(
        first_entries(gap, starts, ends), (12.0, np.inf, 10.0, np.inf), atol=1e-9
    )


def test_roots_of_curved_gaps_are_found_to_the_last_digits():
    powers = np.array((1.0, 3.0, 5.0))
    low, high = np.zeros(3), np.full(3, 2.0)

    def gap(t, i):
        return 1.0 - t ** powers[i]

    every = np.arange(3)
    found = find_roots(gap, every, low, high, gap(low, every), gap(high, every))
    np.testing.assert_allclose(found, 1.0, atol=1e-8)
