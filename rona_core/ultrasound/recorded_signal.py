"""What a recording says about its own band, its converter's limits and what was lost at them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.ndimage import maximum_filter1d

from rona_core.arrays import Bools, Floats
from rona_core.errors import DegenerateGeometryError, InvalidInputError

Complexes = NDArray[np.complex128]

WINDOW_US = 4.0  # in which spectra are taken
LOWEST_MHZ = 0.2
LOUD_SHARE = 0.04  # of the windows that hold echoes
PRIOR_OCTAVES = 0.5  # how far a named probe may be off
CLEAR = 3.0  # loud over usual energy of a stretch with an echo
RISE = 4.0  # in energy, from one stretch to a later one: an echo has come
COMB_FLOOR = 0.04  # of the peak power
RELATIVE_BAND = (0.2, 1.2)  # -6 dB width over centre, as far as any transducer goes
RAIL = 0.985  # of the extreme value, from which on a flat run counts as clipped
FLAT_RUN = 3  # samples
MAX_LOST = 400  # clipped samples put right at once
SPIKE = 10.0  # over the usual jump from sample to sample outside the band
SPIKE_OUTSIDE = 0.5  # over what is inside the band
SPIKE_CYCLES = 0.12  # on either side
MOST_SPIKES = 0.1  # of a line; with more of them it is not spikes
BESIDE = 4  # samples next to a gap that are all taken
MOST_KNOWN = 200  # others
NOISE_SHARE = 1e-4  # of the power, so that the restoration stays finite


@dataclass(frozen=True, slots=True)
class Band:
    """Centre and -6 dB width of the echoes' amplitude spectrum."""

    centre_mhz: float
    width_mhz: float

    @property
    def length_us(self) -> float:
        """Return the time that two echoes must be apart to be told apart."""
        return 1.0 / self.width_mhz

    def response(self, frequencies_mhz: Floats) -> Floats:
        """Return a smooth band pass (f,): 1 inside, 0 at more than twice the width."""
        off = np.abs(frequencies_mhz - self.centre_mhz) / self.width_mhz
        passed = 0.5 * (1.0 + np.cos(np.pi * np.clip((off - 0.7) / 0.8, 0.0, 1.0)))
        low = np.clip((frequencies_mhz / self.centre_mhz - 0.1) / 0.25, 0.0, 1.0)
        return passed * np.sin(0.5 * np.pi * low) ** 2


