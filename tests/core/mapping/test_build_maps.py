from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.settings import ProbeSettings
from rona_core.errors import CancelledError, DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.mapping.build_maps import (
    LocatedDetection,
    build_maps,
    build_outer_maps,
    lateness_mm,
    mean_curvature_per_mm,
)
from rona_core.mapping.cloud_fusion import CloudPrior, fuse_cloud
from rona_core.mapping.fitting.hampel_filter import agreeing
from rona_core.mapping.fitting.plate_field import fit_field
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.helpers.mapping_scenes import T_BASE_SKULL, cloud, errors_mm, survey
from tests.helpers.ultrasound_scenes import WavySkull, scan

PROBE = probe_model("2.25MHz")
seeds = st.integers(0, 2**31)


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def inner_z(skull):
    return lambda xy: skull.boundaries_z(xy)[..., 3]


def displaced(rng, shift_mm=0.8, turn_rad=0.008):
    return Pose.from_rotvec(rng.normal(0, turn_rad, 3), rng.normal(0, shift_mm, 3))


# --- outliers, plates, curvature ----------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_outliers_go_and_the_rest_stays(seed):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-20, 20, (400, 2))
    values = 0.1 * places[:, 0] - places[:, 1] ** 2 / 200 + rng.normal(0, 0.1, 400)
    bad = rng.choice(400, 20, replace=False)
    values[bad] += rng.choice((-1, 1), 20) * rng.uniform(1.5, 5.0, 20)
    kept = agreeing(places, values)
    assert not kept[bad].any()
    assert kept.mean() > 0.9
    order = rng.permutation(400)
    np.testing.assert_array_equal(agreeing(places[order], values[order]), kept[order])
    tilted = values + 0.05 * places[:, 0] + 7.0
    assert np.mean(agreeing(places, tilted) == kept) > 0.99


def test_a_handful_of_samples_judges_nobody():
    places = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    assert agreeing(places, np.array((0.0, 0.0, 0.0, 50.0))).all()


def test_samples_on_one_line_are_judged_along_it():
    places = np.column_stack((np.arange(30.0), np.zeros(30)))
    values = 0.2 * places[:, 0]
    values[12] += 2.0
    np.testing.assert_array_equal(np.flatnonzero(~agreeing(places, values)), [12])


def test_the_curvature_of_a_sphere_is_one_over_its_radius():
    rng = np.random.default_rng(1)
    xy = rng.uniform(-6, 6, (300, 2))
    z = np.sqrt(90.0**2 - (xy**2).sum(axis=1)) - 90.0
    assert mean_curvature_per_mm(np.column_stack((xy, z))) == pytest.approx(1 / 90, rel=0.01)
    assert lateness_mm(PROBE, 0.0) == pytest.approx(0.0, abs=1e-12)
    assert 0.3 < lateness_mm(PROBE, 1 / 80) / (PROBE.aperture_radius_mm**2 / 320) < 1.0


# --- maps ---------------------------------------------------------------------------------------


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", [1, 2])
def test_both_boundaries_are_mapped_in_spite_of_flags_and_wrong_echoes(seed):
    rng, skull = np.random.default_rng(seed), WavySkull(seed + 30)
    late = lateness_mm(PROBE, 1 / 80)
    maps = build_maps(LocatedDetection(*survey(skull, rng, flagged=0.4, wrong=0.03, late_mm=late)))
    outer, inner = errors_mm(maps.outer, skull.outer_z), errors_mm(maps.inner, inner_z(skull))
    assert rms(outer) < 0.05
    assert abs(outer.mean()) < 0.015  # the lateness of the curved echo is taken back
    assert rms(inner) < 0.2
    assert maps.inner.ok.sum() > 0.75 * maps.outer.ok.sum()
    assert maps.fused is maps.outer
    assert maps.cloud_fit is None


def test_front_echoes_of_a_second_pass_are_as_late_as_those_of_the_first():
    rng, skull = np.random.default_rng(3), WavySkull(33)
    late = lateness_mm(PROBE, 1 / 80)
    silent = survey(skull, rng, flagged=1.0, late_mm=late)
    again = LocatedDetection(*survey(skull, rng, flagged=0.0, wrong=0.0, late_mm=late))
    maps = build_maps(LocatedDetection(*silent), second=again)
    n = len(silent[0])
    assert not maps.inner_used[:n].any()
    assert maps.inner_used[n:].mean() > 0.95
    outer = errors_mm(maps.outer, skull.outer_z).mean()
    assert abs(errors_mm(maps.inner, inner_z(skull)).mean() - outer) < 0.5 * late


