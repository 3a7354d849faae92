"""Recordings as laboratories make them: what went wrong once, and what must be left unsaid."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.ultrasound.recorded.artefacts import (
    find_spikes,
    remove_narrow_band_interference,
    remove_spikes,
)
from rona_core.ultrasound.recorded.band import Band
from rona_core.ultrasound.recorded.plate_detector import detect_recorded
from tests.scenes.laboratory.families import FAMILIES, draw
from tests.scenes.laboratory.laboratory import Bench, Hit, Matter, laboratory

ACRYLIC = Matter(2.73, 3.22, 1.3, 1.1)
STEEL = Matter(5.9, 46.0, 0.05, 2.0)
HIT = Hit("spike", 2.25, 1.5, ((1.0, 1.6), (0.9, 1.2)), 0.7, 0.03, 4.0)
TANK = Bench(HIT, ACRYLIC, 12.0, scans=16, length_us=70.0, standoff_us=30.0)


def judged(bench, seed=1):
    made = laboratory(bench, np.random.default_rng(seed))
    found = detect_recorded(made.file, made.speed)
    return made, found, found.thickness_mm - made.thickness_mm


MENDED = {
    "ring-down that beats": replace(TANK, bang=8.0, bang_us=0.8, standoff_us=14.0),
    "ring-down, one scan": replace(
        TANK, bang=20.0, bang_us=0.6, standoff_us=9.0, scans=1, layout="none"
    ),
    "bang beyond the converter": replace(
        TANK, bang=10.0, bang_us=0.7, full_scale=0.12, noise=0.001
    ),
    "delay line, no t0": replace(
        TANK, coupling="delay line", standoff_us=15.0, bang=4.0, start_known=False, length_us=45.0
    ),
    "contact": replace(
        TANK, coupling="contact", matter=STEEL, thickness_mm=20.0, bang=4.0, length_us=40.0
    ),
    "probe's multiple louder than the back wall": replace(
        TANK, matter=STEEL, thickness_mm=30.0, standoff_us=25.0, bang=3.0, length_us=75.0
    ),
    "probe's multiple runs away from its neighbours": replace(
        TANK,
        matter=STEEL,
        thickness_mm=20.0,
        standoff_wedge_us=5.0,
        standoff_sd_us=1.5,
        bang=4.0,
        length_us=75.0,
        layout="scatter",
        scans=30,
    ),
    "emission in a record that does not say so": replace(
        TANK, bang=3.0, start_us=-3.0, start_known=False
    ),
    "hum in the band": replace(TANK, hum=0.05, bits=10),
    "ring-down louder than what fronts were cut off at": replace(
        TANK, bang=10.0, bang_us=0.6, full_scale=0.2, scans=12
    ),
    "tilt and wedge alike": replace(TANK, standoff_wedge_us=0.6, wedge_mm=0.8),
    "spikes": replace(TANK, spikes=2.0, bits=8),
}


@pytest.mark.sweep(4)
@pytest.mark.parametrize("name", MENDED)
def test_the_plate_is_found_in(name):
    made, found, error = judged(MENDED[name])
    assert made.audible
    assert found.ok.all()
    assert np.abs(error).max() < 0.3
    assert abs(float(np.mean(error))) < 0.15


MENDED_DRAWS = [
    ("layer behind", 1007),  # a floor close behind, three times as loud
    ("layer behind", 1112),  # close behind the probe's own multiple
    ("layer behind", 1120),  # wanders a sample more than a louder floor
    ("few after bang", 1032),  # its multiple behind the probe's own is as loud
    ("few scans", 1012),  # the record ends within the probe's own multiple
    ("contact", 1009),  # a second round trip of 0.06
    ("bone", 1105),  # early, weak and lossy over a floor
    ("clipped", 1007),  # multiples as loud as the echo
    ("extremes", 1026),  # 0.5 MHz, a pulse as long as one cut off
    ("late record", 1225),  # an emission that rings once more
]


@pytest.mark.sweep(4)
@pytest.mark.parametrize(("family", "seed"), MENDED_DRAWS)
def test_the_plate_is_found_in_the_draw(family, seed):
    bench, made = draw(family, seed)
    found = detect_recorded(made.file, made.speed)
    off = np.abs(found.thickness_mm - made.thickness_mm)[found.ok]
    assert found.ok.mean() > 0.8
    assert (off < min(1.0, 0.2 * bench.thickness_mm)).all()


def test_a_swept_emission_is_flagged():
    chirp = replace(HIT, kind="chirp", cycles=14.0, resonances=((1.0, 0.9), (1.1, 0.9)))
    made, found, _ = judged(replace(TANK, hit=chirp, thickness_mm=20.0))
    assert made.audible
    assert not found.ok.any()


def test_fronts_cut_off_by_ten_are_explained_by_the_back_wall():
    whole = replace(TANK, noise=0.001, bits=14)
    _, _, error = judged(whole)
    _, found, cut = judged(replace(whole, full_scale=0.1))
    assert found.clipped.all()
    # half a cycle would be 0.3 mm
    assert abs(np.median(cut) - np.median(error)) < 0.1


@pytest.mark.sweep(1)
@pytest.mark.parametrize("radius_mm", [3.2, 6.4])
def test_the_spreading_field_of_a_probe_does_not_move_the_mean(radius_mm):
    bench = replace(TANK, matter=STEEL, thickness_mm=25.0, radius_mm=radius_mm, length_us=60.0)
    _, found, error = judged(bench)
    assert found.ok.all()
    # a turned phase taken for a delay would be up to a quarter of a cycle, 0.33 mm
    assert abs(float(np.median(error))) < 0.16


@pytest.mark.sweep(1)
@pytest.mark.parametrize("seed", [0, 1, 2, 3, 1019, 1045, 1086, 1087, 1104])
def test_a_back_wall_that_is_not_heard_is_not_invented(seed):
    _, made = draw("inaudible", seed)
    assert not made.audible
    assert not detect_recorded(made.file, made.speed).ok.any()


def test_dead_and_saturated_scans_are_flagged_and_harm_no_others():
    bench = replace(TANK, scans=30, dead=0.15, saturated=0.15)
    made, found, error = judged(bench, seed=3)
    assert 0 < made.whole.sum() < 30
    np.testing.assert_array_equal(found.ok, made.whole)
    assert np.abs(error[made.whole]).max() < 0.15


def test_spikes_are_known_and_put_right():
    t = np.arange(2000) / 50.0
    clean = np.exp(-(((t - 20.0) / 0.6) ** 2)) * np.sin(2 * np.pi * 2.25 * t)
    rf = np.tile(clean, (3, 1)) + np.random.default_rng(2).normal(0, 0.003, (3, 2000))
    hit = rf.copy()
    hit[1, 500] += 0.8
    hit[2, 1400:1402] -= 0.7
    none = np.zeros(rf.shape, dtype=bool)
    band = Band(2.25, 1.1)
    assert not find_spikes(rf, none, 50.0, band).any()  # an echo is no spike
    spikes = find_spikes(hit, none, 50.0, band)
    assert not spikes[0].any()
    assert spikes[1, 500]
    assert spikes[2, 1400:1402].all()
    mended = remove_spikes(hit, spikes)
    assert np.abs(mended - rf).max() < 0.1


def test_a_hum_is_taken_away_and_echoes_are_not():
    made, _, _ = judged(TANK)
    rate, rf = made.file.sampling_mhz, made.file.rf
    none = np.zeros(rf.shape, dtype=bool)
    band = Band(2.25, 1.2)
    assert np.array_equal(remove_narrow_band_interference(rf, none, rate, band), rf)
    t = np.arange(rf.shape[1]) / rate
    phase = np.linspace(0.0, 6.0, len(rf))[:, None]
    loudest = float(np.abs(rf).max())
    hum = 0.05 * loudest * np.sin(2 * np.pi * 2.63 * t + phase)
    left = remove_narrow_band_interference(rf + hum, none, rate, band) - rf
    assert np.sqrt((left**2).mean()) < 0.15 * np.sqrt((hum**2).mean())


@pytest.mark.sweep(3)
@pytest.mark.parametrize("family", FAMILIES)
def test_the_generator_tells_the_truth_about_a_draw(family):
    bench, made = draw(family, 7)
    assert made.file.rf.shape == (bench.scans, round(bench.length_us * bench.sampling_mhz))
    assert np.isfinite(made.file.rf).all()
    assert made.audible == (family != "inaudible")
    again = draw(family, 7)[1]
    np.testing.assert_array_equal(again.file.rf, made.file.rf)
