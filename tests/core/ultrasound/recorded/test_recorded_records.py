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
    off = found.thickness_mm[found.ok] - 31.0
    assert np.abs(off).max() < 0.3  # half a cycle
    assert found.ok.mean() > 0.85
    assert np.abs(off).max() < 6.0 * np.median(found.sigma_mm[found.ok])
    assert not found.back_inverted  # aluminium is behind it


@real
def test_holes_before_the_back_of_the_copper_block_are_not_taken_for_it():
    found = detect_recorded(read("CopperBlock_2degtTilt.mat"), 5.01)
    assert found.clipped.all()
    # its front is cut off for 1.5 us: which cycle is which is not known, and sigma says so
    off = found.thickness_mm[found.ok] - np.median(found.thickness_mm[found.ok])
    assert np.abs(off).max() < 0.28  # a quarter cycle
    assert abs(np.median(found.thickness_mm[found.ok]) - 79.0) < 3.0 * np.median(found.sigma_mm)
    assert np.median(found.sigma_mm[found.ok]) > 0.3
    assert found.ok.mean() > 0.85


def test_waves_that_just_fit_are_not_clipped_and_those_cut_off_are():
    fits = record(varied(COARSE, sampling_mhz=50.0, full_scale=1.3, bits=12, rough=0.0))
    assert not find_clipped(fits.file.rf).any()
    cut = record(varied(COARSE, sampling_mhz=50.0, full_scale=0.3, bits=8))
    assert find_clipped(cut.file.rf).any(axis=1).all()


@pytest.mark.sweep(2)
@pytest.mark.parametrize(("back", "seed"), [(-0.6, 4), (-0.6, 5), (0.6, 3), (0.6, 4)])
def test_a_back_wall_cut_off_as_much_as_the_front_is_right_or_flagged(back, seed):
    made = record(varied(COARSE, full_scale=0.2, back=back, seed=seed))
    found = detect_recorded(made.file, COARSE.speed)
    off = (found.thickness_mm - made.thickness_mm)[found.ok]
    half_cycle_mm = 0.25 * COARSE.speed / COARSE.centre_mhz
    assert (np.abs(off) < 0.5 * half_cycle_mm).all()


def test_a_steep_wedge_over_a_floor_is_no_patchwork():
    made = record(Case(scans=16, floor_gap_mm=12.0, wedge_mm=1.0))
    found = detect_recorded(made.file, 2.85)
    assert found.ok.all()
    assert np.abs(found.thickness_mm - made.thickness_mm).max() < 0.05
