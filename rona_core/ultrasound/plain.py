"""The detectors of the original system: a threshold, and the largest peak of a matched filter.

Both ignore that the front echo goes on behind its peak; they stay selectable to show what that
costs, and they need no model of the bone.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from rona_core.arrays import Floats
from rona_core.ultrasound.inner import InnerChoice
from rona_core.ultrasound.matched import Template, peak_offsets
from rona_core.ultrasound.material import Complexes

BLANKING = 1.2  # over the -6 dB bandwidth: no inner echo is sought before
INNER_SNR = 4.0  # below it there is no inner echo
THRESHOLD = 0.5  # of the peak, crossed by its rising edge


def _unequalised(template: Template, method: Literal["threshold", "matched"]) -> Template:
    """Return a template that compresses without equalising."""
    ones = np.ones_like(template.weights)
    if method == "matched" or template.excitation == "chirp":
        return replace(template, weights=ones)
    # the filtered trace itself: only the delay of a pulse is taken out, not its shape
    return replace(template, weights=ones / np.maximum(np.abs(template.spectrum), 1e-3))


def find_plain_inner(
    aligned: Complexes,
    noise: Floats,
    template: Template,
    method: Literal["threshold", "matched"],
    gate_us: tuple[float, float],
    sigma_us: float = 0.2,
) -> InnerChoice:
    """Return the largest peak behind the blanked front echo, or the rising edge of it.

    Its sureness is only by how much the peak exceeds the runner-up.

    Args:
        aligned: Spectra (n, f) with the front echo at time 0.
        noise: RMS of the noise in each trace sample, shape (n,).
        template: Of the probe and excitation.
        method: How the time is read off the peak.
        gate_us: Earliest and latest time after the front.
        sigma_us: What to call the sigma of the time, for these methods do not know it.
    """
    template, step = _unequalised(template, method), template.step_us
    blank = BLANKING / (template.probe.bandwidth * template.probe.centre_mhz)
    first, last = int(max(gate_us[0], blank) / step), int(np.ceil(gate_us[1] / step))
    level = np.abs(template.compress(aligned, template.spectrum)[:, first : last + 1])
    peaks = np.zeros_like(level)
    middle = level[:, 1:-1]
    is_peak = (middle > level[:, :-2]) & (middle >= level[:, 2:])
    peaks[:, 1:-1] = np.where(is_peak, middle, 0.0)
    order = np.argsort(peaks, axis=1)
    rows, at = np.arange(len(level)), order[:, -1]
    top, second = peaks[rows, at], peaks[rows, order[:, -2]]
    if method == "matched":
        samples = at + peak_offsets(level, at)
    else:
        samples = rising_edges(level, at) + _edge_before_peak(template)
    rms = np.maximum(noise * template.noise_gain(template.spectrum), 1e-12)
    margin = 1.0 - second / np.maximum(top, 1e-12)
    lag = (first + samples) * step
    runner_up = (first + order[:, -2].astype(np.float64)) * step
    sigma = np.full(len(lag), sigma_us)
    return InnerChoice(lag, margin, top / rms > INNER_SNR, sigma, runner_up, 1.0 - margin)


def rising_edges(level: Floats, at: np.typing.NDArray[np.int64]) -> Floats:
    """Return where rows (n, m) last crossed the threshold before their peaks ``at`` (n,)."""
    rows = np.arange(len(level))
    threshold = THRESHOLD * level[rows, at]
    index = np.arange(level.shape[1])
    below = (level < threshold[:, None]) & (index[None, :] < at[:, None])
    last = np.where(below.any(axis=1), below.shape[1] - 1 - np.argmax(below[:, ::-1], axis=1), 0)
    after = np.minimum(last + 1, level.shape[1] - 1)
    low, high = level[rows, last], level[rows, after]
    rise = np.maximum(high - low, 1e-12)
    return last + np.clip((threshold - low) / rise, 0.0, 1.0)


def _edge_before_peak(template: Template) -> float:
    """Return by how many samples the edge of a block's echo comes before its nominal time."""
    half = int(8.0 / template.step_us)
    echo = template.compress(template.spectrum[None, :], template.spectrum)
    level = np.abs(np.roll(echo, half, axis=1))[:, : 2 * half]
    return half - float(rising_edges(level, np.argmax(level, axis=1))[0])
