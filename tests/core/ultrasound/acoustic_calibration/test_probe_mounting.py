"""A gauge plate tells where the face of the probe is, and how fast its line."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.settings import DeviceSettings, ProbeSettings
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.ultrasound.acoustic_calibration.probe_mounting import calibrate_mounting
from rona_core.ultrasound.probe.probe_model import probe_model
from rona_core.virtual.acoustics.plates import VirtualBench
from rona_core.virtual.scene import VirtualScene
from rona_core.virtual.world.world import NOMINAL
from tests.helpers.sphere_world import ShiftError, SphereSpecimen

DEPTHS = (0.3, 0.6, 0.9, 1.2)
AT_MM = 1.5  # by which a scan presses the line


def gauge_in(world, settings=ProbeSettings(), seed=3):  # noqa: B008 (immutable)
    scene = VirtualScene(
        seed,
        SphereSpecimen(),
        DeviceSettings(),
        robot_error=ShiftError(),
        T_tip_toolmarker=Pose.identity(),
        world=world,
    )
    bench = VirtualBench(scene)
    tracks, sigmas = zip(*(bench.record_gauge_plate(settings, d, 6) for d in DEPTHS), strict=True)
    return tracks, sigmas[0]


def found_in(world, settings=ProbeSettings(), seed=3):  # noqa: B008 (immutable)
    tracks, sigma_mm = gauge_in(world, settings, seed)
    probe = probe_model(settings)
    return calibrate_mounting(tracks, DEPTHS, sigma_mm, probe, settings.excitation)


def placed_wrong_mm(found, world, settings):
    """Return by how much a boundary at the depth of a scan is then placed too deep."""
    probe, offset = probe_model(settings), world.clamping.translation[2]
    speed = probe.line.speed_mm_per_us - 0.0025 * world.line_excess_k
    delay_us = 2.0 * (probe.line_length_mm - AT_MM - offset) / speed
    believed = probe.with_line_delay(found.line_delay_us).line.speed_mm_per_us
    standoff = delay_us * believed / 2.0 - probe.line_length_mm
    return found.offset_mm + standoff + AT_MM


@pytest.mark.sweep(2)
@pytest.mark.parametrize("settings", [ProbeSettings(), ProbeSettings("1MHz", "pulse")])
@pytest.mark.parametrize("seed", range(4))
def test_a_scan_is_placed_right_however_warm_and_however_clamped(settings, seed):
    for excess_k, mounting_mm in ((0.0, 0.0), (10.0, 0.3), (-4.0, 0.8)):
        drawn = replace(
            NOMINAL, seed=seed, line_excess_k=excess_k, mounting_mm=mounting_mm, mounting_deg=0.5
        )
        found = found_in(drawn, settings, seed)
        assert found.verdict == "good"
        assert found.sigma_mm == pytest.approx(0.02, abs=0.01)
        assert abs(placed_wrong_mm(found, drawn, settings)) < 4.0 * found.sigma_mm


@pytest.mark.slow
def test_the_stated_sigma_holds_over_many_gauges():
    drawn = replace(NOMINAL, line_excess_k=8.0, mounting_mm=0.3)
    ratios = []
    for seed in range(40):
        found = found_in(drawn, seed=seed)
        ratios.append(placed_wrong_mm(found, drawn, ProbeSettings()) / found.sigma_mm)
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.4
    assert np.mean(np.abs(ratios) < 1.96) >= 0.85


def test_what_is_no_gauge_is_refused_or_bad():
    settings, probe = ProbeSettings(), probe_model("2.25MHz")
    tracks, sigma = gauge_in(NOMINAL)
    with pytest.raises(InvalidInputError, match="3 depths or more"):
        calibrate_mounting(tracks[:2], DEPTHS[:2], sigma, probe, settings.excitation)
    with pytest.raises(InvalidInputError, match=r"span 0\.30 mm"):
        calibrate_mounting(tracks, (1.0, 1.1, 1.2, 1.3), sigma, probe, settings.excitation)
    shuffled = (tracks[2], tracks[0], tracks[3], tracks[1])
    found = calibrate_mounting(shuffled, DEPTHS, sigma, probe, settings.excitation)
    assert found.verdict == "bad"
    assert any("depths disagree" in reason for reason in found.reasons)
    silent = [replace(track, rf=np.zeros_like(track.rf)) for track in tracks]
    with pytest.raises(DegenerateGeometryError, match="clear echo"):
        calibrate_mounting(silent, DEPTHS, sigma, probe, settings.excitation)


def test_a_calibrated_line_changes_neither_what_is_sent_nor_when_it_is_recorded():
    probe = probe_model("2.25MHz")
    slow = probe.with_line_delay(1.02 * probe.line_delay_us)
    assert slow.line_delay_us == pytest.approx(1.02 * probe.line_delay_us)
    assert (slow.start_us, slow.chirp_length_us) == (probe.start_us, probe.chirp_length_us)
    again = slow.with_line_delay(probe.line_delay_us)
    assert again.line == probe.line
    assert again.start_us == probe.start_us
