from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.evaluation.map_metrics import (
    covered,
    inner_errors_mm,
    map_figures,
    outer_errors_mm,
    thickness_errors_mm,
)
from rona_core.geometry.pose import Pose
from tests.core.evaluation.test_navigation_metrics import truth_of

THICKNESS_MM = 6.0
seeds = st.integers(0, 2**32 - 1)


def sphere_map(truth, depth_mm, *, half_mm=24.0, radius_mm=30.0, tilt_rad=0.0, shift=(0, 0, 0)):
    """Exact map of a sphere ``depth_mm`` below the outer one, on a plane near the region."""
    center, normal, _ = truth.scene.region_base()
    x = np.cross(normal, (0.0, 1.0, 0.0))
    x /= np.linalg.norm(x)
    axes = np.column_stack((x, np.cross(normal, x), normal))
    T_base_map = Pose(axes, center) @ Pose.from_rotvec((tilt_rad, 0.4 * tilt_rad, 0.3))
    u = np.arange(-half_mm, half_mm + 0.5)
    v = np.arange(-half_mm - 2, half_mm + 2.5)
    specimen = truth.scene.specimen
    c = T_base_map.inv() @ (truth.scene.T_base_skull @ np.array(specimen.center) + np.array(shift))
    r = specimen.radius_mm - depth_mm
    uu, vv = np.meshgrid(u, v, indexing="ij")
    height = c[2] + np.sqrt(r**2 - (uu - c[0]) ** 2 - (vv - c[1]) ** 2)
    ok = np.hypot(uu, vv) <= radius_mm
    height = np.where(ok, height, 0.0)
    return SimpleNamespace(T_base_map=T_base_map, u_mm=u, v_mm=v, height_mm=height, ok=ok)


def maps_of(truth, outer_mm=0.0, inner_mm=0.0, fused_mm=0.0, inner_radius_mm=30.0, **kwargs):
    """Maps that lie so many millimetres outside the true boundaries."""
    return SimpleNamespace(
        outer=sphere_map(truth, -outer_mm, **kwargs),
        inner=sphere_map(truth, THICKNESS_MM - inner_mm, radius_mm=inner_radius_mm, **kwargs),
        fused=sphere_map(truth, -fused_mm, **kwargs),
    )


@settings(max_examples=8)
@given(seeds, st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1))
def test_maps_that_are_off_by_known_distances_give_these_figures(seed, outer, inner, fused):
    truth = truth_of(seed)
    figures = map_figures(maps_of(truth, outer, inner, fused, tilt_rad=0.15), truth)
    assert figures["outer_rms_mm"] == pytest.approx(abs(outer), abs=1e-9)
    assert figures["inner_rms_mm"] == pytest.approx(abs(inner), abs=1e-9)
    assert figures["fused_outer_rms_mm"] == pytest.approx(abs(fused), abs=1e-9)
    assert figures["thickness_bias_mm"] == pytest.approx(outer - inner, abs=1e-9)
    assert figures["thickness_rms_mm"] == pytest.approx(abs(outer - inner), abs=1e-9)
    assert figures["outer_same_robot_rms_mm"] == pytest.approx(abs(outer), abs=1e-9)


def test_a_map_shifted_along_z_has_the_closed_form_rms():
    truth = truth_of(1)
    shift = np.array((0.0, 0.0, 0.3))
    maps = maps_of(truth, shift=shift)
    center = truth.scene.T_base_skull @ np.array(truth.scene.specimen.center)
    radius = truth.scene.specimen.radius_mm
    i, j = np.nonzero(maps.outer.ok)
    points = maps.outer.T_base_map @ np.column_stack(
        (maps.outer.u_mm[i], maps.outer.v_mm[j], maps.outer.height_mm[i, j])
    )
    exact = np.linalg.norm(points - center, axis=1) - radius
    figures = map_figures(maps, truth)
    assert figures["outer_rms_mm"] == pytest.approx(np.sqrt((exact**2).mean()), rel=1e-9)
    assert 0.25 < figures["outer_rms_mm"] < 0.3
    assert abs(figures["thickness_bias_mm"]) < 0.005  # both boundaries moved alike


def test_a_robot_that_repeats_its_error_finds_its_own_map_right():
    offset = np.array((0.2, -0.3, 0.5))
    truth = truth_of(2, offset=tuple(offset))
    maps = maps_of(truth, shift=tuple(-offset))  # what this robot measures of the true bone
    figures = map_figures(maps, truth)
    assert figures["outer_same_robot_rms_mm"] == pytest.approx(0.0, abs=1e-9)
    assert figures["inner_same_robot_rms_mm"] == pytest.approx(0.0, abs=1e-9)
    assert figures["outer_rms_mm"] > 0.4


