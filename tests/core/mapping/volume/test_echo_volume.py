"""Echo volumes of bone that is known in closed form: where the ridges are, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reference.volume_modes import compounded
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.mapping.volume.inner_ridge import GAIN_DB_PER_MM, inner_ridge
from rona_core.mapping.volume.reconstruction import (
    ScanLines,
    VolumeSettings,
    reconstruct_volume,
)
from rona_core.ultrasound.detection.detect import detect
from rona_core.ultrasound.detection.echo_profiles import echo_profiles
from rona_core.ultrasound.probe.probe_model import ProbeSurvey, probe_model
from tests.helpers.ultrasound_scenes import WavySkull, scan
from tests.scenes.volume_lines import INNER, PROBE, SPEED_MM_PER_US, dome, plate

BARE = VolumeSettings(fill_radius_mm=0.0)


def volume_of(scene, settings=None):
    return reconstruct_volume(*scene, PROBE, settings)


# --- where the ridges are -------------------------------------------------------------------------


@pytest.mark.parametrize("thickness_mm", [3.5, 6.0, 10.0])
def test_a_plate_has_its_ridges_at_its_two_faces(thickness_mm):
    volume = volume_of(plate(thickness_mm))
    column = volume.amplitude[12, 12]
    front = np.argmax(column)
    assert volume.z_mm[front] == pytest.approx(0.0, abs=1e-9)
    assert column[front] == pytest.approx(1.0, abs=0.02)
    inner = np.argmin(np.abs(volume.z_mm + thickness_mm))
    lost = 10.0 ** (-GAIN_DB_PER_MM * thickness_mm / 20.0)
    assert column[inner] == pytest.approx(INNER * lost, rel=0.05)
    ridge = inner_ridge(volume)
    assert ridge.ok[2:-2, 2:-2].all()
    np.testing.assert_allclose(ridge.thickness_mm[ridge.ok], thickness_mm, atol=0.05)


def test_on_a_dome_thickness_is_counted_along_the_normal_of_the_map():
    radius_mm, thickness_mm = 80.0, 5.0
    volume = volume_of(dome(radius_mm, thickness_mm))
    ridge, (u, v) = inner_ridge(volume), (volume.outer.u_mm, volume.outer.v_mm)
    r2 = u[:, None] ** 2 + v**2
    below = np.sqrt((radius_mm - thickness_mm) ** 2 - r2) - radius_mm
    inside = r2 < 9.0**2
    assert ridge.ok[inside].mean() > 0.95
    sure = ridge.ok & inside
    off = ridge.thickness_mm - (volume.outer.height_mm - below)
    np.testing.assert_allclose(off[sure], 0.0, atol=0.08)


def test_bone_in_which_sound_is_faster_is_deeper():
    slow, outer = plate(6.0)
    fast = replace(slow, speeds_mm_per_us=1.1 * slow.speeds_mm_per_us)
    ridges = [inner_ridge(reconstruct_volume(x, outer, PROBE)) for x in (slow, fast)]
    both = ridges[0].ok & ridges[1].ok
    assert both.sum() > 200
    np.testing.assert_allclose(
        ridges[1].thickness_mm[both] / ridges[0].thickness_mm[both], 1.1, atol=0.01
    )


def test_before_the_outer_boundary_sound_runs_at_the_speed_of_gel():
    volume = volume_of(plate())
    before = np.argmin(np.abs(volume.z_mm - 0.5))
    # the bell is as wide in time as 0.5 mm of bone, and gel is slower
    seen = 0.5 * SPEED_MM_PER_US / 1.5
    assert volume.amplitude[12, 12, before] == pytest.approx(
        np.exp(-0.5 * (seen / 0.5) ** 2), abs=0.02
    )


@pytest.mark.parametrize("excitation", ["chirp", "pulse"])
def test_profiles_of_a_plate_hold_its_two_echoes_and_no_side_lobes(excitation):
    skull = WavySkull(4, roughness=0.0)
    settings = ProbeSettings(excitation=excitation, front_snr_db=70.0)
    track, _, depths = scan(skull, settings, seed=2, width_mm=3.0, tilt_deg=0.0, lift_sd_mm=0.1)
    probe = probe_model(settings)
    survey = ProbeSurvey(track, probe, excitation)
    found = detect(survey)
    held = echo_profiles(replace(survey, known_standoff_mm=found.standoff_mm))
    lags_us = np.tile(held.first_us + held.step_us * np.arange(held.level.shape[1]), (len(held), 1))
    np.testing.assert_allclose(held.at(lags_us), held.level, atol=1e-6)  # on its own samples
    front = held.at(np.zeros((len(held), 1)))[:, 0]
    np.testing.assert_allclose(front, found.outer_quality, atol=0.05)
    inner_us = 2.0 * depths[:, 1:] / found.sound_speed_mm_per_us
    late = lags_us[:, lags_us[0] > 2.2]
    level = held.at(late)
    peak_us = late[0, np.argmax(level, axis=1)]
    np.testing.assert_allclose(peak_us, inner_us[:, 0], atol=0.25)
    before = held.at(np.tile(np.linspace(-2.5, -1.4, 40), (len(held), 1)))
    assert 20.0 * np.log10(before.max()) < -30.0  # of the front echo there are -17 to -23 dB


# --- laws -----------------------------------------------------------------------------------------


def test_moving_bone_and_map_moves_the_volume():
    lines, outer = dome(aside_mm=0.37)
    moved = Pose.from_rotvec((0.4, -1.1, 0.7), (-300.0, 80.0, 1200.0))
    there = replace(
        lines,
        outer_points_base=moved @ lines.outer_points_base,
        axes_base=moved.rotate(lines.axes_base),
    )
    here = reconstruct_volume(lines, outer, PROBE)
    again = reconstruct_volume(there, replace(outer, T_base_map=moved @ outer.T_base_map), PROBE)
    both = here.measured & again.measured
    assert (here.measured != again.measured).mean() < 1e-3  # a line may just miss a column
    np.testing.assert_allclose(again.amplitude[both], here.amplitude[both], atol=1e-4)
    np.testing.assert_allclose(
        again.T_base_map.matrix(), (moved @ here.T_base_map).matrix(), atol=1e-9
    )


def test_the_order_of_the_a_scans_does_not_matter():
    lines, outer = dome()
    order = np.random.default_rng(3).permutation(len(lines.speeds_mm_per_us))
    held = replace(lines.profiles, level=lines.profiles.level[order])
    other = ScanLines(
        lines.outer_points_base[order], lines.axes_base[order], lines.speeds_mm_per_us[order], held
    )
    a, b = (reconstruct_volume(x, outer, PROBE) for x in (lines, other))
    np.testing.assert_array_equal(a.measured, b.measured)
    np.testing.assert_allclose(a.amplitude, b.amplitude, atol=1e-6)


def test_a_voxel_holds_the_mean_of_the_a_scans_that_pass_it():
    lines, outer = plate()
    twice = ScanLines(
        *(np.concatenate((part, part)) for part in (lines.outer_points_base, lines.axes_base)),
        np.tile(lines.speeds_mm_per_us, 2),
        replace(
            lines.profiles,
            level=np.concatenate((lines.profiles.level, 3.0 * lines.profiles.level)),
        ),
    )
    once, mean = (reconstruct_volume(x, outer, PROBE) for x in (lines, twice))
    np.testing.assert_allclose(mean.amplitude, 2.0 * once.amplitude, atol=1e-5)


def test_a_second_implementation_line_by_line_gives_the_same_volume():
    lines, outer = dome(aside_mm=0.37)
    volume = reconstruct_volume(lines, outer, PROBE)
    other = compounded(volume, lines, "linear", "mean")
    np.testing.assert_array_equal(other.measured, volume.measured)
    np.testing.assert_allclose(
        other.amplitude[volume.measured], volume.amplitude[volume.measured], atol=1e-6
    )


def test_gain_raises_what_is_deep_and_nothing_above_the_bone():
    volume = volume_of(plate())
    raised = volume.level_db(2.0) - volume.level_db()
    above = volume.z_mm >= 0.0
    np.testing.assert_allclose(raised[..., above], 0.0, atol=1e-4)
    deep = np.argmin(np.abs(volume.z_mm + 5.0))
    np.testing.assert_allclose(raised[..., deep], 10.0, atol=1e-3)


# --- what is refused ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("depth_step_mm", (0.0, 0.09, 1.01, float("nan"))),
        ("fill_radius_mm", (-0.1, 10.1, float("nan"), float("inf"))),
    ],
)
def test_settings_out_of_range_are_refused_by_name(name, values):
    for value in values:
        with pytest.raises(InvalidInputError, match=name):
            VolumeSettings(**{name: value})


def test_lines_that_do_not_fit_together_are_refused():
    lines, _ = plate()
    with pytest.raises(InvalidInputError, match="profiles need as many"):
        replace(lines, speeds_mm_per_us=lines.speeds_mm_per_us[1:])
    with pytest.raises(InvalidInputError, match="speed of sound"):
        replace(lines, speeds_mm_per_us=0.0 * lines.speeds_mm_per_us)
    with pytest.raises(InvalidInputError, match="axes"):
        replace(lines, axes_base=2.0 * lines.axes_base)
    with pytest.raises(InvalidInputError, match="outer points must be finite"):
        replace(lines, outer_points_base=np.nan * lines.outer_points_base)


def test_no_line_through_the_map_is_refused():
    lines, outer = plate()
    up = replace(lines, axes_base=-lines.axes_base)
    with pytest.raises(DegenerateGeometryError, match="none of 231 A-scans goes down"):
        reconstruct_volume(up, outer, PROBE)
    none = ScanLines(
        np.zeros((0, 3)),
        np.zeros((0, 3)),
        np.zeros(0),
        replace(lines.profiles, level=lines.profiles.level[:0]),
    )
    with pytest.raises(DegenerateGeometryError, match="none of 0 A-scans"):
        reconstruct_volume(none, outer, PROBE)


def test_a_map_without_an_area_is_refused():
    lines, outer = plate()
    row = replace(outer, v_mm=outer.v_mm[:1], height_mm=outer.height_mm[:, :1], ok=outer.ok[:, :1])
    with pytest.raises(DegenerateGeometryError, match="needs an area"):
        reconstruct_volume(lines, row, PROBE)
    with pytest.raises(DegenerateGeometryError, match="0 are mapped"):
        reconstruct_volume(lines, replace(outer, ok=~outer.ok), PROBE)


def test_a_grid_too_large_for_the_memory_is_refused():
    lines, outer = plate()
    far = replace(outer, height_mm=outer.height_mm.copy())
    far.height_mm[0, 0] = 1e5
    with pytest.raises(InvalidInputError, match="depth_step_mm"):
        reconstruct_volume(lines, far, PROBE)


def test_profiles_need_to_know_where_the_outer_boundary_is():
    track = scan(WavySkull(4), ProbeSettings(), seed=2, width_mm=2.0)[0]
    with pytest.raises(InvalidInputError, match="detect it first"):
        echo_profiles(ProbeSurvey(track, PROBE, "chirp"))
