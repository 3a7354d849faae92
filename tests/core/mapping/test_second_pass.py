import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.second_pass import (
    SecondPassSettings,
    plan_along,
    plan_second_pass,
    standoffs_mm,
)
from rona_core.ultrasound.probe.materials import GEL

SPEED = 2.65
PLAIN = SecondPassSettings(fan=0.0)


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


def test_the_probe_leans_so_that_refracted_sound_meets_the_inner_table_squarely():
    found = plan_second_pass(scene(slope=(0.12, 0.0)), SPEED, PLAIN)
    # Snell for small angles: sine in gel over sine in bone is the ratio of the speeds
    in_bone = np.arctan(0.12)
    in_gel = np.arcsin(np.sin(in_bone) * GEL.speed_mm_per_us / SPEED)
    np.testing.assert_allclose(found.lean_deg, np.rad2deg(in_gel), atol=0.05)
    # the inner table lies deeper towards +u: its outward normal leans towards +u,
    # and the sound has to go against it
    assert (found.path.axes_base[:, 0] < 0).all()
    assert (found.path.axes_base[:, 2] < 0).all()


def test_the_gap_and_2_mm_around_it_are_visited_and_nothing_else():
    maps = scene()
    found = plan_second_pass(maps, SPEED, PLAIN)
    assert found.gap_cells == 60
    assert found.gap_share == pytest.approx(60 / 961)
    i, j = np.nonzero(~maps.inner.ok)
    cells = np.column_stack((maps.outer.u_mm[i], maps.outer.v_mm[j]))
    way = found.path.points_base[:, :2]
    gaps = np.linalg.norm(cells[:, None] - way[None], axis=2)
    assert gaps.min(axis=1).max() < 1.1  # half of the way between rows
    assert 1.9 < gaps.min(axis=0).max() < 2.1
    lows, highs = cells.min(axis=0), cells.max(axis=0)
    np.testing.assert_allclose(way.min(axis=0), lows - 2.0)
    assert (np.abs(way.max(axis=0) - highs - 2.0) <= 1.0).all()  # the last row may lie short of it
    steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
    assert steps.max() < 1.0 + 1e-9
    assert steps.min() > 0.4


def test_rows_look_around_the_assumed_slope_and_no_lean_exceeds_the_limit():
    alone = plan_second_pass(scene(), SPEED, PLAIN)
    wide = plan_second_pass(scene(), SPEED, SecondPassSettings(fan=0.3, largest_lean_deg=5.0))
    assert np.ptp(alone.lean_deg) < 0.1
    assert np.ptp(wide.lean_deg) > 2.0
    assert wide.lean_deg.max() <= 5.0 + 1e-6


@settings(max_examples=15, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-500, 500)] * 3))
def test_the_path_moves_with_the_map(turn, shift):
    T = Pose.from_rotvec(turn, shift)
    here = plan_second_pass(scene(bend=0.005), SPEED)
    there = plan_second_pass(scene(bend=0.005, T_base_map=T), SPEED)
    np.testing.assert_allclose(there.path.points_base, T @ here.path.points_base, atol=1e-6)
    np.testing.assert_allclose(there.path.axes_base, T.rotate(here.path.axes_base), atol=1e-9)


def test_two_gaps_are_scanned_one_after_the_other():
    maps = scene(gap=(slice(4, 8), slice(4, 8)))
    both = maps.inner.ok.copy()
    both[22:27, 20:26] = False
    again = Maps(
        maps.outer_points_base,
        maps.inner_points_base,
        maps.outer_used,
        maps.inner_used,
        maps.outer,
        boundary(maps.inner.height_mm, both),
        maps.fused,
        None,
    )
    path = plan_second_pass(again, SPEED, PLAIN).path
    first = np.linalg.norm(path.points_base[:, :2] - (-9.5, -9.5), axis=1) < 4
    changes = np.count_nonzero(np.diff(first.astype(int)))
    assert first[0]
    assert changes == 1


def test_without_a_gap_or_with_a_tiny_one_there_is_nothing_to_scan():
    assert plan_second_pass(scene(gap=(slice(0, 0), slice(0, 0))), SPEED) is None
    assert plan_second_pass(scene(gap=(slice(10, 11), slice(10, 12))), SPEED) is None


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


@pytest.mark.parametrize("part", [{"spacing_mm": 0.1}, {"fan": -0.1}, {"largest_lean_deg": 40.0}])
def test_settings_out_of_range_are_refused_by_name(part):
    with pytest.raises(InvalidInputError, match=next(iter(part))):
        SecondPassSettings(**part)


def test_given_lines_are_scanned_in_their_order_with_the_lean_of_any_further_pass():
    maps = scene(slope=(0.12, 0.0))
    lines = (((-10.0, -5.0), (10.0, -5.0)), ((10.0, 0.0), (-10.0, 5.0)))
    found = plan_along(maps, lines, SPEED, PLAIN)
    points = found.path.points_base
    for place in np.reshape(lines, (-1, 2)):
        assert np.linalg.norm(points[:, :2] - place, axis=1).min() < 1e-9
    np.testing.assert_allclose(points[[0, -1], :2], (lines[0][0], lines[1][1]))
    np.testing.assert_allclose(points[:, 2], 0.0, atol=1e-9)
    over_gap = plan_second_pass(maps, SPEED, PLAIN)
    assert found.lean_deg.mean() == pytest.approx(over_gap.lean_deg.mean(), abs=0.05)


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
        plan_along(scene(), lines, SPEED, PLAIN)


def test_a_second_pass_keeps_off_what_is_not_allowed_and_goes_round_it():
    def allowed(places):  # a post amid the gap
        return np.linalg.norm(places - (0.0, 0.0), axis=1) >= 2.5

    whole = plan_second_pass(scene(), SPEED, PLAIN)
    found = plan_second_pass(scene(), SPEED, PLAIN, allowed)
    assert not allowed(whole.path.points_base[:, :2]).all()
    assert allowed(found.path.points_base[:, :2]).all()
    kept = whole.path.points_base[allowed(whole.path.points_base[:, :2])]
    gaps = np.linalg.norm(kept[:, None] - found.path.points_base, axis=2).min(axis=1)
    assert gaps.max() <= 1.0  # a cell
    steps = np.linalg.norm(np.diff(found.path.points_base, axis=0), axis=1)
    assert steps.max() < 0.6
    assert plan_second_pass(scene(), SPEED, PLAIN, lambda p: np.zeros(len(p), bool)) is None