def test_thickness_is_taken_along_the_true_normal_where_maps_are_tilted():
    truth = truth_of(3)
    maps = maps_of(truth, 0.2, -0.1, tilt_rad=0.35)
    errors = thickness_errors_mm(maps, truth)
    errors = errors[np.isfinite(errors)]
    assert len(errors) > 1500
    np.testing.assert_allclose(errors, 0.3, atol=1e-9)


def test_cells_that_are_flagged_in_either_map_do_not_count():
    truth = truth_of(4)
    maps = maps_of(truth, 0.1, inner_radius_mm=12.0)
    spoilt = maps.outer.u_mm > 5.0
    maps.outer.ok[spoilt] = False
    maps.outer.height_mm[spoilt] = 99.0
    errors = thickness_errors_mm(maps, truth)
    errors = errors[np.isfinite(errors)]
    both = maps.inner.ok & maps.outer.ok
    assert np.count_nonzero(both) - 20 < len(errors) <= np.count_nonzero(both)
    np.testing.assert_allclose(errors, 0.1, atol=1e-9)
    assert map_figures(maps, truth)["outer_rms_mm"] == pytest.approx(0.1, abs=1e-9)


def test_the_fused_map_is_scored_on_the_cells_of_the_outer_map():
    truth = truth_of(5)
    maps = maps_of(truth, fused_mm=0.2)
    maps.outer = sphere_map(truth, 0.0, radius_mm=10.0)
    far = np.hypot(*np.meshgrid(maps.fused.u_mm, maps.fused.v_mm, indexing="ij")) > 12.0
    maps.fused.height_mm[far] += 5.0  # wrong where nobody looks
    assert map_figures(maps, truth)["fused_outer_rms_mm"] == pytest.approx(0.2, abs=1e-9)


def test_a_fused_map_on_a_wider_grid_is_scored_at_the_same_places():
    truth = truth_of(5)
    maps = maps_of(truth)
    maps.fused = sphere_map(truth, -0.2, half_mm=40.0, radius_mm=45.0)
    # between cells the height is bilinear: a sphere of 80 mm sags by up to 1 / (4 * 80) mm
    assert map_figures(maps, truth)["fused_outer_rms_mm"] == pytest.approx(0.2, abs=0.01)


def test_coverage_is_the_share_of_the_disc():
    truth = truth_of(6)
    region = truth.region_points()
    assert covered(sphere_map(truth, 0.0, half_mm=40, radius_mm=45), region) == 1.0
    half = covered(sphere_map(truth, 0.0, half_mm=40, radius_mm=12.5), region)
    assert half == pytest.approx(0.25, abs=0.02)
    nothing = sphere_map(truth, 0.0, radius_mm=-1.0)
    assert covered(nothing, region) == 0.0


def test_the_region_is_a_disc_on_the_bone():
    truth = truth_of(6)
    points = truth.region_points()
    assert len(points) == pytest.approx(np.pi * 25**2, rel=0.01)
    np.testing.assert_allclose(truth.signed_distance_mm(points), 0.0, atol=1e-9)


def test_where_the_bone_has_no_inner_boundary_no_error_is_made_up():
    truth = truth_of(7)
    specimen = truth.scene.specimen
    whole = type(specimen).thickness

    class Open(type(specimen)):
        def thickness(self, points_skull, directions_skull):
            values = whole(self, points_skull, directions_skull)
            return np.where(np.arange(len(values)) % 2 == 0, np.inf, values)

    truth.scene.specimen = Open()
    maps = maps_of(truth, inner_mm=0.25)
    points = maps.inner.T_base_map @ np.array([(0.0, 0.0, 0.0), (5.0, 0.0, 0.0)])
    assert np.isfinite(inner_errors_mm(points, truth, False)).sum() == 1
    assert map_figures(maps, truth)["inner_rms_mm"] == pytest.approx(0.25, abs=1e-9)


def test_empty_maps_have_no_errors_and_no_coverage():
    truth = truth_of(8)
    figures = map_figures(empty_maps(truth), truth)
    for key, value in figures.items():
        assert value == 0.0 if "coverage" in key else value is None


def empty_maps(truth):
    empty = sphere_map(truth, 0.0, radius_mm=-1.0)
    return SimpleNamespace(outer=empty, inner=empty, fused=empty)


def test_outer_errors_are_positive_outside():
    truth = truth_of(9)
    center, normal, _ = truth.scene.region_base()
    errors = outer_errors_mm(np.array([center + normal, center - 2 * normal]), truth, False)
    np.testing.assert_allclose(errors, (1.0, -2.0), atol=1e-9)
