"""Recorded lines of real plates, and what they showed: limits met by single samples, patchwork."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from rona_core.devices.files.rf.rf_data import rf_from_arrays
from rona_core.ultrasound.recorded.artefacts import find_clipped
from rona_core.ultrasound.recorded.plate_detector import detect_recorded
from tests.scenes.tank_recordings import Case, record, varied

SHARED = Path(os.environ.get("RONA_SHARED", Path(__file__).resolve().parents[4].parent / "shared"))
RECORDS = SHARED / "data" / "rf"
real = pytest.mark.skipif(not RECORDS.is_dir(), reason="the real records are not here")
COARSE = Case(
    sampling_mhz=12.5,  # 5.5 samples a cycle
    thickness_mm=12.0,
    speed=2.73,
    front=0.37,
    loss_db_per_cm_mhz=0.6,
    bits=8,
    snr_db=45.0,
    standoff_sd_us=0.1,
    scans=40,
)


def read(name, *, positions=True, known_start=True):
    data = loadmat(RECORDS / name)
    rf = data["ptx"].T.astype(float)
    arrays = {"rf": rf, "fs": float(data["fs"].item())}
    if known_start:
        arrays["t0"] = float(data["tDelay"].item())
    if positions:
        arrays["positions"] = 1e3 * float(data["xStep"].item()) * np.arange(len(rf))
    return rf_from_arrays(arrays, name)


@pytest.mark.sweep(1)
@real
@pytest.mark.parametrize("positions", [True, False])
@pytest.mark.parametrize("known_start", [True, False])
def test_the_acrylic_plate_is_right_or_flagged(positions, known_start):
    lines = read("LineScan2D_PinsPlexiAluSDH.mat", positions=positions, known_start=known_start)
    found = detect_recorded(lines, 2.73)
    assert found.clipped.all()
    off = found.thickness_mm[found.ok] - 31.0
    assert np.abs(off).max() < 1.0
    assert abs(np.median(off)) < 0.2
    assert found.ok.mean() > 0.8
    assert not found.back_inverted  # aluminium is behind it


@real
def test_holes_before_the_back_of_the_copper_block_are_not_taken_for_it():
    found = detect_recorded(read("CopperBlock_2degtTilt.mat"), 5.01)
    assert found.clipped.all()
    # its front is cut off for 1.5 us: which cycle is which is not known, but the echo is
    assert np.abs(found.thickness_mm[found.ok] - 79.0).max() < 4.0


@pytest.mark.parametrize(("times", "bits"), [(2.0, 8), (4.0, 8), (3.0, 12)])
def test_single_samples_at_a_limit_are_clipped(times, bits):
    made = record(varied(COARSE, full_scale=1.0 / times, bits=bits, offset=0.0))
    rf = made.file.rf
    clipped = find_clipped(rf)
    at_limit = (rf == rf.max()) | (rf == rf.min())
    np.testing.assert_array_equal(clipped & at_limit, at_limit)
    lone = at_limit.copy()
    lone[:, 1:] &= ~at_limit[:, :-1]
    lone[:, :-1] &= ~at_limit[:, 1:]
    assert lone.sum() > 40, "else this test says nothing"


@pytest.mark.sweep(3)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("bits", [6, 8, 12])
def test_waves_that_just_fit_are_not_clipped(seed, bits):
    made = record(varied(COARSE, full_scale=1.3, bits=bits, seed=seed, rough=0.0))
    assert not find_clipped(made.file.rf).any()
    # a burst that is sampled at the same places in each cycle, without noise
    burst = np.zeros(400)
    burst[100:200] = np.rint(100.0 * np.sin(2.0 * np.pi * (np.arange(100) + 0.1 * seed) / 5.0))
    assert not find_clipped(np.repeat(burst[None], 30, axis=0)).any()


def test_converters_that_take_turns_have_limits_of_their_own():
    made = record(varied(COARSE, full_scale=2.0, bits=None, offset=0.0, drift=0.0))
    rf = made.file.rf / np.abs(made.file.rf).max()
    low = np.where(np.arange(rf.shape[1]) % 2 == 0, -0.30, -0.28)
    high = np.where(np.arange(rf.shape[1]) % 2 == 0, 0.27, 0.31)
    cut = np.clip(rf, low, high)
    found, lost = find_clipped(cut), (rf <= low) | (rf >= high)
    assert found[lost].all()
    near = (cut < 0.985 * low) | (cut > 0.985 * high)
    assert not found[~near].any()


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("back", "seed"), [(-0.6, 4), (-0.6, 5), (0.6, 3), (0.6, 4)])
def test_a_back_wall_cut_off_as_much_as_the_front_turns_no_half_cycle(back, seed):
    made = record(varied(COARSE, full_scale=0.2, back=back, seed=seed))
    found = detect_recorded(made.file, COARSE.speed)
    off = (found.thickness_mm - made.thickness_mm)[found.ok]
    half_cycle_mm = 0.25 * COARSE.speed / COARSE.centre_mhz
    assert abs(np.median(off)) < 0.2 * half_cycle_mm


def test_a_steep_wedge_over_a_floor_is_no_patchwork():
    made = record(Case(scans=16, floor_gap_mm=12.0, wedge_mm=1.0))
    found = detect_recorded(made.file, 2.85)
    assert found.ok.all()
    assert np.abs(found.thickness_mm - made.thickness_mm).max() < 0.05
