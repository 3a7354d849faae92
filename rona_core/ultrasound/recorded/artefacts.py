"""Artefacts of a recorder: clipped samples known, spikes replaced, interference subtracted."""

import numpy as np
from scipy.ndimage import maximum_filter1d

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.recorded.band import Band, analytic

FLAT_RUN = 3  # samples
CONVERTERS = (1, 2)  # that take samples in turn
SPIKE = 10.0  # over the usual jump from sample to sample outside the band
SPIKE_OUTSIDE = 0.5  # over what is inside the band
SPIKE_CYCLES = 0.12  # on either side
MOST_SPIKES = 0.1  # of a line; with more of them it is not spikes
ECHO_LEVEL = 3.0  # over the usual envelope: an echo, no tone
LEAST_QUIET = 0.3  # of the samples, without echo
TONE_SHARE = 0.3  # of the power between echoes that a tone must have
FINE = 4
TONES = 2


def find_clipped(rf: Floats) -> Bools:
    """Return which samples (n, samples) stand in runs at the extremes of their line.

    A wave that just fits reaches its extreme in one or two samples; with fewer than about 8 samples
    a cycle one that was cut off may, too. Converters that take turns have limits of their own.
    """
    clipped = np.zeros(rf.shape, dtype=np.bool_)
    for turns in CONVERTERS:
        at_limit = np.zeros(rf.shape, dtype=np.bool_)
        for k in range(turns):
            part = rf[:, k::turns]
            top, bottom = part.max(axis=1)[:, None], part.min(axis=1)[:, None]
            at_limit[:, k::turns] = (part >= top) | (part <= bottom)
        clipped |= _in_runs(at_limit, FLAT_RUN + turns - 1)
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


def remove_spikes(rf: Floats, spikes: Bools) -> Floats:
    """Return the lines with disturbed samples put on straight lines between their neighbours."""
    restored = rf.copy()
    index = np.arange(rf.shape[1])
    for row in np.flatnonzero(spikes.any(axis=1) & ~spikes.all(axis=1)):
        lost = spikes[row]
        restored[row, lost] = np.interp(index[lost], index[~lost], rf[row, ~lost])
    return restored


def remove_narrow_band_interference(
    rf: Floats, clipped: Bools, sampling_mhz: float, band: Band
) -> Floats:
    """Subtract narrow-band interference: steady tones in the band, one frequency for all lines."""
    result = rf
    for _ in range(TONES):
        tone = _tone(result, clipped, sampling_mhz, band)
        if tone is None:
            break
        result = result - tone
    return result


def _tone(rf: Floats, clipped: Bools, sampling_mhz: float, band: Band) -> Floats | None:
    """Return the strongest tone between the echoes (n, samples), None where there is none."""
    every = max(1, len(rf) // 100)
    z = analytic(rf[::every], sampling_mhz, band)
    quiet = _quiet(z)
    if quiet.mean() < LEAST_QUIET:
        return None
    between = np.where(quiet, z, 0.0)
    padded = FINE * rf.shape[1]
    power = (np.abs(np.fft.fft(between, padded, axis=1)) ** 2).mean(axis=0)
    at = int(np.argmax(power[: padded // 2]))
    # a tone that fills what is quiet has its power once for each quiet sample
    tone = power[at] / float((quiet.sum(axis=1) ** 2).mean())
    if tone < TONE_SHARE * float((np.abs(between) ** 2).sum() / quiet.sum()):
        return None
    waves = np.exp(2j * np.pi * at / padded * np.arange(rf.shape[1]))
    result = np.zeros_like(rf)
    for start in range(0, len(rf), 64):
        part = slice(start, start + 64)
        z = analytic(rf[part], sampling_mhz, band)
        quiet = _quiet(z) & ~clipped[part]
        height = (z * np.conj(waves) * quiet).sum(axis=1) / np.maximum(quiet.sum(axis=1), 1)
        result[part] = (height[:, None] * waves).real
    return result


def _quiet(z: np.typing.NDArray[np.complex128]) -> Bools:
    envelope = np.abs(z)
    return np.asarray(envelope < ECHO_LEVEL * np.median(envelope, axis=1)[:, None])