def test_a_cell_is_mapped_just_where_an_unflagged_sample_is_near():
    rng, skull = np.random.default_rng(5), WavySkull(35)
    detection, poses = survey(skull, rng, gap=lambda xy: np.hypot(*xy.T) < 6.0)
    maps = build_maps(LocatedDetection(detection, poses))
    points = maps.outer_points_base  # where A-scans entered the bone, for both boundaries
    for boundary, used in ((maps.outer, maps.outer_used), (maps.inner, maps.inner_used)):
        u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
        near = boundary.T_base_map.inv() @ points[used]
        away = np.hypot(u[..., None] - near[:, 0], v[..., None] - near[:, 1]).min(axis=-1)
        np.testing.assert_array_equal(boundary.ok, away <= 2.5)
        assert not boundary.ok.all()


def test_the_inner_boundary_never_crosses_the_outer():
    rng, skull = np.random.default_rng(6), WavySkull(36, mean_mm=2.0)
    detection, poses = survey(skull, rng, inner_sd_mm=1.5, wrong=0.1)
    maps = build_maps(LocatedDetection(detection, poses))
    assert maps.thickness_mm().min() > 0.0


@settings(max_examples=3, deadline=None)
@given(seed=seeds)
def test_moving_everything_moves_the_surfaces(seed):
    skull, motion = WavySkull(37), np.random.default_rng(seed)
    T_moved = Pose.from_rotvec(motion.normal(0, 1, 3), motion.normal(0, 200, 3)) @ T_BASE_SKULL
    errors = []
    for T in (T_BASE_SKULL, T_moved):
        detection, poses = survey(skull, np.random.default_rng(7), T_base_skull=T, lines_mm=3.0)
        outer = build_maps(LocatedDetection(detection, poses)).outer
        error = errors_mm(outer, skull.outer_z, T_base_skull=T)
        errors.append((rms(error), len(error)))
    (here, n_here), (there, n_there) = errors
    assert there == pytest.approx(here, abs=0.01)  # grids are laid anew, so cells differ
    assert n_there == pytest.approx(n_here, rel=0.03)


def test_the_whole_way_from_echoes_to_maps():
    skull = WavySkull(14)
    track, Ts_skull_probe, _ = scan(skull, ProbeSettings(), seed=14, lines_mm=2.5)
    found = detect(ProbeSurvey(track, PROBE, "chirp"))
    maps = build_maps(LocatedDetection(found, T_BASE_SKULL @ Ts_skull_probe))
    assert rms(errors_mm(maps.outer, skull.outer_z)) < 0.05
    assert rms(errors_mm(maps.inner, inner_z(skull))) < 0.45
    assert maps.inner.ok.sum() > 0.4 * maps.outer.ok.sum()


# --- fusion -------------------------------------------------------------------------------------


CLUMSY = CloudPrior(0.8, 0.008)  # as ``displaced`` moves a cloud


@pytest.mark.slow
def test_fusing_is_hardly_worse_where_there_is_ultrasound_and_reaches_further():
    """Monte Carlo: a cloud that is 1 mm off as a whole must not spoil the map."""
    alone, fused, beyond, naive = [], [], [], []
    for seed in range(4):
        rng, skull = np.random.default_rng(seed), WavySkull(seed + 40)
        detection, poses = survey(skull, rng, radius_mm=15.0, outer_sd_mm=0.2, lines_mm=2.5)
        T_error = displaced(rng)
        points = cloud(skull, rng, 500, radius_mm=20.0, T_error=T_error)
        maps = build_outer_maps(LocatedDetection(detection, poses), points, prior=CLUMSY)
        late = lateness_mm(PROBE, 1 / 80)  # these detections are not late: take it as known
        alone.append(rms(errors_mm(maps.outer, skull.outer_z) - late))
        fused.append(rms(errors_mm(maps.fused, skull.outer_z, maps.outer.ok) - late))
        further = errors_mm(maps.fused, skull.outer_z, ~maps.outer.ok) - late
        assert len(further) > 20
        beyond.append(rms(further))
        naive.append(rms(cloud_errors(points, skull)))
        assert maps.cloud_fit.rms_mm < 0.5
    # this cloud scatters more than the A-scans, and no two of its points err alike, so that
    # counting those of a patch as one leaves a little of what the cloud as a whole is off by
    assert np.mean(fused) <= 1.15 * np.mean(alone)
    assert max(np.array(fused) / alone) < 1.2
    assert np.mean(beyond) < 0.5 * np.mean(naive)


def test_a_cloud_counts_as_it_scatters_itself_not_as_the_map_is_off():
    """The map is wavy by 0.15 mm where the bone, and the cloud with it, is a dome."""
    rng = np.random.default_rng(5)
    rows = np.arange(-15.0, 15.1, 2.5)
    places = np.column_stack([axis.ravel() for axis in np.meshgrid(rows, np.arange(-15, 16, 1.0))])
    wave = 0.15 * np.sin(2 * np.pi * places[:, 0] / 10.0)

    def dome_mm(at):
        return -np.sum(at**2, axis=1) / 160.0

    plate = fit_field(places, dome_mm(places) + wave + rng.normal(0.0, 0.01, len(places)))
    touched = rng.uniform(-18.0, 18.0, (1500, 2))
    heights = dome_mm(touched) + rng.normal(0.0, 0.02, len(touched))
    found = fuse_cloud(np.column_stack((touched, heights)), plate, 2.5, CloudPrior())
    assert found.scatter_mm > 0.08  # about the map
    assert rms(found.plate.heights(places) - dome_mm(places)) < 0.65 * rms(wave)


