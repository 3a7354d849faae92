"""Real records of plates, where they are at hand, and random parts of them, changed.

Each window has 15 to 60 lines; half of them get noise of 20 to 40 dB under the rms of the lines,
half a gain of up to 6 dB for each line, and a third each another unit of amplitude, positions in
metres, and half the sampling rate.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import decimate

from rona_core.devices.files.rf.rf_data import RecordedRf, rf_from_arrays

CENTRE_MHZ = 2.25  # of both probes


@dataclass(frozen=True, slots=True)
class Plate:
    """A real record; the thickness is nominal, None where it is not known."""

    file: str
    speed_mm_per_us: float
    thickness_mm: float | None


PLATES = {
    "acrylic": Plate("LineScan2D_PinsPlexiAluSDH.mat", 2.73, 31.0),
    "copper": Plate("CopperBlock_2degtTilt.mat", 5.01, None),
}


def folder() -> Path:
    """Return where the real records are: ``RONA_SHARED``, else beside the repository."""
    beside = Path(__file__).resolve().parents[2].parent / "shared"
    return Path(os.environ.get("RONA_SHARED", beside)) / "data" / "rf"


def read(plate: Plate) -> RecordedRf:
    """Return the whole of a real record."""
    data = loadmat(folder() / plate.file)
    rf = data["ptx"].T.astype(np.float64)
    arrays = {
        "rf": rf,
        "fs": float(data["fs"].item()),
        "t0": float(data["tDelay"].item()),
        "positions": 1e3 * float(data["xStep"].item()) * np.arange(len(rf)),
    }
    return rf_from_arrays(arrays, plate.file)


def window(record: RecordedRf, rng: np.random.Generator) -> RecordedRf:
    """Return some lines of a record, changed as another recorder would."""
    n = int(rng.integers(15, 61))
    first = int(rng.integers(0, len(record) - n + 1))
    rf, rate = record.rf[first : first + n].copy(), record.sampling_mhz
    places = record.positions_mm
    places = None if places is None else places[first : first + n]
    if rng.random() < 0.5:
        rf += rng.normal(0.0, rf.std() * 10.0 ** (-rng.uniform(20.0, 40.0) / 20.0), rf.shape)
    if rng.random() < 0.5:
        rf *= 10.0 ** (rng.uniform(-6.0, 6.0, (n, 1)) / 20.0)
    if rng.random() < 1 / 3:
        rf *= 10.0 ** rng.uniform(-6.0, 6.0)
    if rng.random() < 1 / 3 and places is not None:
        places = 1e-3 * places
    if rng.random() < 1 / 3:
        rf, rate = decimate(rf, 2, axis=1, ftype="fir"), rate / 2.0
    return replace(record, rf=rf, sampling_mhz=rate, positions_mm=places)
