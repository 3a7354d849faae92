"""What an A-scan errs by as it hears all the bone below its face: how the map varies there."""

import numpy as np
import pytest

from rona_core.app.steps.maps.accuracy.echo_terms import roughness_term
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.fitting.plate_field import ROUGHNESS_MM, fit_field

FACE_MM = 6.0
AT = np.arange(-10.0, 10.5, 1.0)


def term_of(height):
    """Return the term (nu, nv) of the bone that ``height(u, v)`` is, sampled every mm."""
    dense = np.arange(-15.0, 15.5, 1.0)
    u, v = (axis.ravel() for axis in np.meshgrid(dense, dense, indexing="ij"))
    plate = fit_field(np.column_stack((u, v)), height(u, v))
    cells = height(*np.meshgrid(AT, AT, indexing="ij"))
    boundary = BoundaryMap(Pose.identity(), AT, AT, cells, np.ones(cells.shape, dtype=np.bool_))
    return np.broadcast_to(roughness_term(boundary, plate, FACE_MM).own_mm, cells.shape)


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
    for at, measured in zip(AT, found.mean(axis=1), strict=True):
        wave = high * np.cos(k * (at + x))
        rest = wave - plane @ np.linalg.lstsq(plane, wave, rcond=None)[0]
        expected = max(np.sqrt(np.mean(rest**2)), ROUGHNESS_MM)
        assert measured == pytest.approx(expected, rel=0.15, abs=0.005)
    assert found.max() > 0.06


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
    found = np.sqrt(np.mean(np.square(roughness_term(boundary, plate, FACE_MM).own_mm)))
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
