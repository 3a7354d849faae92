"""An echo learned from the lines themselves: align many copies, average, align again."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.recorded.band import Band, Complexes

ROUNDS = 4
POINTS_A_CYCLE = 24  # at which a correlation is looked up before the parabola
REFERENCES = 12  # copies compared with each other for a first template
HALF_WIDTH = 1.3  # of the window about an echo, over the length of the pulse
ALIKE = 0.5  # correlation below which a copy does not enter the mean
TINY = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Aligned:
    """Where each copy of an echo lies, and the mean of all copies at that place."""

    at_us: Floats  # (n,) from the first sample of the line, one point of the waveform
    level: Floats  # (n,) amplitude over the mean
    correlation: Floats  # (n,) correlation with the mean, -1 to 1
    spectrum: Complexes  # (f,) of the mean, its time 0 at that point
    frequencies_mhz: Floats  # (f,)


def align_echoes(
    z: Complexes,
    centers: Ints,
    used: Bools,
    sampling_mhz: float,
    band: Band,
    *,
    search_us: float,
    reshape: Complexes | None = None,
) -> Aligned:
    """Return where an echo lies in each line, to a small part of a sample.

    Args:
        z: Analytic lines (n, samples).
        centers: Sample (n,) near which the echo is sought.
        used: Lines (n,) whose echo enters the mean.
        sampling_mhz: Of the lines.
        band: Of the echo.
        search_us: How far from the centre it may lie.
        reshape: Factors (n, f) that make the echoes alike, on ``window_frequencies``.
    """
    start: Ints = np.clip(centers, 0, z.shape[1] - 1).astype(np.int64)
    f = window_frequencies(sampling_mhz, band)
    at = start.astype(np.float64)
    mean = np.zeros(0, dtype=np.complex128)
    reach = search_us * sampling_mhz
    for number in range(ROUNDS):
        whole = np.rint(at).astype(np.int64)
        spectra = _spectra(z, whole, sampling_mhz, band, reshape)
        norms = np.maximum(np.sqrt((np.abs(spectra) ** 2).sum(axis=1)), TINY)
        if number == 0:
            mean = _reference(spectra, used, norms)
        around = (start - whole).astype(np.float64)
        cross = spectra * np.conj(mean)
        shift, peak = _lags(cross, sampling_mhz, band, around - reach, around + reach)
        at = whole + shift
        turned = spectra * np.exp(2j * np.pi * f * shift[:, None] / sampling_mhz)
        power = max(float((np.abs(mean) ** 2).sum()), TINY)
        good = used & (peak > ALIKE * norms * np.sqrt(power))
        good = good if good.any() else used
        weight = good / np.maximum(peak / power, 0.1)
        mean = np.asarray((weight[:, None] * turned).sum(axis=0) / max(weight.sum(), TINY))
    template = Aligned(at / sampling_mhz, at, at, mean, f)
    return locate_echoes(
        z, start, template, sampling_mhz, band, search_us=search_us, reshape=reshape
    )


def locate_echoes(
    z: Complexes,
    centers: Ints,
    template: Aligned,
    sampling_mhz: float,
    band: Band,
    *,
    search_us: float,
    reshape: Complexes | None = None,
) -> Aligned:
    """Return where the mean of others lies in each line; arguments as for ``align_echoes``."""
    start = np.clip(centers, 0, z.shape[1] - 1).astype(np.int64)
    mean, reach = template.spectrum, search_us * sampling_mhz
    power = max(float((np.abs(mean) ** 2).sum()), TINY)
    whole, at = start, start.astype(np.float64)
    peak, norms = np.zeros(len(z)), np.ones(len(z))
    for _ in range(2):  # the second time with the window where the echo is
        whole = np.rint(at).astype(np.int64)
        spectra = _spectra(z, whole, sampling_mhz, band, reshape)
        norms = np.maximum(np.sqrt((np.abs(spectra) ** 2).sum(axis=1)), TINY)
        around = (start - whole).astype(np.float64)
        cross = spectra * np.conj(mean)
        shift, peak = _lags(cross, sampling_mhz, band, around - reach, around + reach)
        at = whole + shift
    correlation: Floats = peak / (norms * float(np.sqrt(power)))
    return Aligned(at / sampling_mhz, peak / power, correlation, mean, template.frequencies_mhz)


def window_frequencies(sampling_mhz: float, band: Band) -> Floats:
    """Return the frequencies (f,) of the windows about an echo, as ``fftfreq`` orders them."""
    half = round(HALF_WIDTH * band.length_us * sampling_mhz) + 1
    size = 1 << int(np.ceil(np.log2(4 * (2 * half + 1))))
    return np.fft.fftfreq(size, 1.0 / sampling_mhz).astype(np.float64)


def _spectra(
    z: Complexes, centers: Ints, sampling_mhz: float, band: Band, reshape: Complexes | None
) -> Complexes:
    """Return the spectra (n, f) of tapered stretches about the centres, these at time 0."""
    half = round(HALF_WIDTH * band.length_us * sampling_mhz) + 1
    offsets = np.arange(-half, half + 1)
    taper = np.cos(0.5 * np.pi * np.abs(offsets) / half)
    index = centers[:, None] + offsets
    inside = (index >= 0) & (index < z.shape[1])
    pieces = np.take_along_axis(z, np.clip(index, 0, z.shape[1] - 1), axis=1) * inside * taper
    size = len(window_frequencies(sampling_mhz, band))
    wrapped = np.zeros((len(z), size), dtype=np.complex128)
    wrapped[:, offsets % size] = pieces
    spectra = np.fft.fft(wrapped, axis=1)
    return spectra if reshape is None else spectra * reshape


def _reference(spectra: Complexes, used: Bools, norms: Floats) -> Complexes:
    """Return the copy that is most like the others at its best shift."""
    rows = np.flatnonzero(used) if used.any() else np.arange(len(spectra))
    rows = rows[np.linspace(0, len(rows) - 1, min(REFERENCES, len(rows))).astype(int)]
    some = spectra[rows] / np.maximum(norms[rows], TINY)[:, None]
    correlations = [
        np.sort(np.fft.ifft(some * np.conj(one), axis=1).real.max(axis=1))[len(rows) // 2]
        for one in some
    ]
    best = rows[int(np.argmax(correlations))]
    return spectra[best] * float(np.median(norms[rows]) / max(norms[best], TINY))


def _lags(
    cross: Complexes, sampling_mhz: float, band: Band, low: Floats, high: Floats
) -> tuple[Floats, Floats]:
    """Return the lag in samples (n,) of the largest correlation between limits, and its value."""
    factor = max(1, int(np.ceil(POINTS_A_CYCLE * band.centre_mhz / sampling_mhz)))
    size = cross.shape[1]
    fine = np.zeros((len(cross), size * factor), dtype=np.complex128)
    half = size // 2
    fine[:, :half] = cross[:, :half]  # analytic: nothing at negative frequencies
    value = np.fft.ifft(fine, axis=1).real * factor * size  # sum over frequencies
    lags = np.fft.fftfreq(size * factor, 1.0 / (size * factor)) / factor
    order = np.argsort(lags, kind="stable")
    value, lags = value[:, order], lags[order]
    inside = (lags >= low[:, None]) & (lags <= high[:, None])
    at = np.argmax(np.where(inside, value, -np.inf), axis=1)
    rows, at = np.arange(len(value)), np.clip(at, 1, len(lags) - 2)
    left, mid, right = value[rows, at - 1], value[rows, at], value[rows, at + 1]
    bend = left - 2.0 * mid + right
    step = np.where(bend < 0, 0.5 * (left - right) / np.where(bend < 0, bend, -1.0), 0.0)
    step = np.clip(step, -0.5, 0.5)
    return lags[at] + step / factor, mid - 0.25 * (left - right) * step
