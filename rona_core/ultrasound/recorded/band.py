"""Frequency band of recorded lines, learned from themselves, and filters made of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats

Complexes = NDArray[np.complex128]

WINDOW_US, WINDOW_CYCLES = 4.0, 6.0  # in which spectra are taken, at least
LEAST_WINDOWS = 4  # in a record, that show what is usual
LOWEST_MHZ = 0.2
LOUD_SHARE = 0.04  # of the windows that hold echoes
PRIOR_OCTAVES = 0.5  # how far a named probe may be off
CLEAR = 3.0  # loud over usual energy of a stretch with an echo
RISE = 4.0  # in energy, from one stretch to a later one: an echo has come
COMB_FLOOR = 0.04  # of the peak power
RELATIVE_BAND = (0.2, 1.2)  # -6 dB width over centre, as far as any transducer goes
RAYLEIGH_QUARTER, RAYLEIGH_HALF = 0.7585, 1.1774  # quantiles of envelopes over the rms of noise
QUIET_LENGTHS, ENOUGH_LENGTHS = 2.5, 5.0  # of the pulse: lines are quiet that far before a front
QUIET_LINE = 0.2  # of the usual height of a line
EDGE_SHARE = 0.9  # of half the sampling rate, next to it
FOLDED = 0.03  # power there; 0.002 at most in recordings with 6 samples a cycle, 0.01 with 3.7
TOUCHING = 0.55, 0.7  # power there, width over centre, below which only the end of a band is lost


@dataclass(frozen=True, slots=True)
class Band:
    """Centre and -6 dB width of the echoes' amplitude spectrum."""

    centre_mhz: float
    width_mhz: float
    edge: float = 0.0  # power next to half the sampling rate, over the largest

    @property
    def length_us(self) -> float:
        """Return the time that two echoes must be apart to be resolved."""
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
    window_us: float = WINDOW_US,
) -> Band:
    """Return the band of the echoes: the spectrum of the loudest stretches over the usual one.

    Args:
        rf: Lines (n, samples).
        clipped: Samples (n, samples) at a limit of the converter.
        sampling_mhz: Of the lines.
        prior_mhz: Nominal centre frequency, where it is known.
        emitting: Whether the lines are known to begin with the emission.
        window_us: Length of a stretch; longer ones are tried where it holds too few cycles.

    Raises:
        DegenerateGeometryError: nothing stands out of the noise.
    """
    size = min(rf.shape[1], max(32, round(window_us * sampling_mhz)))
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
    edge = _edge(_smoothed(echo, f), f)
    if prior_mhz is not None:
        echo = echo * np.exp(-0.5 * (np.log2(np.maximum(f, 1e-6) / prior_mhz) / PRIOR_OCTAVES) ** 2)
    if not echo.max() > 0:
        raise DegenerateGeometryError("there is no echo in these lines: every stretch is alike")
    echo = _smoothed(echo, f)
    part = _main_part(echo, floor)
    centre = float((f[part] * echo[part]).sum() / echo[part].sum())
    longer = WINDOW_CYCLES / centre  # the window's own width is no echo's
    if window_us < 0.8 * longer and rf.shape[1] > LEAST_WINDOWS * longer * sampling_mhz:
        return find_band(rf, clipped, sampling_mhz, prior_mhz, emitting, longer)
    narrow, wide = RELATIVE_BAND
    width = float(np.clip(f[part][-1] - f[part][0], narrow * centre, wide * centre))
    return Band(centre, width, edge)


def _main_part(echo: Floats, floor: float) -> slice:
    """Return where the power (f,) is above a quarter of its largest, teeth of a comb together."""
    top = int(np.argmax(echo))
    # two echoes in one window make a comb: its teeth belong together
    inside = echo > floor * echo[top]
    low = top - int(np.argmin(inside[top::-1])) + 1 if not inside[: top + 1].all() else 0
    high = top + int(np.argmin(inside[top:])) if not inside[top:].all() else len(echo)
    half = np.flatnonzero(echo[low:high] > 0.25 * echo[top]) + low
    return slice(int(half[0]), int(half[-1]) + 1)


def require_sampled(band: Band, sampling_mhz: float) -> None:
    """Raise InvalidInputError where the echoes reach up to half the sampling rate.

    What is above it has come back folded. A band of which only the upper end is near it still
    shows its centre: envelopes are timed, not cycles.
    """
    most, width = TOUCHING
    if band.edge > (most if band.width_mhz < width * band.centre_mhz else FOLDED):
        raise InvalidInputError(
            f"the lines have {sampling_mhz:.3g} million samples a second, and their echoes reach "
            f"up to half of that (power there {100.0 * band.edge:.0f} % of the largest): what lies "
            "above is folded back, and the thickness may be off; check the sampling rate in the "
            "file, or record with 4 or more samples in a cycle"
        )


def _edge(power: Floats, f: Floats) -> float:
    """Return the power (f,) next to half the sampling rate over the largest."""
    return float(power[f >= EDGE_SHARE * f[-1]].max() / max(float(power.max()), 1e-300))


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


def noise_rms(envelope: Floats, zero: int = 0, length: float = 0.0) -> Floats:
    """Return the rms (n,) of the noise within the band, of lines with these envelopes (n, samples).

    It is that of the quietest quarter of a line, or of what comes before the front if that is less.

    Args:
        envelope: Of the lines.
        zero: Sample of the fronts; 0: they are not known.
        length: Of the pulse, in samples.
    """
    noise: Floats = np.quantile(envelope, 0.25, axis=1) / RAYLEIGH_QUARTER
    before = zero - round(QUIET_LENGTHS * length)
    if before > ENOUGH_LENGTHS * length:
        early = np.quantile(envelope[:, :before], 0.5, axis=1) / RAYLEIGH_HALF
        noise = np.minimum(noise, early)
    return noise


def check_lines(rf: Floats) -> None:
    """Raise ``InvalidInputError`` unless these are lines (n, samples) of finite numbers."""
    if rf.ndim != 2 or rf.shape[0] < 1 or rf.shape[1] < 64 or not np.isfinite(rf).all():
        raise InvalidInputError(
            f"recorded lines must be finite, (scans, 64 or more samples), not {rf.shape}"
        )


def near_one(rf: Floats) -> Floats:
    """Return lines (n, samples) without their offset, the largest sample of each at 1.

    Lines in which there is hardly anything stay as quiet as they are against the others.
    """
    line = rf - np.median(rf, axis=1)[:, None]
    largest = np.abs(line).max(axis=1)[:, None]
    usual = float(np.median(largest))
    return line / np.maximum(largest, QUIET_LINE * usual if usual > 0 else 1.0)
