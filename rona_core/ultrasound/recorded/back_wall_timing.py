"""Coherent timing of the back-wall echo against a template learned from all scans.

Attenuation and polarity make it unlike the front; what remains alike decides how far apart the two
are: the delay at which the mean front, damped and perhaps turned over, is most like the mean back.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.robust import mad_sigma
from rona_core.ultrasound.recorded.aligned_lines import (
    RfSurvey,
    are_most_cut,
    cut_fronts,
    fronts_are_cut,
    half_cycles_off,
    samples_lost,
)
from rona_core.ultrasound.recorded.band import Band, Complexes, noise_rms
from rona_core.ultrasound.recorded.echo_tracks import Track, neighbours, predicted
from rona_core.ultrasound.recorded.template_learning import Aligned, align_echoes, locate_echoes

ALIKE = 0.5  # correlation with the mean back echo, below which a scan is unsure
LEAST_SNR = 3.0
SMOOTH_CYCLES = 0.35  # a coarse lag that scatters less about its neighbours is replaced by theirs
SEARCH_CYCLES = 0.6
OFF_COST = 0.05  # correlation that a scan off its neighbours by a cycle must have more
LOSSES = np.linspace(0.0, 3.0, 61)  # Np per MHz tried for the way through the plate
MOST_TURN = 0.5 * np.pi  # of the phase, from a piston's near field to its far field
TURN_COST = 0.005  # correlation that the whole of it must bring
BEYOND = 0.5  # of the range of lags that were followed
MOST_GAIN = 5.0  # by which a loss is taken back
MAX_RESHAPE_NP = 0.7
END_LENGTHS = 2.0  # of the pulse: so far before the end of a line an echo may belong to one
ENDS_LOUD = 0.35  # that is cut off there, and is as loud as this share of it
ENDS_LOUDER = 2.0  # or, farther from the end, times as loud


@dataclass(frozen=True, slots=True, eq=False)
class BackEchoes:
    """The back wall in each line (n,)."""

    lag_us: Floats
    correlation: Floats  # with the mean back echo
    sigma_us: Floats
    detected: Bools
    confident: Bools
    level: float  # over the front, typical
    inverted: bool
    cut_off: Bools  # the record ends within an echo
    alike: float  # correlation of the mean back echo with the mean front, its loss allowed for


@dataclass(frozen=True, slots=True)
class Match:
    """How the mean back echo follows from the mean front."""

    delay_us: float  # of the back's point of time against the front's
    loss_np_per_mhz: float
    inverted: bool
    correlation: float
    worth: float  # correlation less the price of a turned phase


def time_back_wall(survey: RfSurvey, track: Track) -> BackEchoes:
    """Return the time from front to back wall in each line.

    Args:
        survey: Lines aligned to their fronts.
        track: The coarse lag of the back wall.
    """
    front, band, rate = survey.front, survey.band, survey.sampling_mhz
    used = track.present & front.ok
    near = neighbours(len(survey.lines), survey.positions_mm)
    lag = _coarse(track, used, near, survey.positions_mm, band)
    centers = _centers(survey, lag)
    search_us = SEARCH_CYCLES / band.centre_mhz
    aligned = align_echoes(survey.lines, centers, used, rate, band, search_us=search_us)
    middle = float(np.median(lag[used]))
    # what was restored of a pulse does not tell a turned phase from a moved envelope
    most_turn = 0.0 if fronts_are_cut(survey) else MOST_TURN
    match = match_echoes(front.aligned, aligned, band, most_turn)
    loss_rate = match.loss_np_per_mhz / middle
    reshape = _reshape(loss_rate * (lag - middle), aligned.frequencies_mhz, band)
    aligned = align_echoes(
        survey.lines, centers, used, rate, band, search_us=search_us, reshape=reshape
    )
    aligned = _settled(survey, aligned, lag, used, near, reshape)
    match = match_echoes(front.aligned, aligned, band, most_turn)
    match = _with_whole_front(match, survey, aligned, used)
    found = aligned.at_us - survey.zero / rate + match.delay_us
    noise = noise_rms(np.abs(survey.lines), survey.zero, band.length_us * rate)
    noise = np.maximum(noise, 1e-9)
    peak = np.abs(np.fft.ifft(aligned.spectrum)).max() * aligned.level
    snr = peak / noise
    inside = centers < survey.lines.shape[1] - round(0.5 * band.length_us * rate)
    detected = front.ok & inside & (snr > LEAST_SNR)
    confident = detected & (aligned.correlation > ALIKE)
    confident &= used | (aligned.correlation > 0.75)
    # where the echo was not followed to, neighbours may have pointed anywhere
    low, high = np.quantile(lag[used], (0.02, 0.98))
    reach = max(band.length_us, BEYOND * (high - low))
    confident &= used | ((found > low - reach) & (found < high + reach))
    cut_off = detected & _ends_in_echo(survey, centers)
    # bound of a coherent estimate: bandwidth times time is about 1, both echoes have noise
    sigma = np.hypot(1.0 / np.maximum(snr, 1.0), noise) / (2.0 * np.pi * band.centre_mhz)
    return BackEchoes(
        found,
        aligned.correlation,
        sigma,
        detected,
        confident,
        track.typical_level,
        match.inverted,
        cut_off,
        match.correlation,
    )


def _ends_in_echo(survey: RfSurvey, centers: Ints) -> Bools:
    """Return which lines (n,) end while an echo is under way that may be the back wall's.

    Near ``centers`` it is what is left of the same echo; elsewhere one that is louder.
    """
    rate, zero, length = survey.sampling_mhz, survey.zero, survey.band.length_us
    envelope = np.abs(survey.lines)
    index = np.arange(envelope.shape[1])
    last = survey.recorded.rf.shape[1] - 1 - survey.front.aligned.at_us * rate + zero
    ending = (index > last[:, None] - 0.5 * length * rate) & (index <= last[:, None])
    near = np.abs(index - centers[:, None]) <= 0.5 * length * rate
    at_end = np.where(ending, envelope, 0.0).max(axis=1)
    loudest = np.where(near, envelope, 0.0).max(axis=1)
    close = last - centers < END_LENGTHS * length * rate
    return at_end > np.where(close, ENDS_LOUD, ENDS_LOUDER) * loudest


def _centers(survey: RfSurvey, lag_us: Floats) -> Ints:
    """Return the samples (n,) of the aligned lines at lags (n,) behind the front."""
    return np.rint(survey.zero + lag_us * survey.sampling_mhz).astype(np.int64)


def _with_whole_front(match: Match, survey: RfSurvey, aligned: Aligned, used: Bools) -> Match:
    """Return the match corrected by half cycles, where the fronts were cut off and restored.

    An echo that was cut off as much does not tell what the front was before.
    """
    front, band, rate = survey.front, survey.band, survey.sampling_mhz
    cut = cut_fronts(survey)
    if not are_most_cut(cut, front.ok):
        return match
    back_us = front.aligned.at_us + aligned.at_us - survey.zero / rate
    more = samples_lost(survey, back_us) >= samples_lost(survey, front.aligned.at_us)
    if are_most_cut(more & cut & used, cut & used):
        return match
    whole = np.where(
        aligned.frequencies_mhz > 0,
        aligned.spectrum * _undamped(match.loss_np_per_mhz, aligned.frequencies_mhz, band),
        0.0,
    ) * np.exp(2j * np.pi * aligned.frequencies_mhz * match.delay_us)
    halves = half_cycles_off(survey, cut, -whole if match.inverted else whole)
    return replace(
        match,
        delay_us=match.delay_us + 0.5 * halves / band.centre_mhz,
        inverted=match.inverted != bool(halves % 2),
    )


def match_echoes(front: Aligned, back: Aligned, band: Band, most_turn: float) -> Match:
    """Return delay, loss and sign that make the mean front most like the mean back echo.

    Loss grows with frequency and has its Kramers-Kronig dispersion, 0 in mid-band. The field of a
    probe spreads between front and back wall, which advances the phase by up to a quarter turn.
    """
    f = front.frequencies_mhz
    half = f > 0
    fine = 16
    size = len(f) * fine
    step = 1.0 / (float(f[1]) * size)
    reach = int(0.8 / band.centre_mhz / step)
    lags = np.arange(-reach, reach + 1)
    best = Match(0.0, 0.0, True, -1.0, -1.0)
    norm_back = np.sqrt((np.abs(back.spectrum[half]) ** 2).sum())
    for loss in LOSSES:
        model = np.where(half, front.spectrum * damping(loss, f, band), 0.0)
        cross = np.zeros(size, dtype=np.complex128)
        cross[: len(f) // 2] = (back.spectrum * np.conj(model))[: len(f) // 2]
        value = (np.fft.ifft(cross) * size)[lags]
        value = value / (norm_back * np.sqrt((np.abs(model) ** 2).sum()) + 1e-12)
        for sign in (-1.0, 1.0):
            turn = np.clip(np.angle(sign * value), 0.0, most_turn)
            fit = (sign * value * np.exp(-1j * turn)).real
            worth = fit - TURN_COST * turn / MOST_TURN
            at = int(np.argmax(worth))
            if worth[at] > best.worth:
                best = Match(
                    float(lags[at] * step), float(loss), sign < 0, float(fit[at]), float(worth[at])
                )
    return best


def damping(loss_np_per_mhz: Floats | float, f: Floats, band: Band) -> Complexes:
    """Return what a loss in proportion to frequency does to a spectrum (..., f)."""
    safe = np.where(f > 0, f, band.centre_mhz)
    turn = 2.0 * safe / np.pi * np.log(safe / band.centre_mhz)
    # level at mid-band stays
    return np.exp(np.asarray(loss_np_per_mhz)[..., None] * (-(safe - band.centre_mhz) + 1j * turn))


def _undamped(loss_np_per_mhz: float, f: Floats, band: Band) -> Complexes:
    """Return what takes a loss back, within reason."""
    gain = damping(-loss_np_per_mhz, f, band)
    size = np.abs(gain)
    return gain * np.minimum(size, MOST_GAIN) / size


def _reshape(loss_np_per_mhz: Floats, f: Floats, band: Band) -> Complexes:
    """Return factors (n, f) that give every back echo the loss of the typical one."""
    limit = MAX_RESHAPE_NP / band.width_mhz
    return damping(-np.clip(loss_np_per_mhz, -limit, limit), f, band)


def _around(lag_us: Floats, used: Bools, near: Ints, positions_mm: Floats | None) -> Floats:
    """Return the lags (n,) that neighbours predict; where none do, the scan's own or the usual."""
    around = predicted(lag_us, used, near, positions_mm)
    measured = np.where(used, lag_us, np.median(lag_us[used]) if used.any() else 0.0)
    return np.where(np.isfinite(around), around, measured)


