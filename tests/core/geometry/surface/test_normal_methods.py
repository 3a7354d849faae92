"""What each way of fitting is for: bias, rims, relief; honest errors; the radius."""

import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.errors import InvalidInputError
from rona_core.geometry.surface.normals.normals import (
    FLAGS,
    REASONS,
    NormalField,
    choose_radius,
    thin_places,
)
from tests.core.geometry.surface.test_normals import angles_deg
from tests.helpers.strategies import cap, random_rotation, seeds

few = settings(max_examples=15, deadline=None)
SIGMA, R = 0.35, 80.0


def noisy_cap(rng, n, half_angle_deg=40.0, sigma=SIGMA):
    """Return a noisy cap about z in a random attitude, the way out, and its true points."""
    turn = random_rotation(rng)
    true = cap(rng, n, R, half_angle_deg) @ turn.T
    return true + rng.normal(0, sigma, (n, 3)), turn[:, 2], true


def errors_deg(found, at):
    return angles_deg(found.normals, at / np.linalg.norm(at, axis=1)[:, None])


@pytest.mark.sweep(1)
@pytest.mark.parametrize("density", [0.5, 3.0])
def test_predicted_errors_are_honest(density):
    rng = np.random.default_rng(int(density * 10))
    area = 2 * np.pi * R**2 * (1 - np.cos(np.deg2rad(40)))
    points, out, true = noisy_cap(rng, int(density * area))
    at = points[true @ out > R * np.cos(np.deg2rad(30))][:1500]
    found = NormalField(points, 8.0).normals(at, method="jet", viewpoint=4 * R * out)
    squares = (errors_deg(found, at) / found.sigma_deg) ** 2
    assert 0.7 < squares.mean() < 1.35  # 1 where the prediction is right
    assert 0.95 < np.mean(squares < 4.0)  # two sigma of two angles: 0.982


def test_a_quadric_stands_upright_at_the_rim_where_a_plane_leans():
    rng = np.random.default_rng(1)
    points, out, true = noisy_cap(rng, 20000)
    rim = points[true @ out < R * np.cos(np.deg2rad(40) - 1 / R)][::3]
    for method, low, high in (("plane", 3.0, 6.0), ("jet", 0.0, 0.7)):
        found = NormalField(points, 15.0).normals(rim, method=method, viewpoint=4 * R * out)
        assert low < np.median(errors_deg(found, rim)) <= high
        assert (np.array(found.flags) == "one_sided").mean() == (method == "plane")
    found = NormalField(points).normals(rim, method="jet", viewpoint=4 * R * out)
    assert found.ok.all()
    assert np.median(errors_deg(found, rim)) <= 0.7  # where it matters it takes a wider one
    assert found.radii_mm is not None
    assert (found.radii_mm > found.radius_mm).mean() > 0.5


@given(seed=seeds)
@few
def test_quadrics_are_exact_on_quadrics(seed):
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-6, 6, (300, 2))
    bend = rng.normal(0, 0.01, 3)
    height = bend[0] * flat[:, 0] ** 2 + bend[1] * flat.prod(axis=1) + bend[2] * flat[:, 1] ** 2
    turn, shift = random_rotation(rng), rng.uniform(-500, 500, 3)
    points = np.column_stack((flat, height)) @ turn.T + shift
    found = NormalField(points, 6.0).normals([shift], method="jet", outward=turn[:, 2])
    # the plane's frame differs from the quadric's own by terms of third order
    assert angles_deg(found.normals, turn[None, :, 2]).max() < 0.1
    assert found.ok.all()


@pytest.mark.slow
def test_the_radius_grows_with_noise_and_shrinks_with_density_and_relief():
    rng = np.random.default_rng(7)
    flat = rng.uniform(-45, 45, (12000, 2))

    def chosen(n, sigma, relief):
        xy = flat[:n]
        height = relief * np.sin(xy[:, 0] / 3.0) * np.sin(xy[:, 1] / 3.0)
        points = np.column_stack((xy, height)) + rng.normal(0, sigma, (n, 3))
        return choose_radius(points, "jet")

    base = chosen(6000, 0.15, 0.4)
    assert base.noise_mm == pytest.approx(0.15, rel=0.15)
    assert base.density_per_mm2 == pytest.approx(6000 / 90**2, rel=0.1)
    assert chosen(6000, 0.45, 0.4).radius_mm > base.radius_mm
    assert chosen(12000, 0.15, 0.4).radius_mm <= base.radius_mm
    assert chosen(6000, 0.15, 0.0).radius_mm > base.radius_mm
    i = int(np.flatnonzero(base.radii_mm == base.radius_mm)[0])
    assert np.hypot(base.noise_deg, base.lean_deg).argmin() == i
    sphere, _, _ = noisy_cap(rng, 10000, sigma=0.1)
    assert 1 / choose_radius(sphere, "jet").curvature_per_mm == pytest.approx(R, rel=0.15)


@pytest.mark.slow
@pytest.mark.sweep(1)
@pytest.mark.parametrize("method", ["plane", "jet"])
def test_the_chosen_radius_is_nearly_as_good_as_the_best(method):
    rng = np.random.default_rng(8)
    xy = rng.uniform(-40, 40, (5000, 2))
    wave, high = 4.0, 0.3

    def surface(u):
        z = high * np.sin(u[:, 0] / wave) * np.sin(u[:, 1] / wave)
        dx = high / wave * np.cos(u[:, 0] / wave) * np.sin(u[:, 1] / wave)
        dy = high / wave * np.sin(u[:, 0] / wave) * np.cos(u[:, 1] / wave)
        n = np.column_stack((-dx, -dy, np.ones(len(u))))
        return np.column_stack((u, z)), n / np.linalg.norm(n, axis=1)[:, None]

    points = surface(xy)[0] + rng.normal(0, 0.15, (5000, 3))
    at, true = surface(rng.uniform(-28, 28, (300, 2)))

    def rms(radius):
        found = NormalField(points, radius).normals(at, method=method, outward=(0, 0, 1))
        return float(np.sqrt((angles_deg(found.normals, true) ** 2).mean()))

    best = min(rms(float(radius)) for radius in np.geomspace(2.5, 16, 9))
    assert rms(None) < 1.25 * best


