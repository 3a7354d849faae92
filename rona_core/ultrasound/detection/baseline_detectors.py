"""Baseline detectors, those of the original system: threshold, and largest matched-filter peak.

Both work on the envelope of one A-scan, with what any such system has: a compressed chirp with low
side lobes, a gain that makes up for the loss in bone, and a threshold that falls with time as the
echo of a reference block does, so that the front echo is not taken for an inner one. They know
nothing of neighbours, of polarity or of the layers in the bone.
"""

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.candidates import Echoes
from rona_core.ultrasound.detection.single.inner_echo import InnerEchoes, bone_gate_us
from rona_core.ultrasound.detection.single.matched_filter import Template, peak_offsets
from rona_core.ultrasound.probe.materials import TABLE, Material

INNER_SNR = 4.0  # below it there is no inner echo
OVER_BLOCK = 3.0  # an inner echo exceeds what a block's echo of that front leaves, by 10 dB
EDGE_LEVEL = 0.5  # of the peak, crossed by its rising edge
LONGEST_RISE = 1.6  # over that of a block's echo; a longer rise is another echo's tail
SIGMA_MM = 0.3  # what to call the sigma of methods that do not know theirs


def find_largest_echoes(
    echoes: Echoes, bone: Material, method: Literal["threshold", "matched"]
) -> InnerEchoes:
    """Return the largest echo behind the front echo of each A-scan, gain for depth applied.

    "matched" times it by the peak of the envelope, "threshold" by the rising edge at half of it,
    less what both lag behind on a reference block. Its confidence is by how much it exceeds the
    runner-up.

    Args:
        echoes: Spectra with the front echo at time 0, and the template of the probe.
        bone: Nominal bone, for the range of thickness and the gain.
        method: How the time is read off the echo.
    """
    template = _filter_of(echoes.template, method)
    step = template.step_us
    first, last = (round(t / step) for t in bone_gate_us(template.probe, bone))
    block: Floats = np.abs(template.compress(template.spectrum[None, :], template.spectrum))[0]
    envelope: Floats = np.abs(template.compress(echoes.aligned, template.spectrum))
    level = envelope[:, first : last + 1]
    rms = echoes.noise * template.noise_gain(template.spectrum)
    left = np.maximum.accumulate(block[last::-1])[::-1][first:]  # of a block's echo, from then on
    threshold = np.maximum(
        OVER_BLOCK * np.multiply.outer(envelope[:, 0], left), INNER_SNR * rms[:, None]
    )
    peaks = np.zeros(level.shape, dtype=np.bool_)
    middle = level[:, 1:-1]
    peaks[:, 1:-1] = (middle > level[:, :-2]) & (middle >= level[:, 2:])
    over = np.where(peaks, level / np.maximum(threshold, 1e-12), 0.0)
    detected = np.asarray((over > 1.0).any(axis=1))
    gained = level * _gain(bone, template, first + np.arange(level.shape[1]))
    score = np.where(detected[:, None], np.where(over > 1.0, gained, 0.0), over)
    order = np.argsort(score, axis=1)
    rows, at = np.arange(len(level)), order[:, -1]
    samples = at + peak_offsets(level, at)
    if method == "threshold":
        samples = _edge_times(level, at, samples, template)
    other = score[rows, order[:, -2]] / np.maximum(score[rows, at], 1e-12)
    return InnerEchoes(
        lag_us=(first + samples) * step,
        confidence=1.0 - other,
        detected=detected,
        sigma_us=np.full(len(level), 2.0 * SIGMA_MM / bone.speed_mm_per_us),
        slip_chance=np.zeros(len(level)),  # a peak of the envelope has no cycles
        alternative_us=(first + order[:, -2].astype(np.float64)) * step,
        alternative_confidence=other,
    )


def _filter_of(template: Template, method: Literal["threshold", "matched"]) -> Template:
    """Return the template to compress with: for the threshold a pulse is left as it is."""
    if method == "matched" or template.excitation == "chirp":
        return template
    # the trace in the band of the probe: only the delay of a pulse is taken out, not its shape
    return replace(template, weights=1.0 / np.maximum(np.abs(template.spectrum), 1e-3))


def _gain(bone: Material, template: Template, samples: NDArray[np.int64]) -> Floats:
    """Return the gain (n,) that makes up for the loss there and back until ``samples`` (n,).

    The loss is that of an outer table: with that of the diploe too, an echo that went through the
    bone twice could be raised above that which went once.
    """
    depth_cm = bone.speed_mm_per_us * samples * template.step_us / 10.0
    loss_db = TABLE.attenuation_db_per_cm * template.probe.centre_mhz * depth_cm
    return np.asarray(10.0 ** (loss_db / 20.0), dtype=np.float64)


def _edge_times(level: Floats, at: NDArray[np.int64], peaks: Floats, template: Template) -> Floats:
    """Return times (n,) in samples by rising edges, by peaks where an edge is not that echo's."""
    rise = _rise_of_block(template)
    edges = rising_edges(level, at)
    return np.where(peaks - edges > LONGEST_RISE * rise, peaks, edges + rise)


def rising_edges(level: Floats, at: NDArray[np.int64]) -> Floats:
    """Return where rows (n, m) last crossed half of their peaks ``at`` (n,); 0 if they did not."""
    rows = np.arange(len(level))
    half = EDGE_LEVEL * level[rows, at]
    index = np.arange(level.shape[1])
    below = (level < half[:, None]) & (index[None, :] < at[:, None])
    last = np.where(below.any(axis=1), below.shape[1] - 1 - np.argmax(below[:, ::-1], axis=1), 0)
    after = np.minimum(last + 1, level.shape[1] - 1)
    low, high = level[rows, last], level[rows, after]
    rise = np.maximum(high - low, 1e-12)
    return last + np.clip((half - low) / rise, 0.0, 1.0)


def _rise_of_block(template: Template) -> float:
    """Return by how many samples the edge of a block's echo comes before its nominal time."""
    half = int(8.0 / template.step_us)
    echo = template.compress(template.spectrum[None, :], template.spectrum)
    level = np.abs(np.roll(echo, half, axis=1))[:, : 2 * half]
    return half - float(rising_edges(level, np.argmax(level, axis=1))[0])
