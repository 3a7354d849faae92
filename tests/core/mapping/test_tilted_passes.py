import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose, Poses
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.tilted_passes import (
    TiltSettings,
    plan_along,
    standoffs_mm,
    tilted_paths,
)
from rona_core.ultrasound.probe.materials import GEL

SPEED = 2.65
LINES = (((-10.0, -5.0), (10.0, -5.0)), ((10.0, 0.0), (-10.0, 5.0)))


def boundary(height, ok, T_base_map=None, cell_mm=1.0):
    nu, nv = height.shape
    pose = Pose.identity() if T_base_map is None else T_base_map
    return BoundaryMap(
        pose,
        cell_mm * (np.arange(nu) - nu // 2),
        cell_mm * (np.arange(nv) - nv // 2),
        height,
        ok,
    )


def scene(slope=(0.1, 0.0), gap=(slice(10, 20), slice(12, 18)), T_base_map=None, bend=0.0):
    """Return maps of a 30 mm square; the inner table falls away with ``slope``."""
    u, v = np.meshgrid(np.arange(31) - 15.0, np.arange(31) - 15.0, indexing="ij")
    outer = -bend * (u**2 + v**2)
    ok = np.ones(u.shape, dtype=bool)
    inner_ok = ok.copy()
    inner_ok[gap] = False
    a = boundary(outer, ok, T_base_map)
    b = boundary(outer - (6.0 + slope[0] * u + slope[1] * v), inner_ok, T_base_map)
    return Maps(
        np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, bool), np.zeros(0, bool), a, b, a, None
    )


@st.composite
def curved_paths(draw):
    """A path in rows over a dome anywhere, longer one way than the other, with its normals."""
    n, rows = draw(st.integers(2, 30)), draw(st.integers(2, 6))
    length, width = draw(st.floats(30.0, 60.0)), draw(st.floats(5.0, 20.0))
    radius = draw(st.floats(60.0, 120.0))
    u = np.tile(np.linspace(-length, length, n) / 2.0, rows)
    v = np.repeat(np.linspace(-width, width, rows) / 2.0, n)
    z = np.sqrt(radius**2 - u**2 - v**2)
    points = np.column_stack((u, v, z - radius))
    axes = -np.column_stack((u, v, z)) / radius
    shift = draw(st.tuples(*[st.floats(-500, 500)] * 3))
    T = Pose.from_rotvec(draw(st.tuples(*[st.floats(-3, 3)] * 3)), shift)
    return T, Path5D(T @ points, T.rotate(axes))


@settings(max_examples=40, deadline=None)
@given(curved_paths(), st.floats(0.5, 10.0), st.integers(1, 4))
def test_every_pass_visits_the_same_points_tilted_by_the_same_angle(made, tilt_deg, count):
    _, path = made
    passes = tilted_paths(path, TiltSettings(tilt_deg, count))
    assert len(passes) == count
    for one in passes:
        np.testing.assert_array_equal(one.path.points_base, path.points_base)
        cross = np.cross(one.path.axes_base, path.axes_base)
        sines = np.linalg.norm(cross, axis=1)
        np.testing.assert_allclose(np.rad2deg(np.arcsin(sines)), tilt_deg, atol=1e-9)
        assert (np.einsum("ij,ij->i", one.path.axes_base, path.axes_base) > 0).all()
        np.testing.assert_array_equal(one.lean_deg, tilt_deg)


@settings(max_examples=40, deadline=None)
@given(curved_paths())
def test_the_passes_are_tilted_along_the_longer_side_against_it_and_to_either_side(made):
    T, path = made
    tilts = []
    for one in tilted_paths(path, TiltSettings(5.0)):
        tilt = T.inv().rotate(one.path.axes_base - np.cos(np.deg2rad(5.0)) * path.axes_base)
        tilts.append(tilt / np.linalg.norm(tilt, axis=1, keepdims=True))
    here = np.array(tilts)
    # which end of the longer side is taken first is open
    assert (np.abs(here[:2, :, 0]) > 0.8).all()
    assert (np.abs(here[2:, :, 1]) > 0.8).all()
    for there, back in ((0, 1), (2, 3)):
        np.testing.assert_allclose(here[there], -here[back], atol=1e-9)
    for one in here:  # the whole pass is tilted one way
        assert (one @ one.mean(axis=0) > 0.5).all()


def test_the_probe_is_tilted_so_that_refracted_sound_meets_the_inner_table_squarely():
    found = plan_along(scene(slope=(0.12, 0.0)), LINES, SPEED)
    # Snell for small angles: sine in gel over sine in bone is the ratio of the speeds
    in_bone = np.arctan(0.12)
    in_gel = np.arcsin(np.sin(in_bone) * GEL.speed_mm_per_us / SPEED)
    np.testing.assert_allclose(found.lean_deg, np.rad2deg(in_gel), atol=0.05)
    # the inner table lies deeper towards +u: its outward normal is inclined towards +u,
    # and the sound has to go against it
    assert (found.path.axes_base[:, 0] < 0).all()
    assert (found.path.axes_base[:, 2] < 0).all()


def test_no_tilt_along_lines_exceeds_the_limit():
    steep = scene(slope=(0.3, 0.2))
    assert plan_along(steep, LINES, SPEED, 12.0).lean_deg.max() > 9.0
    assert plan_along(steep, LINES, SPEED, 5.0).lean_deg.max() <= 5.0 + 1e-6


@settings(max_examples=15, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-500, 500)] * 3))
def test_a_path_along_lines_moves_with_the_map(turn, shift):
    T = Pose.from_rotvec(turn, shift)
    here = plan_along(scene(bend=0.005), LINES, SPEED)
    there = plan_along(scene(bend=0.005, T_base_map=T), LINES, SPEED)
    np.testing.assert_allclose(there.path.points_base, T @ here.path.points_base, atol=1e-6)
    np.testing.assert_allclose(there.path.axes_base, T.rotate(here.path.axes_base), atol=1e-9)


