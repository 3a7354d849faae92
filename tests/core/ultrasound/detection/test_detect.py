"""Scenes here have other seeds than those on which the detector was adjusted."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import ProbeSettings
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.detection.ascan_curves import preview
from rona_core.ultrasound.detection.detect import (
    CLIPPED,
    NO_FRONT,
    NOMINAL_SPEED_MM_PER_US,
    TILTED,
    detect,
)
from rona_core.ultrasound.probe.probe_model import PROBES, ProbeSurvey, probe_model
from rona_core.virtual.acoustics.medium import Medium
from rona_core.virtual.acoustics.probe import VirtualProbe
from tests.helpers.ultrasound_scenes import Plates, StillClock, WavySkull, scan

PROBE = probe_model("2.25MHz")
CASES = [(name, kind) for name in PROBES for kind in ("pulse", "chirp")]
EVERY = pytest.mark.parametrize(("name", "excitation"), CASES)
SEEDS = (11, 12, 13)


@lru_cache(maxsize=4)
def surveys(name, excitation):
    """Return rough skulls scanned with tilt and lift errors, as (track, true depths) each."""
    found = []
    for seed in SEEDS:
        settings = ProbeSettings(name=name, excitation=excitation)
        track, _, truth = scan(WavySkull(seed), settings, seed=seed, lines_mm=3.0)
        found.append((track, truth))
    return found


def plate(name, excitation, depths, *, tilt_deg=0.0, lifts=(0.0,), snr=50.0, medium=None):
    clock, pose = StillClock(), [Pose.identity()]
    probe = VirtualProbe(clock, lambda times: pose[0].repeated(len(times)), Plates(depths), medium)
    probe.begin(ProbeSettings(name=name, excitation=excitation, front_snr_db=snr), 5, 0)
    scans = []
    for i, lift in enumerate(lifts):
        clock.time_s = 0.1 * i
        tilted = Pose.from_rotvec((np.deg2rad(tilt_deg), 0.0, 0.0))
        pose[0] = tilted @ Pose.from_translation((0.0, 0.0, -lift))
        scans.append(probe.acquire())
    return AScanTrack.from_scans(scans)


def test_the_scenes_are_as_hard_as_real_skulls():
    xy = np.random.default_rng(0).uniform(-12, 12, (3000, 2))
    tilts = np.concatenate([WavySkull(seed).inner_tilt_deg(xy) for seed in SEEDS])
    assert 5.5 < np.median(tilts) < 10.0
    assert 12.0 < np.percentile(tilts, 90) < 20.0


@pytest.mark.sweep(1)
@EVERY
def test_the_outer_boundary_is_found_everywhere_to_a_few_hundredths(name, excitation):
    probe = probe_model(name)
    for track, truth in surveys(name, excitation):
        found = detect(ProbeSurvey(track, probe, excitation))
        assert found.outer_ok.all()
        error = found.standoff_mm - truth[:, 0]
        sag_mm = probe.aperture_radius_mm**2 / (4 * 80.0)
        assert 0.0 < error.mean() < sag_mm + 0.01  # late by at most a^2 / 4R
        assert error.std() < 0.03


@pytest.mark.sweep(1)
@pytest.mark.parametrize(
    ("name", "excitation", "coverage", "wrong", "sd_mm"),
    [
        ("2.25MHz", "pulse", 0.3, 0.03, 0.25),
        ("2.25MHz", "chirp", 0.3, 0.03, 0.25),
        ("1MHz", "pulse", 0.3, 0.10, 0.45),
        ("1MHz", "chirp", 0.3, 0.10, 0.45),
    ],
)
def test_what_is_not_flagged_is_right_on_rough_skulls(name, excitation, coverage, wrong, sd_mm):
    errors, kept = [], []
    for track, truth in surveys(name, excitation):
        found = detect(ProbeSurvey(track, probe_model(name), excitation))
        errors.append(found.thickness_mm - truth[:, 1])
        kept.append(found.inner_ok)
    error, ok = np.concatenate(errors), np.concatenate(kept)
    assert ok.mean() > coverage
    assert np.mean(np.abs(error[ok]) > 1.0) < wrong
    assert error[ok].std() < sd_mm
    # and flagging is worth something: the flagged ones are wrong far more often
    assert np.mean(np.abs(error[~ok]) > 0.5) > 3.0 * np.mean(np.abs(error[ok]) > 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("excitation", ["pulse", "chirp"])
def test_subtracting_the_front_beats_the_plain_detectors(excitation):
    failures = {}
    for method in ("subtract", "matched", "threshold"):
        wrong = [
            np.abs(
                detect(ProbeSurvey(track, PROBE, excitation), method=method).thickness_mm
                - truth[:, 1]
            )
            > 1.0
            for track, truth in surveys("2.25MHz", excitation)
        ]
        failures[method] = np.concatenate(wrong).mean()
    assert failures["subtract"] < 0.3
    assert failures["subtract"] < 0.8 * min(failures["matched"], failures["threshold"])


@pytest.mark.sweep(4)
@EVERY
@pytest.mark.parametrize("thickness_mm", [5.0, 7.0, 9.0])
def test_flat_bone_is_measured_to_its_nominal_speed(name, excitation, thickness_mm):
    depths = np.array((0.0, 0.275, 0.725, 1.0)) * thickness_mm  # the nominal share of diploe
    quiet = Medium(speckle=0.0, outer_roughness_mm=0.0, inner_roughness_mm=0.0)
    track = plate(name, excitation, depths, snr=70.0, medium=quiet)
    found = detect(ProbeSurvey(track, probe_model(name), excitation))
    assert found.inner_ok[0]
    assert found.thickness_mm[0] == pytest.approx(thickness_mm, abs=0.12)


def test_the_plain_methods_find_flat_bone_with_a_pulse():
    track = plate("1MHz", "pulse", (0.0, 2.0, 5.0, 7.0), snr=60.0)
    for method in ("matched", "threshold"):
        found = detect(ProbeSurvey(track, probe_model("1MHz"), "pulse"), method=method)
        assert found.thickness_mm[0] == pytest.approx(7.0, abs=0.6)
        assert found.method == method


def test_thickness_is_proportional_to_the_speed_that_is_assumed():
    track = plate("2.25MHz", "pulse", (0.0, 1.8, 4.2, 6.0))
    slow, fast = (
        detect(ProbeSurvey(track, PROBE, "pulse"), sound_speed_mm_per_us=c, method="matched")
        for c in (2.5, 2.75)
    )
    assert fast.thickness_mm[0] / slow.thickness_mm[0] == pytest.approx(1.1, rel=1e-9)
    assert fast.standoff_mm[0] == slow.standoff_mm[0]
    assert 2.45 < NOMINAL_SPEED_MM_PER_US < 2.85


@pytest.mark.sweep(2)
@EVERY
def test_the_standoff_follows_the_probe_over_its_compliance(name, excitation):
    lifts = np.linspace(-1.9, 1.9, 9)
    track = plate(name, excitation, (0.0, 1.8, 4.2, 6.0), lifts=lifts)
    found = detect(ProbeSurvey(track, probe_model(name), excitation))
    assert found.outer_ok.all()
    np.testing.assert_allclose(found.standoff_mm, lifts, atol=0.06)


def test_a_probe_in_the_air_has_no_front():
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0), lifts=(0.0, 2.5, -2.5, 0.0))
    found = detect(ProbeSurvey(track, PROBE, "chirp"))
    np.testing.assert_array_equal(found.flag == NO_FRONT, (False, True, True, False))
    np.testing.assert_array_equal(found.outer_ok, (True, False, False, True))
    assert not found.inner_ok[1:3].any()


def test_noise_alone_is_no_bone():
    rng = np.random.default_rng(2)
    real = plate("2.25MHz", "pulse", (0.0, 1.8, 4.2, 6.0))
    n = 40
    track = AScanTrack(
        np.arange(n) * 0.1, rng.normal(0, 0.01, (n, real.rf.shape[1])).astype(np.float32),
        real.sampling_mhz, real.start_us, np.zeros(n, dtype=bool),
    )  # fmt: skip
    found = detect(ProbeSurvey(track, PROBE, "pulse"))
    assert (found.flag == NO_FRONT).all()
    assert not found.inner_ok.any()


def test_a_tilted_probe_is_flagged():
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0), tilt_deg=9.0)
    assert detect(ProbeSurvey(track, PROBE, "chirp")).flag[0] in (NO_FRONT, TILTED)


def test_clipping_is_flagged():
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0))
    clipped = replace(track, clipped=np.ones(1, dtype=bool))
    found = detect(ProbeSurvey(clipped, PROBE, "chirp"))
    assert found.flag[0] == CLIPPED
    assert not found.outer_ok[0]


def test_one_boundary_without_another_behind_it_is_not_called_bone():
    endless = (0.0, 1000.0, 2000.0, 3000.0)
    found = detect(
        ProbeSurvey(plate("2.25MHz", "pulse", endless, lifts=np.zeros(5)), PROBE, "pulse")
    )
    assert found.outer_ok.all()
    assert not found.inner_ok.any()


def test_a_later_record_moves_both_boundaries_and_nothing_else():
    track, poses, _ = scan(WavySkull(15), ProbeSettings(), seed=15, width_mm=6.0)
    found = detect(ProbeSurvey(track, PROBE, "chirp", positions_mm=poses.translations))
    late_us = 0.12
    late = replace(track, start_us=track.start_us + late_us)
    other = detect(ProbeSurvey(late, PROBE, "chirp", positions_mm=poses.translations))
    both = found.outer_ok & other.outer_ok
    assert both.mean() > 0.8
    np.testing.assert_allclose(other.outer_us[both], found.outer_us[both] + late_us, atol=2e-4)
    inner = found.inner_ok & other.inner_ok
    assert inner.sum() >= 0.9 * found.inner_ok.sum()
    np.testing.assert_allclose(other.thickness_mm[inner], found.thickness_mm[inner], atol=3e-3)


def test_a_quieter_record_of_the_same_echoes_has_the_same_thickness():
    track, poses, _ = scan(WavySkull(15), ProbeSettings(), seed=15, width_mm=6.0)
    found = detect(ProbeSurvey(track, PROBE, "chirp", positions_mm=poses.translations))
    quiet = replace(track, rf=np.float32(0.8) * track.rf)
    other = detect(ProbeSurvey(quiet, PROBE, "chirp", positions_mm=poses.translations))
    np.testing.assert_allclose(other.outer_quality, np.minimum(0.8 * found.outer_quality, 1), 0.15)
    inner = found.inner_ok & other.inner_ok
    assert inner.sum() >= 0.9 * found.inner_ok.sum()
    moved = np.abs(other.thickness_mm - found.thickness_mm)[inner]
    assert np.percentile(moved, 95) < 0.02


def test_with_positions_the_order_of_the_scans_does_not_matter():
    track, poses, _ = scan(WavySkull(14), ProbeSettings(), seed=14, width_mm=6.0)
    order = np.random.default_rng(1).permutation(len(track))
    mixed = AScanTrack(
        track.times_s, track.rf[order], track.sampling_mhz, track.start_us, track.clipped[order]
    )
    places = poses.translations
    found = detect(ProbeSurvey(track, PROBE, "chirp", positions_mm=places))
    other = detect(ProbeSurvey(mixed, PROBE, "chirp", positions_mm=places[order]))
    np.testing.assert_allclose(other.outer_us, found.outer_us[order], atol=1e-9)
    np.testing.assert_array_equal(other.flag, found.flag[order])
    np.testing.assert_allclose(other.inner_us, found.inner_us[order], atol=1e-6)
    np.testing.assert_allclose(other.inner_quality, found.inner_quality[order], atol=1e-6)
    assert (found.thickness_sigma_mm > 0).all()
    assert (found.alternative_quality <= 1.0).all()
    with pytest.raises(InvalidInputError, match="positions"):
        detect(ProbeSurvey(track, PROBE, "chirp", positions_mm=places[1:]))


@pytest.mark.ci
def test_who_doubts_the_echo_doubts_its_cycle():
    """A boundary that is one in twenty another is no surer than a cycle that is one in twenty."""
    found = [detect(ProbeSurvey(track, PROBE, "chirp")) for track, _ in surveys("2.25MHz", "chirp")]
    sure, quality, sigma_us = (
        np.concatenate([getattr(one, name) for one in found])
        for name in ("inner_ok", "inner_quality", "inner_sigma_us")
    )
    cycles = sigma_us * PROBE.centre_mhz
    doubted, certain = sure & (quality < 0.95), sure & (quality > 0.99)
    assert doubted.any()
    assert certain.any()
    assert (cycles[doubted] > 0.05**0.5).all()
    assert np.median(cycles[certain]) < 0.15  # where nothing is doubted, sigma is that of the time


def test_no_scans_give_an_empty_detection():
    none = np.zeros(0)
    empty = AScanTrack(none, np.zeros((0, 1743), np.float32), 50.0, PROBE.start_us, none > 0)
    found = detect(ProbeSurvey(empty, PROBE, "chirp"))
    assert len(found) == 0


def test_wrong_settings_are_refused_by_name():
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0))
    with pytest.raises(InvalidInputError, match="guess"):
        detect(ProbeSurvey(track, PROBE, "chirp"), method="guess")
    with pytest.raises(InvalidInputError, match="speed"):
        detect(ProbeSurvey(track, PROBE, "chirp"), sound_speed_mm_per_us=0.3)
    with pytest.raises(InvalidInputError, match="25"):
        detect(ProbeSurvey(replace(track, sampling_mhz=25.0), PROBE, "chirp"))


@pytest.mark.parametrize("bad", [np.full((1, 3), np.nan), np.ones((2, 3)), np.ones(3)])
def test_axes_that_are_none_are_refused(bad):
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0))
    with pytest.raises(InvalidInputError, match="1 A-scans need axes"):
        detect(ProbeSurvey(track, PROBE, "chirp", positions_mm=np.zeros((1, 3)), axes=bad))


@pytest.mark.parametrize("bad", [np.array([np.nan]), np.zeros(2), np.zeros((1, 1))])
def test_standoffs_that_are_none_are_refused(bad):
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0))
    with pytest.raises(InvalidInputError, match="1 A-scans need known stand-offs"):
        detect(ProbeSurvey(track, PROBE, "chirp", known_standoff_mm=bad))


def test_it_can_be_cancelled_and_tells_how_far_it_is():
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0))
    shares = []
    detect(ProbeSurvey(track, PROBE, "chirp"), progress=shares.append)
    assert shares[-1] == 1.0
    with pytest.raises(CancelledError):
        detect(ProbeSurvey(track, PROBE, "chirp"), cancel=lambda: True)


def test_the_view_shows_the_echoes_where_they_were_found():
    track = plate("2.25MHz", "chirp", (0.0, 1.8, 4.2, 6.0), snr=70.0)
    found = detect(ProbeSurvey(track, PROBE, "chirp"))
    view = preview(track, 0, PROBE, "chirp", found)
    assert view.outer_us == found.outer_us[0]
    assert view.inner_us == found.inner_us[0]
    assert view.matched_us[np.argmax(view.matched)] == pytest.approx(view.outer_us, abs=0.06)
    later = np.abs(view.matched_us - view.outer_us - 6.0) < 3.5
    best = np.argmax(np.where(later, view.behind_front, 0.0))
    assert view.matched_us[best] == pytest.approx(view.inner_us, abs=0.25)
    assert len(view.rf) == len(view.time_us) == len(view.envelope) == track.rf.shape[1]
    assert np.all(view.envelope[200:-200] >= np.abs(view.rf[200:-200]) - 0.02)
    bare = preview(track, 0, PROBE, "chirp")
    assert bare.outer_us is bare.inner_us is bare.flag is None
    with pytest.raises(InvalidInputError, match="number 7"):
        preview(track, 7, PROBE, "chirp")
