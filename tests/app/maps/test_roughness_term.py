"""What an A-scan errs by as it hears all the bone below its face: how much, and where."""

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.echo_terms import roughness_term
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.fitting.plate_field import ROUGHNESS_MM, fit_field
from rona_core.ultrasound.probe.beam import rms_roughness_mm
from rona_core.ultrasound.probe.probe_model import probe_model

PROBE = probe_model("2.25MHz")
FACE_MM = 2.0 * PROBE.aperture_radius_mm
AT = np.arange(-10.0, 10.5, 1.0)


def term_of(height, level=lambda u, v: np.full(len(u), 0.9)):
    """Return the term (nu, nv) of the bone that ``height(u, v)`` is, sampled every mm.

    Args:
        height: Of the bone at places.
        level: Of the front echoes there.
    """
    dense = np.arange(-15.0, 15.5, 1.0)
    u, v = (axis.ravel() for axis in np.meshgrid(dense, dense, indexing="ij"))
    plate = fit_field(np.column_stack((u, v)), height(u, v))
    cells = height(*np.meshgrid(AT, AT, indexing="ij"))
    boundary = BoundaryMap(Pose.identity(), AT, AT, cells, np.ones(cells.shape, dtype=np.bool_))
    return roughness_term(boundary, plate, level(u, v), PROBE).own_mm


def test_a_smooth_dome_has_what_no_map_shows():
    found = term_of(lambda u, v: -(u**2 + 1.5 * v**2) / 140.0 + 0.05 * u)
    assert found == pytest.approx(ROUGHNESS_MM, abs=1e-6)


def test_waves_have_their_variance_within_a_face_about_its_plane():
    k, high = 2.0 * np.pi / 8.0, 0.2
    found = term_of(lambda u, v: -(u**2 + v**2) / 140.0 + high * np.cos(k * u))
    square = np.linspace(-FACE_MM / 2.0, FACE_MM / 2.0, 121)
    x, y = (axis.ravel() for axis in np.meshgrid(square, square))
    x, y = (axis[np.hypot(x, y) <= FACE_MM / 2.0] for axis in (x, y))
    plane = np.column_stack((np.ones(len(x)), x, y))
    squares = []
    for at in AT:
        wave = high * np.cos(k * (at + x))
        rest = wave - plane @ np.linalg.lstsq(plane, wave, rcond=None)[0]
        squares.append(max(np.mean(rest**2), ROUGHNESS_MM**2))
    assert found == pytest.approx(np.sqrt(np.mean(squares)), rel=0.15)
    assert found.max() > 0.06


def dome(u, v):
    return -(u**2 + v**2) / 140.0


def test_bone_is_rougher_where_front_echoes_are_lower():
    def level(u, v):
        return np.select([u < -13.0, u < 0.0], [0.9, 0.7], 0.4)

    found, even = term_of(dome, level), term_of(dome)
    assert np.sqrt(np.mean(found**2)) == pytest.approx(np.sqrt(np.mean(even**2)))
    smoother, rougher = found[AT < -3.0], found[AT > 3.0]
    seen = rms_roughness_mm(PROBE, np.array([0.7, 0.4]) / 0.9) ** 2 + ROUGHNESS_MM**2
    apart = seen[1] / seen[0]
    assert apart > 2.0
    assert rougher**2 == pytest.approx(apart * smoother[0, 0] ** 2 * np.ones(rougher.shape))
    assert smoother == pytest.approx(smoother[0, 0] * np.ones(smoother.shape))


def test_how_hard_a_bone_is_does_not_count():
    def steps(u, v):
        return np.where(u + v < 0.0, 1.0, 0.6)

    soft = term_of(dome, lambda u, v: 0.7 * steps(u, v))
    assert soft == pytest.approx(term_of(dome, steps))


@pytest.mark.parametrize("level", [0.0, 0.5, 1.0])
def test_echoes_that_are_all_alike_say_nothing_of_where(level):
    found = term_of(dome, lambda u, v: np.full(len(u), level))
    assert found == pytest.approx(ROUGHNESS_MM, abs=1e-6)


def test_no_bone_is_called_smooth_where_echoes_are_clipped():
    random = np.random.default_rng(2)
    found = term_of(dome, lambda u, v: np.minimum(1.3 * random.uniform(0.6, 0.95, len(u)), 1.0))
    assert found.min() > 0.5 * ROUGHNESS_MM


def test_one_odd_echo_does_not_take_the_roughness_of_all_other_bone():
    def level(u, v):
        return np.where((u == 0.0) & (v == 0.0), 0.5, 1.0)

    found = term_of(dome, level)
    assert np.median(found) > 0.9 * ROUGHNESS_MM
    assert found[10, 10] == pytest.approx(found.max())
    assert found.max() > 1.2 * ROUGHNESS_MM


def test_the_front_echo_of_rough_bone_falls_as_its_phases_part():
    random = np.random.default_rng(3)
    wavenumber = 2.0 * np.pi * PROBE.centre_mhz / 1.5
    depths = random.normal(0.0, [[0.01], [0.03], [0.06]], (3, 200_000))
    levels = np.abs(np.exp(-2j * wavenumber * depths).mean(axis=1))
    assert rms_roughness_mm(PROBE, levels) == pytest.approx([0.01, 0.03, 0.06], rel=0.02)
    assert rms_roughness_mm(PROBE, np.array([1.2])) == pytest.approx(0.0)
    lowest = rms_roughness_mm(PROBE, np.array([0.0, 0.01]))
    assert lowest[0] == lowest[1] < 0.2


def test_bone_between_rows_is_rougher_than_its_map():
    random = np.random.default_rng(4)
    waves = random.normal(0.0, 2.0 * np.pi / 14.0, (60, 2))
    phases = random.uniform(0.0, 2.0 * np.pi, 60)

    def bone(u, v):
        angles = waves[:, 0, None] * u.ravel() + waves[:, 1, None] * v.ravel() + phases[:, None]
        return (0.4 / np.sqrt(60.0) * np.cos(angles).sum(axis=0)).reshape(u.shape)

    rows = np.meshgrid(np.arange(-20.0, 20.1, 5.0), np.arange(-20.0, 20.1, 0.5), indexing="ij")
    u, v = (axis.ravel() for axis in rows)
    plate = fit_field(np.column_stack((u, v)), bone(u, v))
    ok = np.ones((len(AT), len(AT)), dtype=np.bool_)
    boundary = BoundaryMap(Pose.identity(), AT, AT, np.zeros(ok.shape), ok)
    term = roughness_term(boundary, plate, np.full(len(u), 0.9), PROBE)
    found = np.sqrt(np.mean(np.square(term.own_mm)))
    fine = np.linspace(-FACE_MM / 2.0, FACE_MM / 2.0, 21)
    x, y = (axis.ravel() for axis in np.meshgrid(fine, fine))
    x, y = (axis[np.hypot(x, y) <= FACE_MM / 2.0] for axis in (x, y))
    plane = np.column_stack((np.ones(len(x)), x, y))

    def true_mm(heights):
        """Return the RMS departure from planes, given heights at places (n, 2)."""
        at = np.array([(a, b) for a in AT for b in AT])
        over = np.array([heights(a + x, b + y) for a, b in at]).T
        rest = over - plane @ np.linalg.lstsq(plane, over, rcond=None)[0]
        return np.sqrt(np.mean(rest**2))

    def of_map(a, b):
        return plate.departures(np.column_stack((a, b)))

    assert true_mm(of_map) < 0.9 * true_mm(bone)
    assert found == pytest.approx(true_mm(bone), rel=0.1)
