"""Laws over the kind: whatever part of a record is read, and in what unit, the answer is the same.

A line of a changed record is as thick as it was, to a quarter of a cycle, or it is flagged. The
records hold a plate over a floor with side-drilled holes in some lines, which are nearer than the
back wall and as loud.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import decimate

from rona_core.ultrasound.recorded.plate_detector import detect_recorded
from tests.scenes.real_plates import CENTRE_MHZ, PLATES, folder, read, window
from tests.scenes.tank_recordings import Case, record, varied

PLATE = Case(scans=60, thickness_mm=12.0, floor_gap_mm=12.0, length_us=70.0, snr_db=45.0)
CASES = {
    "whole": PLATE,
    "cut off": varied(PLATE, full_scale=0.25, bits=8),
    "inverted, unknown start": varied(PLATE, inverted=True, start_known=False, start_us=9.0),
    "bone": varied(PLATE, thickness_mm=6.0, bumps_mm=0.4, loss_db_per_cm_mhz=6.0),
    "damped, 25 samples a us": varied(PLATE, shape="damped", bandwidth=0.4, sampling_mhz=25.0),
}
real = pytest.mark.skipif(not folder().is_dir(), reason=f"no real records in {folder()}")


def with_hole(made, case):
    """Return the file with an echo of a hole over eight lines, in front of the back wall."""
    rf, rate = made.file.rf.astype(float), case.sampling_mhz
    loud = np.abs(rf).max(axis=1)
    for row in range(20, 28):
        at = round(rate * (5.2 + 0.02 * (row - 24) ** 2)) if case.thickness_mm > 10.0 else 0
        front = int(np.argmax(np.abs(rf[row]) > 0.9 * loud[row]))
        pulse = rf[row, front - round(0.5 * rate) : front + round(1.5 * rate)].copy()
        if at:
            start = front + at
            rf[row, start : start + len(pulse)] += 0.5 * pulse
    return replace(made.file, rf=rf)


@pytest.fixture(scope="module", params=CASES)
def base(request):
    case = CASES[request.param]
    made = record(case)
    file = with_hole(made, case)
    return case, made, file, detect_recorded(file, case.speed)


def same_or_flagged(case, found, wanted_mm):
    off = np.abs(found.thickness_mm - wanted_mm)[found.ok]
    if case.full_scale >= 1.0:  # of echoes that were cut off, few samples a cycle may say nothing
        assert found.ok.mean() > 0.7
    assert (off < 0.25 / case.centre_mhz * case.speed / 2.0).all()


def test_the_whole_record_is_right(base):
    case, made, _, found = base
    assert found.ok.mean() > 0.7
    same_or_flagged(case, found, made.thickness_mm)


@pytest.mark.parametrize("unit", [1e-9, 3.7, 2.0e5])
def test_the_unit_of_amplitude_does_not_matter(base, unit):
    case, _, file, found = base
    other = detect_recorded(replace(file, rf=unit * file.rf), case.speed)
    np.testing.assert_allclose(other.thickness_mm, found.thickness_mm, atol=1e-6)
    np.testing.assert_array_equal(other.flag, found.flag)


@pytest.mark.parametrize("unit", [1e-3, 1e-6, 25.4])
def test_the_unit_of_the_positions_does_not_matter(base, unit):
    case, _, file, found = base
    other = detect_recorded(replace(file, positions_mm=unit * file.positions_mm), case.speed)
    np.testing.assert_allclose(other.thickness_mm, found.thickness_mm, atol=1e-6)
    np.testing.assert_array_equal(other.flag, found.flag)


def test_a_gain_for_each_line_does_not_matter(base):
    case, _, file, found = base
    gain = 10.0 ** (np.random.default_rng(4).uniform(-10.0, 10.0, (len(file), 1)) / 20.0)
    other = detect_recorded(replace(file, rf=gain * file.rf), case.speed)
    np.testing.assert_allclose(other.thickness_mm, found.thickness_mm, atol=1e-6)
    np.testing.assert_array_equal(other.flag, found.flag)


def test_half_the_samples_give_the_same_or_a_flag(base):
    case, made, file, _ = base
    rf = decimate(file.rf, 2, axis=1, ftype="fir")
    other = detect_recorded(replace(file, rf=rf, sampling_mhz=file.sampling_mhz / 2.0), case.speed)
    same_or_flagged(case, other, made.thickness_mm)


@pytest.mark.parametrize("seed", range(4))
def test_any_lines_in_any_order_give_the_same_or_a_flag(base, seed):
    case, made, file, _ = base
    rng = np.random.default_rng(seed)
    rows = rng.permutation(len(file))[: int(rng.integers(15, 50))]
    part = replace(file, rf=file.rf[rows], positions_mm=file.positions_mm[rows])
    same_or_flagged(case, detect_recorded(part, case.speed), made.thickness_mm[rows])


@pytest.mark.sweep(2)
@pytest.mark.parametrize("seed", range(6))
def test_windows_with_noise_and_gains_give_the_same_or_a_flag(base, seed):
    case, made, file, _ = base
    numbered = replace(file, positions_mm=np.arange(len(file), dtype=float)[:, None])
    part = window(numbered, np.random.default_rng(seed))
    step = 1e-3 if np.ptp(part.positions_mm) < 1.0 else 1.0
    rows = np.rint(part.positions_mm[:, 0] / step).astype(int)
    same_or_flagged(case, detect_recorded(part, case.speed), made.thickness_mm[rows])


@real
@pytest.mark.sweep(2)
@pytest.mark.parametrize("name", PLATES)
@pytest.mark.parametrize("seed", range(900, 906))
def test_windows_of_a_real_record_give_the_same_or_a_flag(name, seed):
    plate = PLATES[name]
    whole = read(plate)
    usual = detect_recorded(whole, plate.speed_mm_per_us)
    found = detect_recorded(window(whole, np.random.default_rng(seed)), plate.speed_mm_per_us)
    off = found.thickness_mm[found.ok] - np.median(usual.thickness_mm[usual.ok])
    assert found.ok.mean() > 0.5
    assert (np.abs(off) < 0.25 / CENTRE_MHZ * plate.speed_mm_per_us / 2.0).all()