def test_a_place_on_a_strand_gets_a_wider_neighbourhood_or_a_reason():
    rng = np.random.default_rng(9)
    dense = np.column_stack((rng.uniform(-30, 0, (3000, 1)), rng.uniform(-20, 20, (3000, 1))))
    lines = np.array([(x, y) for y in np.arange(-20, 21, 6.0) for x in np.arange(0, 30, 1.0)])
    flat = np.vstack((dense, lines))
    points = np.column_stack((flat, np.zeros(len(flat)))) + rng.normal(0, 0.02, (len(flat), 3))
    at = np.array([(-15.0, 0, 0), (15.0, -2.0, 0), (150.0, 0, 0)])
    field = NormalField(points)
    found = field.normals(at, method="plane", outward=(0, 0, 1))
    assert found.flags == ("ok", "ok", "too_few")
    assert found.choice is not None
    assert found.radii_mm is not None
    assert found.radius_mm == found.choice.radius_mm == found.radii_mm[0] < found.radii_mm[1]
    thin = thin_places(found, at)
    assert thin.reasons == ("too_few", "widened")
    np.testing.assert_array_equal(thin.places, (2, 1))
    np.testing.assert_array_equal(thin.points_base, at[[2, 1]])
    assert (np.diff(thin.times) <= 0).all()
    narrow = NormalField(points, 5.5).normals(at, method="plane", outward=(0, 0, 1))
    assert narrow.flags == ("ok", "rank_deficient", "too_few")
    assert narrow.choice is None
    assert narrow.radii_mm is None
    doubtful = thin_places(narrow, at, max_sigma_deg=1e-3)
    assert set(doubtful.reasons) == {"too_few", "rank_deficient", "uncertain"}
    assert set(REASONS) - {"widened"} == set(FLAGS) - {"ok"}
    with pytest.raises(InvalidInputError, match="places"):
        thin_places(found, at[:2])
    with pytest.raises(InvalidInputError, match="max_sigma_deg"):
        thin_places(found, at, max_sigma_deg=0.0)


def test_an_empty_cloud_has_a_radius_and_no_normals():
    found = NormalField(np.zeros((0, 3))).normals([[0, 0, 0.0]], method="jet", outward=(0, 0, 1))
    assert found.flags == ("too_few",)
    assert found.radius_mm > 0
    np.testing.assert_array_equal(found.normals, [[0, 0, 1.0]])


def test_a_path_alone_gives_its_normals_or_says_why_not():
    rng = np.random.default_rng(10)
    flat = np.array([(x, y) for y in np.arange(-20, 21, 5.0) for x in np.linspace(-30, 30, 34)])
    true = np.column_stack((flat, np.sqrt(R**2 - (flat**2).sum(axis=1))))
    points = true + rng.normal(0, SIGMA, true.shape)
    narrow = NormalField(points, 3.0).normals(points, method="jet", outward=(0, 0, 1))
    assert not narrow.ok.any()
    found = NormalField(points).normals(points, method="jet", outward=(0, 0, 1))
    assert found.ok.all()
    assert np.median(errors_deg(found, true)) < 0.8
    assert np.percentile(errors_deg(found, true), 95) < 3.0


@pytest.mark.sweep(1)
@pytest.mark.parametrize("method", ["plane", "jet"])
def test_no_normal_is_silently_wrong_in_sparse_clouds(method):
    rng = np.random.default_rng(11)
    wrong, fine = 0, 0
    for n in (150, 500, 1500):
        points, out, _ = noisy_cap(rng, n)
        for radius in (None, 6.0, 12.0):
            field = NormalField(points, radius)
            found = field.normals(points, method=method, viewpoint=4 * R * out)
            errors = errors_deg(found, points)[found.ok]
            wrong += int(((errors > 10.0) & (errors > 4.0 * found.sigma_deg[found.ok])).sum())
            fine += len(errors)
    assert fine > 2000
    assert wrong <= fine // 1000


def passages(lifted_mm, white_mm, seed):
    """A flat cloud of a pointer that came by 40 times; each time its points are lifted alike."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(-30, 30, 120), np.linspace(-30, 30, 40))
    z = np.repeat(rng.normal(0.0, lifted_mm, 40)[:, None], 120, axis=1)
    return np.stack((x, y, z + rng.normal(0.0, white_mm, z.shape)), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(("lifted_mm", "white_mm"), [(0.05, 0.005), (0.0, 0.05)])
def test_points_of_one_passage_that_err_alike_count_as_few(lifted_mm, white_mm):
    squares = []
    for seed in range(6):
        points = passages(lifted_mm, white_mm, seed)
        at = points[np.hypot(points[:, 0], points[:, 1]) < 20.0][::37]
        found = NormalField(points, 8.0).normals(at, outward=(0, 0, 1))
        sine = np.linalg.norm(np.cross(found.normals, (0.0, 0.0, 1.0)), axis=1)
        squares.append(np.mean((np.rad2deg(np.arcsin(sine)) / found.sigma_deg) ** 2))
    assert np.mean(squares) < 1.5
    if not lifted_mm:  # what is lifted looks like relief as well, and counts as both
        assert np.mean(squares) > 0.6
