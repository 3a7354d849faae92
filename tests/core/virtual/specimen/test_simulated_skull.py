import numpy as np
import pytest

from rona_core.virtual.specimen.boundaries import SMOOTH, Relief
from rona_core.virtual.specimen.simulated.layer_radii import FLOOR_MM
from rona_core.virtual.specimen.simulated.patient_sampling import draw_patient
from rona_core.virtual.specimen.simulated.simulated_skull import SimulatedSpecimen, cube_sphere
from rona_core.virtual.specimen.simulated.spherical_fields import (
    HEAD_MM,
    Curves,
    Egg,
    Waves,
    chart_directions,
    direction_of,
    tangents,
    trace_curve,
)

ROUGHEST = Relief(0.2, 0.2, 0.5, 2.0)


def directions(n, seed=0):
    u = np.random.default_rng(seed).normal(size=(n, 3))
    return u / np.linalg.norm(u, axis=1, keepdims=True)


def test_waves_have_the_asked_deviation_and_correlation():
    rng = np.random.default_rng(0)
    u = directions(300)
    step = 20.0 / 76.0
    v = u + step * np.cross(u, directions(300, 9))  # a chord of at most 20 mm
    chord = 76.0 * np.linalg.norm(u - v, axis=1)
    draws = [Waves.draw(rng, np.array([19.0]), np.array([0.75])) for _ in range(200)]
    a, b = (np.array([w.value(p) for w in draws]) for p in (u, v))
    assert a.std() == pytest.approx(0.75, rel=0.05)
    wanted = 0.75**2 * np.exp(-(chord**2) / (2 * 19.0**2))
    np.testing.assert_allclose((a * b).mean(axis=0).mean(), wanted.mean(), rtol=0.12)


def test_a_smeared_curve_is_as_deep_as_its_weights_say():
    turn = np.linspace(0.0, 1.0, 4)
    line = trace_curve(np.stack((np.cos(turn), np.sin(turn), 0 * turn), 1), 0.002)
    width = 0.012
    curve = Curves(line, np.full(len(line), 0.002 / (width * np.sqrt(2 * np.pi))), width)
    up = np.array([0.0, 0.5 * width, width])
    u = np.stack((np.cos(0.5) * np.cos(up), np.sin(0.5) * np.cos(up), np.sin(up)), 1)
    np.testing.assert_allclose(curve.value(u), np.exp(-0.5 * (up / width) ** 2), rtol=5e-3)


def test_landmarks_lie_where_they_are_named():
    egg = Egg((70.0, 92.0, 75.0))
    for side in (1, -1):
        u = direction_of(egg, (35.0, 45.0), side)
        p = np.array((0.0, -6.0, 48.0)) + egg.value(u[None])[0] * u
        np.testing.assert_allclose(p[1:], (-35.0, 45.0), atol=1e-6)
        assert np.sign(p[0]) == side


@pytest.mark.sweep(3)
@pytest.mark.parametrize("half", [0.8, 1.1, 1.3])  # a region, a face of the cube, the largest
@pytest.mark.parametrize("seed", range(3))
def test_a_chart_has_the_closed_form_of_its_head(seed, half):
    shape, slopes = draw_patient(seed, ROUGHEST), half * np.linspace(-1.0, 1.0, 61)
    axes = tangents(directions(1, seed)[0])
    closed = shape.radii(chart_directions(axes, slopes))
    np.testing.assert_allclose(shape.chart_radii(axes, slopes), closed, atol=1e-11, rtol=0.0)


@pytest.mark.sweep(4)
@pytest.mark.parametrize("relief", [SMOOTH, ROUGHEST])
@pytest.mark.parametrize("seed", range(5))
def test_boundaries_never_touch(seed, relief):
    _, u = cube_sphere(90 if relief is SMOOTH else 45)  # 1.3 or 2.6 mm apart
    radii = draw_patient(seed, relief).radii(u)
    between = -np.diff(radii, axis=1)
    assert between.min() > 0.02
    assert (radii[:, 0] - radii[:, 3]).min() > FLOOR_MM - 0.4  # the floor, less a suture
    assert radii.min() > 30.0


@pytest.mark.sweep(2)
@pytest.mark.parametrize("length", [2.0, 5.0])
@pytest.mark.parametrize(("kind", "rms"), [("inner_mm", 0.15), ("step_mm", 0.3)])
def test_relief_has_the_asked_rms_and_correlation_length(kind, rms, length):
    """Of one boundary alone, on all bone that is thick enough not to limit it."""
    at = directions(2500)
    across = np.cross(at, directions(2500, 9))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    lags_mm = np.array((0.0, 0.5, 1.0, 2.0)) * length
    offs = []
    for lag in lags_mm / HEAD_MM:
        u = np.cos(lag) * at + np.sin(lag) * across
        plain, rough = (
            draw_patient(4, r).radii(u) for r in (SMOOTH, Relief(**{kind: rms}, length_mm=length))
        )
        offs.append(plain - rough)
        thick = plain[:, 0] - plain[:, 3] > 5.5
        assert not offs[-1][:, 0].any()
        if kind == "step_mm":
            assert not offs[-1][:, 2:].any()
    column = 3 if kind == "inner_mm" else 1
    first, *later = (off[thick, column] for off in offs)
    assert first.std() == pytest.approx(rms, rel=0.1)
    assert abs(first.mean()) < 0.1 * rms
    found = [np.mean(first * off) / first.var() for off in later]
    np.testing.assert_allclose(found, np.exp(-0.5 * (lags_mm[1:] / length) ** 2), atol=0.08)


def test_truth_has_the_relief_of_the_inner_boundary_and_other_seeds_another():
    found = []
    for seed in (4, 5):
        smooth, rough = (SimulatedSpecimen(seed, relief=r) for r in (SMOOTH, Relief(inner_mm=0.15)))
        center, normal = smooth.region.center_skull, smooth.region.normal_skull
        e1 = np.linalg.svd(normal[None])[2][1]
        line = center + np.linspace(-20.0, 20.0, 81)[:, None] * e1
        points = smooth.closest(line)
        n = smooth.normal(points)
        found.append(rough.thickness(points, -n) - smooth.thickness(points, -n))
        np.testing.assert_allclose(rough.closest(line), points, atol=1e-9)
    assert all(0.07 < off.std() < 0.25 for off in found)
    assert abs(np.corrcoef(found)[0, 1]) < 0.7


def test_cube_sphere_is_closed_and_faces_outward():
    faces, vertices = cube_sphere(7)
    edges = np.sort(faces[:, (0, 1, 1, 2, 2, 0)].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 2).all()
    assert len(vertices) - len(count) + len(faces) == 2
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, corners.mean(axis=1)) > 0).all()
