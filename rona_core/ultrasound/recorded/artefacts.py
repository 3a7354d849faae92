"""Samples that a recorder lost, at its limits or under spikes: found, and put right.

What stood there follows from the samples around it, for the band allows but one course.
"""

from collections.abc import Iterator

import numpy as np
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.ndimage import maximum_filter1d

from rona_core.geometry.arrays import Bools, Floats
from rona_core.ultrasound.recorded.band import Band, analytic

RAIL = 0.985  # of the extreme value, from which on a flat run counts as clipped
FLAT_RUN = 3  # samples
CONVERTERS = (1, 2)  # that take samples in turn
PILED = 24  # samples at one value,
PILE = 8.0  # times as many as next to it: a limit,
UNLIKE = 0.2  # of it, by which what is beside them differs
MAX_LOST = 400  # clipped samples put right at once
SPIKE = 10.0  # over the usual jump from sample to sample outside the band
SPIKE_OUTSIDE = 0.5  # over what is inside the band
SPIKE_CYCLES = 0.12  # on either side
MOST_SPIKES = 0.1  # of a line; with more of them it is not spikes
BESIDE = 4  # samples next to a gap that are all taken
MOST_KNOWN = 200  # others
NOISE_SHARE = 1e-4  # of the power, so that the restoration stays finite
ECHO_LEVEL = 3.0  # over the usual envelope: an echo, no tone
LEAST_QUIET = 0.3  # of the samples, without echo
TONE_SHARE = 0.3  # of the power between echoes that a tone must have
FINE = 4
TONES = 2


def find_clipped(rf: Floats) -> Bools:
    """Return which samples (n, samples) stand at a limit of the converter.

    Either they come in runs at an extreme value, or, with few samples a cycle, many single ones
    share it and hardly any come near. Two converters that take turns have limits of their own.
    """
    clipped = np.zeros(rf.shape, dtype=np.bool_)
    middle = float(np.median(rf))
    for sign in (1.0, -1.0):
        value = sign * (rf - middle)
        for turns in CONVERTERS:
            tops = np.array([value[:, k::turns].max() for k in range(turns)])
            if (tops <= 0).any():
                continue
            top = tops[np.arange(rf.shape[1]) % turns]
            at, near = value >= top - 1e-9 * np.abs(top), value >= RAIL * top
            # a wave that just fits reaches its extreme in one or two samples
            runs = _in_runs(at, FLAT_RUN)
            if runs.sum() >= 2 * FLAT_RUN or (len(rf) == 1 and runs.any()):
                clipped |= _in_runs(near, 2) & near
            if _is_limit(value, at, near):
                clipped |= at | (_in_runs(near, 2) & near)
    return clipped


def _is_limit(value: Floats, at: Bools, near: Bools) -> bool:
    """Return whether samples (n, samples) ``at`` one extreme value were cut off there.

    A wave whose samples fall anywhere in its cycle has at most 1 / (sqrt(2) - 1) = 2.4 times as
    many at its highest step as one step below. If its samples always fall at the same places, it
    is the same beside them too.
    """
    if at.sum() < PILED or at.all():
        return False
    below = np.count_nonzero((near | (value >= value[~at].max())) & ~at)
    if at.sum() < PILE * below:
        return False
    rows, samples = np.nonzero(at)
    beside = np.stack([value[rows, np.clip(samples + k, 0, at.shape[1] - 1)] for k in (-1, 1)])
    wide = np.ptp(np.quantile(beside, (0.1, 0.9), axis=1), axis=0)
    return bool(wide.max() > UNLIKE * value[at].max())


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


def remove_spikes(rf: Floats, spikes: Bools, sampling_mhz: float, band: Band) -> Floats:
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
    f: Floats = np.fft.rfftfreq(padded, 1.0 / sampling_mhz).astype(np.float64)
    correlation = np.fft.irfft(band.bell(f, 1.15), padded)[:size]
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
