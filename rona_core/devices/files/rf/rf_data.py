"""Recorded radio-frequency lines from HDF5, MATLAB and numpy files.

A file holds ``rf`` (scans, samples), ``fs`` in Hz and, if known, ``t0``, the time of the first
sample after the emission in s, and ``positions`` in mm, a row a scan. Nothing in a file is run.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.files.arrays import MAX_VALUES, RF, read_arrays
from rona_core.devices.files.text_tables import NamedFile
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly

SLOWEST_HZ, FASTEST_HZ = 1e6, 2e9  # of samples
MIN_SAMPLES = 64
MAX_START_S = 1.0
MAX_POSITION_MM = 1e4


@dataclass(frozen=True, slots=True, eq=False)
class RecordedRf:
    """Lines (n, samples) in whatever unit they were written in, and where they were taken."""

    name: str
    rf: Floats
    sampling_mhz: float
    start_us: float  # time of the first sample after the emission; 0 where it is not known
    start_known: bool
    positions_mm: Floats | None  # (n, 1 to 3)

    def __len__(self) -> int:
        return len(self.rf)


def read_rf(file: NamedFile) -> RecordedRf:
    """Read recorded lines, recognised by their content, not by the name of the file.

    Raises:
        InvalidInputError: no such file, damaged, a key missing, or a value that cannot be meant;
            it says which.
    """
    return rf_from_arrays(read_arrays(file), file.name)


def rf_from_arrays(arrays: Mapping[str, Any], name: str) -> RecordedRf:
    """Check arrays under the names of ``RF`` and return them as recorded lines.

    Raises:
        InvalidInputError: a key is missing, or a value cannot be meant; it says which.
    """
    missing = [key for key in RF[:2] if key not in arrays]
    if missing:
        there = ", ".join(name[:60] for name in sorted(arrays)[:20]) or "nothing"
        raise InvalidInputError(
            f"{name} has no {' and no '.join(missing)}: expected rf (scans, samples), fs in Hz "
            f"and, if known, t0 in s and positions in mm; it holds {there}"
        )
    rf = _lines(arrays["rf"], name, _rows(arrays.get("positions")))
    rate_hz = _number(arrays["fs"], f"{name}: fs")
    _check_rate(rate_hz, name)
    start_known = "t0" in arrays
    start_s = _number(arrays["t0"], f"{name}: t0") if start_known else 0.0
    if abs(start_s) > MAX_START_S:
        raise InvalidInputError(
            f"{name}: t0 is {start_s:g} s: expected seconds, such as {start_s * 1e-6:g}"
        )
    positions = None
    if "positions" in arrays:
        rows = _rows(arrays["positions"])
        if rows == rf.shape[1] != len(rf):
            raise InvalidInputError(
                f"{name}: rf has shape {rf.shape} and positions have {rows} rows: expected rf "
                "(scans, samples), so it seems to be transposed"
            )
        positions = _positions(arrays["positions"], len(rf), name)
    return RecordedRf(name, readonly(rf), rate_hz * 1e-6, start_s * 1e6, start_known, positions)


# ------------------------------------------------------------------ values


def _rows(positions: Any) -> int:
    """Return of how many scans there are positions; 0 without any."""
    shape = () if positions is None else np.shape(positions)
    # MATLAB has no vectors, only rows and columns
    return shape[1] if len(shape) == 2 and shape[0] == 1 else (shape or (0,))[0]


def _lines(value: Any, name: str, placed: int) -> Floats:
    """Return lines (n, samples) that can be meant; ``placed`` of them have positions."""
    rf = _numbers(value, f"{name}: rf")
    if rf.ndim != 2 or 0 in rf.shape:
        hint = {1: f"; a single line is written as (1, {rf.size})", 3: "; join its scans"}
        raise InvalidInputError(
            f"{name}: rf must have shape (scans, samples), not {rf.shape}{hint.get(rf.ndim, '')}"
        )
    n, samples = rf.shape
    if samples < MIN_SAMPLES:
        turned = "; it seems to be transposed" if n >= MIN_SAMPLES else ""
        raise InvalidInputError(
            f"{name}: rf has {n} scans of {samples} samples, shape (scans, samples): at least "
            f"{MIN_SAMPLES} samples are needed{turned}"
        )
    # with few samples a cycle a plate too is smoother from scan to scan: positions know better
    if n > samples and placed != n and _looks_transposed(rf):
        raise InvalidInputError(
            f"{name}: rf has shape {rf.shape}, expected (scans, samples): it runs smoothly along "
            "its first axis and not along its second, so it seems to be transposed; if it is not, "
            "give positions, a row a scan"
        )
    bad = int(np.count_nonzero(~np.isfinite(rf)))
    if bad:
        first = int(np.argmax(~np.isfinite(rf).all(axis=1)))
        raise InvalidInputError(
            f"{name}: rf must be finite, but {bad} of {rf.size} values are not, first in scan "
            f"{first}"
        )
    if (np.ptp(rf, axis=1) == 0).all():
        raise InvalidInputError(f"{name}: rf is constant: there is no signal in it")
    return rf


def _looks_transposed(rf: Floats) -> bool:
    """Return whether neighbours along scans are more alike than neighbours along samples."""
    part = rf[:2048, :2048]
    part = part[:, ~np.isnan(part).any(axis=0)]
    part = part - part.mean()
    power = float((part**2).mean())
    if power == 0 or min(part.shape) < 2:
        return False
    along_scans = float((np.diff(part - part.mean(axis=0), axis=0) ** 2).mean())
    along_samples = float((np.diff(part - part.mean(axis=1)[:, None], axis=1) ** 2).mean())
    return along_scans < 0.25 * along_samples and along_samples > power


def _check_rate(rate_hz: float, name: str) -> None:
    if SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        return
    hint = ""
    for factor, unit in ((1e6, "MHz"), (1e3, "kHz")):
        if SLOWEST_HZ <= rate_hz * factor <= 200e6:
            hint = f"; if {unit} are meant, write {rate_hz * factor:g}"
            break
    raise InvalidInputError(f"{name}: fs is {rate_hz:g}, expected samples per second in Hz{hint}")


def _positions(value: Any, n: int, name: str) -> Floats:
    positions = _numbers(value, f"{name}: positions")
    if positions.ndim == 1 and n == 1 and len(positions) <= 3:
        positions = positions[None, :]
    elif positions.ndim == 1:
        positions = positions[:, None]
    elif positions.shape == (1, n) and n > 1:
        positions = positions.T  # MATLAB has no vectors, only rows and columns
    if positions.ndim != 2 or len(positions) != n or not 1 <= positions.shape[1] <= 3:
        turned = " (transposed?)" if positions.ndim == 2 and positions.shape[1] == n else ""
        raise InvalidInputError(
            f"{name}: positions must have shape ({n}, 1), ({n}, 2) or ({n}, 3), a row a scan, "
            f"not {positions.shape}{turned}"
        )
    if not np.isfinite(positions).all():
        raise InvalidInputError(f"{name}: positions must be finite")
    if np.abs(positions).max(initial=0.0) > MAX_POSITION_MM:
        raise InvalidInputError(
            f"{name}: positions reach {np.abs(positions).max():g}: expected millimetres"
        )
    return readonly(positions)


def _number(value: Any, what: str) -> float:
    number = _numbers(value, what)
    if number.size != 1 or not np.isfinite(number).all():
        raise InvalidInputError(f"{what} must be one finite number, not {str(value)[:60]}")
    return float(number.reshape(-1)[0])


def _numbers(value: Any, what: str) -> Floats:
    array: NDArray[Any] = np.asarray(value)
    if array.dtype.kind not in "iufb":
        kind = "complex numbers" if array.dtype.kind == "c" else f"values of type {array.dtype}"
        raise InvalidInputError(f"{what} must be real numbers, not {kind}")
    if array.size > MAX_VALUES:
        raise InvalidInputError(f"{what} has {array.size} values: {MAX_VALUES} are allowed")
    return array.astype(np.float64)