def test_given_lines_are_scanned_in_their_order_and_evenly():
    maps = scene(slope=(0.12, 0.0))
    found = plan_along(maps, LINES, SPEED)
    points = found.path.points_base
    visits = []
    for place in np.reshape(LINES, (-1, 2)):
        away = np.linalg.norm(points[:, :2] - place, axis=1)
        assert away.min() < 1e-9
        visits.append(int(away.argmin()))
    assert visits == sorted(visits)
    assert (visits[0], visits[-1]) == (0, len(points) - 1)
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-9)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert 0.4 < steps.min() <= steps.max() < 0.5 + 1e-9
    assert found.gap_cells == 60
    assert found.gap_share == pytest.approx(60 / 961)


def test_standoffs_are_the_way_to_the_map_along_a_leaning_axis():
    maps = scene(bend=0.004)
    axes = np.array([[0.0, 0.0, -1.0], [0.1, 0.0, -1.0], [-0.05, 0.12, -1.0]])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    feet = np.array([[0.0, 0.0, 0.0], [5.0, -3.0, 0.0], [-7.0, 4.0, 0.0]])
    feet[:, 2] = -0.004 * (feet[:, 0] ** 2 + feet[:, 1] ** 2)
    away = np.array([0.0, 1.5, -0.7])
    rotations = []
    for z in axes:
        x = np.cross((0.0, 1.0, 0.0), z)
        x /= np.linalg.norm(x)
        rotations.append(np.column_stack((x, np.cross(z, x), z)))
    poses = Poses(np.array(rotations), feet - away[:, None] * axes)
    np.testing.assert_allclose(standoffs_mm(maps.outer, poses), away, atol=2e-3)


@pytest.mark.parametrize("part", [{"tilt_deg": 0.0}, {"tilt_deg": 40.0}, {"passes": 5}])
def test_settings_out_of_range_are_refused_by_name(part):
    with pytest.raises(InvalidInputError, match=next(iter(part))):
        TiltSettings(**part)


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        ((((0.0, 0.0), (16.0, 0.0)),), "line 1 of 1"),
        ((((0.0, 0.0), (5.0, 0.0)), ((5.0, 0.0), (5.0, -40.0))), "line 2 of 2"),
        (((0.0, 0.0), (5.0, 0.0)), "a start and an end"),
    ],
)
def test_lines_that_leave_the_outer_map_are_refused(lines, words):
    with pytest.raises(InvalidInputError, match=words):
        plan_along(scene(), lines, SPEED)