def _settled(
    survey: RfSurvey, aligned: Aligned, lag_us: Floats, used: Bools, near: Ints, reshape: Complexes
) -> Aligned:
    """Return the echoes at the cycle that fits both the template and the neighbours best."""
    lines, band, rate = survey.lines, survey.band, survey.sampling_mhz
    cycle = 1.0 / band.centre_mhz
    fine = aligned.at_us - survey.zero / rate
    around = _around(fine, used & (aligned.correlation > ALIKE), near, survey.positions_mm)
    best, worth = fine.copy(), _worth(aligned.correlation, fine - around, cycle)
    for guess in (lag_us, around, fine + cycle, fine - cycle):
        other = locate_echoes(
            lines,
            _centers(survey, guess),
            aligned,
            rate,
            band,
            search_us=SEARCH_CYCLES * cycle,
            reshape=reshape,
        )
        other_us = other.at_us - survey.zero / rate
        other_worth = _worth(other.correlation, other_us - around, cycle)
        best = np.where(other_worth > worth, other_us, best)
        worth = np.maximum(worth, other_worth)
    return locate_echoes(
        lines, _centers(survey, best), aligned, rate, band, search_us=0.3 * cycle, reshape=reshape
    )


def _worth(correlation: Floats, off_us: Floats, cycle_us: float) -> Floats:
    return correlation - OFF_COST * np.minimum((off_us / cycle_us) ** 2, 4.0)


def _coarse(
    track: Track, used: Bools, near: Ints, positions_mm: Floats | None, band: Band
) -> Floats:
    """Return lags (n,) to start from: those of the neighbours where these agree."""
    around = _around(track.lag_us, used, near, positions_mm)
    off = np.abs(track.lag_us - around)
    scatter = mad_sigma(off[used])
    if scatter < SMOOTH_CYCLES / band.centre_mhz and near.shape[1] >= 3:
        far = off > max(3.0 * scatter, 0.5 / band.centre_mhz)
        return np.where(used & ~far, track.lag_us, around)
    return np.where(used, track.lag_us, around)
