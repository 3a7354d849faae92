"""A matched filter in single precision and nothing more: how fast one can be."""

import numpy as np
from numpy.typing import NDArray

from rona_core.ultrasound.detection.single.matched_filter import Template


def peak_times(template: Template, rf: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the time (n,) of the largest matched-filter envelope in records (n, samples).

    In single precision, to a sample of the baseband, after the start of the record.
    """
    n = 2 ** int(np.ceil(np.log2(2 * rf.shape[1])))
    f = np.arange(n // 2 + 1) * (template.probe.sampling_mhz / n)
    reference = np.interp(f, template.frequencies_mhz, template.spectrum, left=0.0, right=0.0)
    band = np.flatnonzero(reference)
    size = 2 ** int(np.ceil(np.log2(2 * len(band))))
    spectra = np.fft.rfft(rf, n, axis=1)[:, band]
    compressed = np.fft.ifft(spectra * np.conj(reference[band]).astype(np.complex64), size, axis=1)
    power = compressed.real**2 + compressed.imag**2
    step = n / (size * template.probe.sampling_mhz)
    return (np.argmax(power, axis=1) * step).astype(np.float32)
