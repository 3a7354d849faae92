"""A plate in lines of which nothing is known: laws, awkward recordings, and honest refusals."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.errors import CancelledError, DegenerateGeometryError, InvalidInputError
from rona_core.ultrasound.recorded.artefacts import find_clipped
from rona_core.ultrasound.recorded.band import find_band
from rona_core.ultrasound.recorded.plate_detector import (
    NO_FRONT,
    detect_recorded,
)
from tests.scenes.tank_recordings import CASES, PLATE, Case, record, varied

SMALL = varied(PLATE, scans=16, floor_gap_mm=12.0, wedge_mm=1.0)


@pytest.fixture(scope="module")
def plate():
    made = record(SMALL)
    return made, detect_recorded(made.file, SMALL.speed)


def detect_lines(rf, sampling_mhz, speed):
    """Return what is found in lines of which no more is known."""
    lines = np.asarray(rf, dtype=np.float64)
    return detect_recorded(RecordedRf("lines", lines, sampling_mhz, 0.0, False, None), speed)


def again(made, speed=SMALL.speed, **changes):
    return detect_recorded(replace(made.file, **changes), speed)


# -- laws ------------------------------------------------------------------------------------------


def test_gain_sign_and_offset_change_nothing(plate):
    made, found = plate
    for changed in (
        3.7 * made.file.rf,
        1e-14 * made.file.rf,
        1e14 * made.file.rf,
        -made.file.rf,
        made.file.rf - 250.0,
    ):
        other = again(made, rf=changed)
        np.testing.assert_allclose(other.thickness_mm, found.thickness_mm, atol=1e-6)
        assert (other.flag == found.flag).all()


def test_thickness_is_in_proportion_to_the_speed(plate):
    made, found = plate
    double = again(made, speed=2 * SMALL.speed)
    np.testing.assert_allclose(double.thickness_mm, 2 * found.thickness_mm, rtol=1e-12)
    np.testing.assert_allclose(double.sigma_mm, 2 * found.sigma_mm, rtol=1e-12)


def test_the_start_of_the_record_moves_the_front_only(plate):
    made, found = plate
    late = again(made, start_us=7.0)
    np.testing.assert_allclose(late.front_us, found.front_us + 7.0, atol=1e-9)
    np.testing.assert_allclose(late.lag_us, found.lag_us, atol=1e-9)


def test_the_order_of_the_scans_does_not_matter_where_they_have_positions(plate):
    made, found = plate
    order = np.random.default_rng(3).permutation(len(found))
    other = again(made, rf=made.file.rf[order], positions_mm=made.file.positions_mm[order])
    np.testing.assert_allclose(other.thickness_mm, found.thickness_mm[order], atol=1e-3)


def test_samples_twice_as_often_give_the_same(plate):
    made, found = plate
    size = made.file.rf.shape[1]
    spectra = np.fft.rfft(made.file.rf - made.file.rf.mean(axis=1)[:, None], axis=1)
    twice = np.fft.irfft(spectra, 2 * size, axis=1) * 2
    other = again(made, rf=twice, sampling_mhz=2 * made.file.sampling_mhz)
    np.testing.assert_allclose(other.thickness_mm, found.thickness_mm, atol=2e-3)


# -- awkward recordings ----------------------------------------------------------------------------

TRIED = [
    "plate, 30 mm",
    "PMMA 30 mm, clipped, floor",
    "aluminium, many multiples",
    "aluminium 5 MHz, floor",
    "clipped by 4, 8 bits, inverted",
    "clipped by 10",
    "inverted, air behind",
    "steel behind",
    "ring-down",
    "ring-down, same stand-off",
    "stand-off varies by 5 us",
    "drift, hum, 8 bits",
    "10 MHz sampling",
    "1 MHz",
    "5 MHz, thin",
    "damped pulse",
    "no positions, no t0",
    "bone",
    "bone 3 mm",
    "bone over a floor",
    "bone, layer inside",
    "weak: 25 dB",
    "one scan over a floor",
    "three scans, clipped",
    "water multiple before the back",
]


@pytest.mark.sweep(6)
@pytest.mark.parametrize("name", TRIED)
def test_the_plate_is_found_in(name):
    case = varied(CASES[name], seed=11)
    made = record(case)
    found = detect_recorded(made.file, case.speed)
    error = found.thickness_mm - made.thickness_mm
    assert found.ok.mean() > 0.95
    assert np.abs(error[found.ok]).max() < 0.1
    assert abs(np.median(error[found.ok])) < 0.06
    # no better than the noise allows: a figure below it would come from the truth
    assert found.sigma_mm[found.ok].min() > 0


def test_scans_without_contact_are_flagged_and_the_others_are_right():
    case = varied(CASES["dropouts"], seed=4)
    made = record(case)
    found = detect_recorded(made.file, case.speed)
    assert not made.contact.all()
    assert (found.ok == made.contact).all()
    assert (found.thickness_mm[~made.contact] == 0).all()
    assert np.abs(found.thickness_mm - made.thickness_mm)[made.contact].max() < 0.05


@pytest.mark.parametrize("changes", [{}, {"full_scale": 0.25}, {"snr_db": 20.0}, {"power": 1.3}])
def test_the_predicted_deviation_holds_the_errors(changes):
    """Those that all scans share, by the shape of the echoes, and those of each scan."""
    made = record(varied(PLATE, scans=60, **changes))
    found = detect_recorded(made.file, PLATE.speed)
    error = (found.thickness_mm - made.thickness_mm)[found.ok]
    assert (np.abs(error) < 2.5 * found.sigma_mm[found.ok]).mean() > 0.95
    assert found.sigma_mm[found.ok].max() < 0.32  # half a cycle


def test_noise_holds_no_plate():
    rng = np.random.default_rng(5)
    found = detect_lines(rng.normal(size=(30, 1500)), 50.0, 2.8)
    assert not found.ok.any()
    assert (found.flag == NO_FRONT).mean() > 0.8


def test_a_front_alone_is_no_plate():
    case = varied(PLATE, scans=20, back=0.0, multiples=0, length_us=35.0, shape="gauss")
    found = detect_recorded(record(case).file, case.speed)
    assert found.ok.mean() <= 0.1


@pytest.mark.sweep(2)
@pytest.mark.parametrize("n", [1, 20])
@pytest.mark.parametrize("length_us", [0.3, 0.4, 0.6])
def test_a_front_alone_in_little_noise_is_no_plate(n, length_us):
    """Made short, a front has side lobes that stand above such noise."""
    t = np.arange(2000) / 50.0 - 20.0
    front = np.exp(-((t / length_us) ** 2)) * np.sin(2.0 * np.pi * 2.25 * t)
    noise = np.random.default_rng(6).normal(0.0, 0.002, (n, 2000))
    assert not detect_lines(front + noise, 50.0, 2.8).ok.any()


@pytest.mark.parametrize("speed", [0.0, -2.8, 28.5, float("nan")])
def test_an_impossible_speed_is_refused(plate, speed):
    with pytest.raises(InvalidInputError, match="sound speed"):
        again(plate[0], speed=speed)


def test_cancelling_stops(plate):
    with pytest.raises(CancelledError):
        detect_recorded(plate[0].file, 2.85, cancel=lambda: True)


@pytest.mark.parametrize("bad", [np.zeros(100), np.zeros((3, 10)), np.full((2, 100), np.nan)])
def test_what_is_no_lines_is_refused(bad):
    with pytest.raises(InvalidInputError, match="recorded lines"):
        detect_lines(bad, 50.0, 2.8)


@pytest.mark.parametrize("samples", [64, 100, 200])
def test_a_line_no_longer_than_a_stretch_has_nothing_to_stand_out_of(samples):
    line = np.sin(np.arange(samples) * 0.3)[None]
    with pytest.raises(DegenerateGeometryError, match="every stretch is alike"):
        detect_lines(line, 50.0, 2.8)


def test_records_shorter_than_the_window_about_a_front_hold_no_plate():
    t = np.arange(200) / 50.0
    echo = np.exp(-(((t - 0.4) / 0.4) ** 2)) * np.sin(2.0 * np.pi * 2.25 * (t - 0.4))
    noise = np.random.default_rng(4).normal(0.0, 0.003, (3, 200))
    assert not detect_lines(echo + noise, 50.0, 2.8).ok.any()


def test_lines_at_their_limits_all_the_time_hold_no_plate():
    rng = np.random.default_rng(7)
    assert not detect_lines(np.sign(rng.normal(size=(10, 2000))), 50.0, 2.8).ok.any()


# -- parts -----------------------------------------------------------------------------------------


@pytest.mark.sweep(3)
@pytest.mark.parametrize("centre_mhz", [1.0, 2.25, 5.0])
@pytest.mark.parametrize("thickness_mm", [2.0, 9.0])
def test_the_band_is_that_of_the_pulse_even_where_echoes_interfere(centre_mhz, thickness_mm):
    case = Case(
        scans=10, centre_mhz=centre_mhz, thickness_mm=thickness_mm, shape="gauss", bandwidth=0.5
    )
    rf = record(case).file.rf
    band = find_band(rf, np.zeros(rf.shape, dtype=bool), case.sampling_mhz)
    assert band.centre_mhz == pytest.approx(centre_mhz, rel=0.12)
    assert 0.3 < band.width_mhz / centre_mhz < 1.0


def test_clipped_samples_are_known():
    t = np.arange(600) / 50.0
    whole = np.exp(-(((t - 6.0) / 0.6) ** 2)) * np.sin(2 * np.pi * 2.25 * t)
    lines = np.stack((whole, 0.3 * whole))
    cut = np.clip(lines, -0.5, 0.5)
    clipped = find_clipped(cut)
    np.testing.assert_array_equal(clipped, np.abs(lines) >= 0.5)
    assert not find_clipped(lines).any()  # a wave that just fits is not clipped


def test_a_recording_of_one_scan_gives_one_thickness():
    made = record(varied(PLATE, scans=1))
    bare = RecordedRf("x", made.file.rf, 50.0, 0.0, False, None)
    found = detect_recorded(bare, PLATE.speed)
    assert found.thickness_mm == pytest.approx([6.0], abs=0.03)