def test_a_fused_map_is_less_sure_where_points_nearby_miss_it():
    """Beside the ultrasound the bone has a groove that is too narrow for the plate."""
    rng = np.random.default_rng(6)
    side = np.arange(-15.0, 15.1, 1.5)
    places = np.column_stack([axis.ravel() for axis in np.meshgrid(side, side)])
    places = places[places[:, 0] < 3.0]
    plate = fit_field(places, rng.normal(0.0, 0.01, len(places)))
    touched = rng.uniform(-18.0, 18.0, (2500, 2))
    groove = -0.8 * np.exp(-0.5 * ((touched[:, 0] - 10.0) / 0.4) ** 2)
    heights = groove + rng.normal(0.0, 0.05, len(touched))
    found = fuse_cloud(np.column_stack((touched, heights)), plate, 2.5, CloudPrior())
    along = np.linspace(-10.0, 10.0, 9)
    beside, within = (
        found.cloud_sigmas_mm(np.column_stack((np.full(len(along), u), along)))
        for u in (-8.0, 10.0)
    )
    assert 0.03 < beside.min() < found.scatter_mm < 0.06  # the points err by 0.05 mm
    assert np.median(within) > 2.0 * np.median(beside)


def cloud_errors(points_base, skull):
    p = T_BASE_SKULL.inv() @ points_base
    return skull.outer_z(p[:, :2]) - p[:, 2]


def test_the_displacement_is_found_along_the_normal_and_a_slide_is_owned_up_to():
    rng, skull = np.random.default_rng(8), WavySkull(48)
    detection, poses = survey(skull, rng, radius_mm=20.0)
    T_error = Pose.from_translation((0.0, 0.0, -1.5))  # along the normal of the dome's top
    points = cloud(skull, rng, 600, radius_mm=18.0, sd_mm=0.05, T_error=T_error)
    fit = build_maps(LocatedDetection(detection, poses), points).cloud_fit
    corrected = T_BASE_SKULL.inv() @ (fit.correction @ points)
    off = skull.outer_z(corrected[:, :2]) - corrected[:, 2]
    assert abs(off.mean()) < 0.05
    assert rms(off) < 0.12
    # turning about the normal and sliding along the dome are hardly seen
    assert fit.eigenvalues[0] < 1e-2 * fit.eigenvalues[-1]
    assert np.all(np.diff(fit.eigenvalues) >= 0)


def test_a_cloud_elsewhere_changes_nothing():
    rng, skull = np.random.default_rng(9), WavySkull(49)
    detection, poses = survey(skull, rng, radius_mm=15.0, lines_mm=3.0)
    far = cloud(skull, rng, 200) + (500.0, 0.0, 0.0)
    maps = build_maps(LocatedDetection(detection, poses), far)
    assert maps.cloud_fit is None
    np.testing.assert_array_equal(maps.fused.height_mm, maps.outer.height_mm)
    np.testing.assert_array_equal(maps.fused.ok, maps.outer.ok)


# --- refusals -----------------------------------------------------------------------------------


def test_degenerate_surveys_are_refused_by_name():
    rng, skull = np.random.default_rng(10), WavySkull(50)
    detection, poses = survey(skull, rng, radius_mm=12.0)
    n = len(detection)
    with pytest.raises(InvalidInputError, match="poses"):
        build_maps(LocatedDetection(detection, poses.select(slice(5))))
    blind = replace(detection, outer_ok=np.zeros(n, dtype=bool))
    with pytest.raises(DegenerateGeometryError, match="outer boundary"):
        build_maps(LocatedDetection(blind, poses))
    stroke = Poses(
        np.repeat(poses.rotations[:1], n, axis=0),
        poses.translations[0] + np.outer(np.linspace(0, 20, n), poses.rotations[0][:, 0]),
    )
    level = replace(detection, standoff_mm=np.zeros(n))
    with pytest.raises(DegenerateGeometryError, match="line"):
        build_maps(LocatedDetection(level, stroke))
    with pytest.raises(CancelledError):
        build_maps(LocatedDetection(detection, poses), cancel=lambda: True)


def test_without_inner_echoes_there_is_an_outer_map_alone():
    rng, skull = np.random.default_rng(11), WavySkull(51)
    detection, poses = survey(skull, rng, radius_mm=12.0, flagged=1.0)
    maps = build_maps(LocatedDetection(detection, poses))
    assert maps.outer.ok.any()
    assert not maps.inner.ok.any()
    assert len(maps.inner.points_base()) == 0