def find_band(
    rf: Floats,
    clipped: Bools,
    sampling_mhz: float,
    prior_mhz: float | None = None,
    emitting: bool = False,
) -> Band:
    """Return the band of the echoes: the spectrum of the loudest stretches over the usual one.

    Args:
        rf: Lines (n, samples).
        clipped: Samples (n, samples) at a limit of the converter.
        sampling_mhz: Of the lines.
        prior_mhz: Nominal centre frequency, where somebody knows it.
        emitting: Whether the lines are known to begin with the emission.

    Raises:
        DegenerateGeometryError: nothing stands out of the noise.
    """
    size = min(rf.shape[1], max(32, round(WINDOW_US * sampling_mhz)))
    every = max(1, len(rf) // 200)
    lines, cut = rf[::every], clipped[::every]
    starts = np.arange(0, rf.shape[1] - size + 1, max(1, size // 2))
    pieces = np.stack([lines[:, s : s + size] for s in starts], axis=1).reshape(-1, size)
    whole = ~np.stack([cut[:, s : s + size].any(axis=1) for s in starts], axis=1).reshape(-1)
    pieces = pieces - pieces.mean(axis=1)[:, None]
    padded = 4 * size
    f: Floats = np.fft.rfftfreq(padded, 1.0 / sampling_mhz).astype(np.float64)
    power = np.abs(np.fft.rfft(pieces * np.hanning(size), padded)) ** 2
    power = np.where(f > LOWEST_MHZ, power, 0.0)
    energy = power @ (f / f[-1])  # drift is slow and must not count as loud
    if clipped.any() or emitting:
        # the ring-down of the emission may be louder than the echoes, above all than cut off ones
        shape = (len(lines), len(starts))
        early = _emission(energy.reshape(shape), whole.reshape(shape), emitting).ravel()
        energy = np.where(early, 0.0, energy)
    some = max(1, round(LOUD_SHARE * len(energy)))
    if whole.sum() > some and np.sort(energy[whole])[-some] > CLEAR * np.median(energy):
        energy = np.where(whole, energy, 0.0)  # what was cut off has harmonics
    floor = 0.25 if not whole[np.argmax(energy)] else COMB_FLOOR
    share = min(max(LOUD_SHARE, 1.5 / len(energy)), 1.0)
    loud = energy >= np.quantile(energy, 1.0 - share)
    echo = np.clip(power[loud].mean(axis=0) - np.median(power, axis=0), 0.0, None)
    if prior_mhz is not None:
        echo = echo * np.exp(-0.5 * (np.log2(np.maximum(f, 1e-6) / prior_mhz) / PRIOR_OCTAVES) ** 2)
    if not echo.max() > 0:
        raise DegenerateGeometryError("there is no echo in these lines: every stretch is alike")
    echo = _smoothed(echo, f)
    top = int(np.argmax(echo))
    # two echoes in one window make a comb: its teeth belong together
    inside = echo > floor * echo[top]
    low = top - int(np.argmin(inside[top::-1])) + 1 if not inside[: top + 1].all() else 0
    high = top + int(np.argmin(inside[top:])) if not inside[top:].all() else len(f)
    half = np.flatnonzero(echo[low:high] > 0.25 * echo[top]) + low
    part = slice(int(half[0]), int(half[-1]) + 1)
    centre = float((f[part] * echo[part]).sum() / echo[part].sum())
    narrow, wide = RELATIVE_BAND
    width = float(np.clip(f[half[-1]] - f[half[0]], narrow * centre, wide * centre))
    return Band(centre, width)


def _emission(energy: Floats, whole: Bools, emitting: bool) -> Bools:
    """Return which stretches (n, k) are before the first rise.

    None of them, if there is no emission for certain and no echo was cut off behind it.
    """
    usual = np.median(energy, axis=0)
    rises = np.flatnonzero(usual[1:] > RISE * np.minimum.accumulate(usual)[:-1])
    first = int(rises[0]) + 1 if len(rises) else 0
    early = np.broadcast_to(np.arange(energy.shape[1]) < first, energy.shape)
    behind = ~early
    return early & bool(emitting or ((~whole & behind).any() and (whole & behind).any()))


def _smoothed(power: Floats, f: Floats) -> Floats:
    """Return the power over a window that grows with frequency: two echoes make a comb."""
    total = np.concatenate(([0.0], np.cumsum(power)))
    half = 0.12 * f / f[1]
    index = np.arange(len(f))
    first = np.clip(np.floor(index - half).astype(int), 0, len(f))
    last = np.clip(np.ceil(index + half).astype(int) + 1, 0, len(f))
    return (total[last] - total[first]) / (last - first)


def analytic(rf: Floats, sampling_mhz: float, band: Band) -> Complexes:
    """Return the lines (n, samples) within the band, as analytic signals."""
    size = rf.shape[1]
    edge = min(size - 1, round(3.0 * band.length_us * sampling_mhz))
    # turned over about its ends a line goes on smoothly: an offset or a drift is no step there
    line = rf - np.median(rf, axis=1)[:, None]
    before = 2.0 * line[:, :1] - line[:, edge:0:-1]
    after = 2.0 * line[:, -1:] - line[:, -2 : -edge - 2 : -1]
    fade = np.sin(0.5 * np.pi * np.arange(edge) / edge) ** 2
    whole = np.concatenate((before * fade, line, after * fade[::-1]), axis=1)
    padded = int(next_fast_len(whole.shape[1]) or whole.shape[1])
    f = np.fft.fftfreq(padded, 1.0 / sampling_mhz)
    gain = np.where(f > 0, 2.0 * band.response(np.abs(f)), 0.0)
    spectra = np.fft.fft(whole, padded, axis=1) * gain
    return np.fft.ifft(spectra, axis=1)[:, edge : edge + size]


# ------------------------------------------------------------------ clipping


def find_clipped(rf: Floats) -> Bools:
    """Return which samples (n, samples) stand at a limit of the converter.

    Such samples come in runs at an extreme value of the whole recording, where all but a few of
    the values near the extreme are alike.
    """
    clipped = np.zeros(rf.shape, dtype=np.bool_)
    middle = float(np.median(rf))
    for sign in (1.0, -1.0):
        value = sign * (rf - middle)
        top = float(value.max())
        near = value >= RAIL * top
        if top <= 0 or not near.any():
            continue
        # a wave that just fits reaches its extreme in one or two samples
        runs = _in_runs(near & (value >= top - 1e-9 * abs(top)), FLAT_RUN)
        if runs.sum() >= 2 * FLAT_RUN or (len(rf) == 1 and runs.any()):
            clipped |= _in_runs(near, 2) & near
    return clipped


def _in_runs(mask: Bools, least: int) -> Bools:
    """Return the samples that belong to a run of at least so many."""
    edges = np.diff(np.pad(mask.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, first = np.nonzero(edges == 1)
    last = np.nonzero(edges == -1)[1]
    kept = np.zeros((mask.shape[0], mask.shape[1] + 1), dtype=np.int32)
    long = last - first >= least
    np.add.at(kept, (rows[long], first[long]), 1)
    np.add.at(kept, (rows[long], last[long]), -1)
    return np.cumsum(kept, axis=1)[:, :-1] > 0


def restore_clipped(rf: Floats, clipped: Bools, sampling_mhz: float, band: Band) -> Floats:
    """Return the lines with what was cut off put back: what the band allows between the flanks.

    The signal counts as Gaussian with the power of the band. Cut samples are conditioned on all
    others near them and on being beyond the limit (a few of them at a time are pushed there).
    """
    restored = rf.copy()
    if not clipped.any():
        return restored
    correlation = _correlation(band, sampling_mhz, rf.shape[1])
    reach = max(8, round(2.5 * band.length_us * sampling_mhz))
    middle = np.median(rf, axis=1)
    for row, first, last in _clusters(clipped, reach):
        part = slice(max(0, first - reach), min(rf.shape[1], last + reach))
        values = rf[row, part] - middle[row]
        lost = clipped[row, part]
        if lost.sum() > MAX_LOST or lost.all():
            continue
        restored[row, part] = middle[row] + _restored(values, lost, correlation)
    return restored


def find_spikes(rf: Floats, clipped: Bools, sampling_mhz: float, band: Band) -> Bools:
    """Return which samples (n, samples) are of short disturbances that no band contains.

    What is outside the band jumps there by far more than it usually does, and by half as much as
    what is inside at least; the onset of an echo has something outside too, but less.
    """
    z = analytic(rf, sampling_mhz, band)
    reach = max(3, round(band.length_us * sampling_mhz))
    jump = np.abs(np.diff(rf - z.real, axis=1, prepend=(rf - z.real)[:, :1]))
    # what is counted in few steps often does not change at all
    steps = np.diff(np.unique(rf[:: max(1, len(rf) // 50)]))
    usual = np.median(jump, axis=1)[:, None] / 0.6745
    usual = np.maximum(usual, steps.min()) if len(steps) else usual
    inside = maximum_filter1d(np.abs(z), reach, axis=1)
    spikes = (jump > SPIKE * usual) & (jump > SPIKE_OUTSIDE * inside) & (usual > 0)
    # a spike jumps up and down again
    width = 2 * max(1, round(SPIKE_CYCLES * sampling_mhz / band.centre_mhz)) + 1
    wide = maximum_filter1d(spikes.astype(np.int8), width, axis=1) > 0
    near = maximum_filter1d(clipped.astype(np.int8), 2 * reach + 1, axis=1) > 0
    wide &= ~near
    many = wide.mean(axis=1) > MOST_SPIKES
    return wide & ~many[:, None]


def without_spikes(rf: Floats, spikes: Bools, sampling_mhz: float, band: Band) -> Floats:
    """Return the lines with disturbed samples put right from their neighbours and the band."""
    restored = rf.copy()
    if not spikes.any():
        return restored
    correlation = _correlation(band, sampling_mhz, rf.shape[1])
    reach = max(8, round(1.5 * band.length_us * sampling_mhz))
    for row, first, last in _clusters(spikes, reach):
        part = slice(max(0, first - reach), min(rf.shape[1], last + reach))
        lost = spikes[row, part]
        if lost.sum() > MAX_LOST or lost.all():
            continue
        middle = float(np.median(rf[row, part][~lost]))
        values = np.where(lost, 0.0, rf[row, part] - middle)
        restored[row, part] = middle + _restored(values, lost, correlation)
    return restored


def _correlation(band: Band, sampling_mhz: float, size: int) -> Floats:
    padded = 2 * size
    f = np.fft.rfftfreq(padded, 1.0 / sampling_mhz)
    power = np.exp(-2.77 * ((f - band.centre_mhz) / (1.15 * band.width_mhz)) ** 2)
    correlation = np.fft.irfft(power, padded)[:size]
    return correlation / correlation[0] + 1.0  # and an offset: what is slow stays as it is


def _clusters(clipped: Bools, reach: int) -> Iterator[tuple[int, int, int]]:
    for row in np.flatnonzero(clipped.any(axis=1)):
        at = np.flatnonzero(clipped[row])
        for group in np.split(at, np.flatnonzero(np.diff(at) > reach) + 1):
            yield int(row), int(group[0]), int(group[-1]) + 1


def _restored(values: Floats, lost: Bools, correlation: Floats) -> Floats:
    limit = np.abs(values)
    sign = np.sign(values)
    # of what is known far from any gap, a sample now and then says as much as all of them
    kept = maximum_filter1d(lost.astype(np.int8), 2 * BESIDE + 1) > 0
    kept[:: max(1, len(values) // MOST_KNOWN)] = True
    target, known = values.copy(), ~lost
    for _ in range(6):
        index = np.flatnonzero(known & kept)
        covariance = toeplitz(correlation[: len(values)])
        inner = covariance[np.ix_(index, index)] + NOISE_SHARE * np.eye(len(index))
        weights = cho_solve(cho_factor(inner, check_finite=False), target[index])
        guess = covariance[:, index] @ weights
        target = np.where(known, target, guess)
        below = lost & ~known & (sign * target < limit)
        if not below.any():
            break
        target = np.where(below, sign * limit, target)  # at least as far out as the limit
        known = known | below
    return target


def check_lines(rf: Floats) -> None:
    """Raise ``InvalidInputError`` unless these are lines (n, samples) of finite numbers."""
    if rf.ndim != 2 or rf.shape[0] < 1 or rf.shape[1] < 64 or not np.isfinite(rf).all():
        raise InvalidInputError(
            f"recorded lines must be finite, (scans, 64 or more samples), not {rf.shape}"
        )
