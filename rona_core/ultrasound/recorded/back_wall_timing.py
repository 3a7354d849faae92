"""Timing of the back-wall echo: the delay of its envelope behind that of the front.

All scans are aligned to the mean back echo. How far that lies behind the mean front is read from
the envelopes, not the phase: loss, the field of the probe and an amplifier at its limit change the
phase, and a wrong cycle would move all scans alike.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.robust import mad_sigma
from rona_core.ultrasound.recorded.aligned_lines import RfSurvey
from rona_core.ultrasound.recorded.back_wall_choice import Track, repeats_standoff
from rona_core.ultrasound.recorded.band import Band, Complexes, noise_rms
from rona_core.ultrasound.recorded.template_learning import Aligned, align_echoes

ALIKE = 0.6  # correlation with the mean back echo, below which a scan is unsure
LEAST_SNR = 3.0
SEARCH_CYCLES = 0.75
OFF_CYCLES = 0.4  # between a scan's own envelope and its waveform against the mean
LOSSES = np.linspace(0.0, 3.0, 16)  # Np per MHz tried for the way through the plate
REACH_LENGTHS = 1.0  # of the pulse, by which the mean echoes may be off each other
GAINS = np.geomspace(1.0, 30.0, 18)  # of the front over the limit of the amplifier
CLIPPED_BETTER = 0.01  # correlation that a limit of the amplifier must bring
SHAPES_ALIKE = 0.9  # below this correlation only the rise of front and back is compared
RISEN = 0.5  # of the largest value, to which it is
MOST_UNSURE = 0.3  # of the scans with an echo; if more are, all are
STRAYS_LENGTHS, STRAYS_TIMES = 0.5, 4.0  # pulse lengths, robust deviations, off the usual lag
LONGEST = 3.0, 5.0  # of the pulse, before and behind the point at which a front is timed
OTHER_RISE = 2.0  # of another echo, over the valley between
OTHER_SHARE, CUT_SHARE = 0.35, 0.85  # over the echo; pulses that are cut off have many lobes
MOST_GAIN = 5.0  # by which a loss is taken back
END_LENGTHS = 2.0  # of the pulse: so far before the end of a line an echo may belong to one
ENDS_LOUD = 0.35  # that is cut off there, and is as loud as this share of it
ENDS_LOUDER = 2.0  # or, farther from the end, times as loud


@dataclass(frozen=True, slots=True, eq=False)
class BackEchoes:
    """The back wall in each line (n,)."""

    lag_us: Floats
    sigma_us: Floats
    detected: Bools
    confident: Bools
    level: float  # over the front, typical
    inverted: bool
    cut_off: Bools  # the record ends within an echo
    alike: float  # correlation of the envelopes of mean back and mean front, loss allowed for


@dataclass(frozen=True, slots=True)
class Match:
    """How the mean back echo follows from the mean front."""

    delay_us: float  # of the back echo's envelope against the front's
    turn_rad: float  # of its phase
    correlation: float
    gain: float  # of the front over the limit that cut it off; 1 where nothing did
    model_us: float = 0.0  # deviation of the delay over losses and gains that fit nearly as well


def time_back_wall(survey: RfSurvey, track: Track) -> BackEchoes:
    """Return the time from front to back wall in each line.

    Args:
        survey: Lines aligned to their fronts.
        track: The coarse lag of the back wall.
    """
    front, band, rate = survey.front, survey.band, survey.sampling_mhz
    used = track.present & front.ok
    centers = np.rint(survey.zero + track.lag_us * rate).astype(np.int64)
    cycle = 1.0 / band.centre_mhz
    aligned = align_echoes(survey.lines, centers, used, rate, band, search_us=SEARCH_CYCLES * cycle)
    match = match_echoes(*_means(survey, aligned, used), rate, band)
    found = aligned.at_us - survey.zero / rate + match.delay_us
    noise = np.maximum(noise_rms(np.abs(survey.lines), survey.zero, band.length_us * rate), 1e-9)
    peak = np.abs(np.fft.ifft(aligned.spectrum)).max() * aligned.level
    snr = peak / noise
    inside = centers < survey.lines.shape[1] - round(0.5 * band.length_us * rate)
    detected = used & inside & (snr > LEAST_SNR)
    own = aligned.at_us - survey.zero / rate - track.lag_us
    off = np.abs(own - (np.median(own[used]) if used.any() else 0.0))
    confident = detected & (aligned.correlation > ALIKE) & (off < OFF_CYCLES * cycle)
    # what is alone at its lag is another echo
    usual = float(np.median(found[confident])) if confident.any() else 0.0
    scatter = mad_sigma(found[confident], center=usual) if confident.any() else 0.0
    strays = np.abs(found - usual) > max(STRAYS_LENGTHS * band.length_us, STRAYS_TIMES * scatter)
    confident &= ~strays
    unlike = match.correlation < ALIKE and not survey.cut
    if unlike or (detected & ~confident).sum() > MOST_UNSURE * detected.sum():
        confident[:] = False  # the mean is of more than one echo, or of different cycles
    # bandwidth times time is about 1; what a scan is unlike the mean counts as noise does
    unlike = np.sqrt(np.clip(1.0 - aligned.correlation**2, 0.0, 1.0))
    own = np.sqrt(1.0 / np.maximum(snr, 1.0) ** 2 + noise**2 + unlike**2)
    sigma = own / (2.0 * np.pi * band.centre_mhz)
    return BackEchoes(
        found,
        np.hypot(sigma, shared_sigma_us(match, band)),
        detected,
        confident,
        track.level,
        bool(np.cos(match.turn_rad) < 0.0),
        detected & _ends_in_echo(survey, centers),
        match.correlation,
    )


def shared_sigma_us(match: Match, band: Band) -> float:
    """Return the uncertainty (1 SD) of the delay between the mean echoes, which all scans share.

    Envelopes that are unlike (correlation r) leave sqrt(1 - r^2) over their bandwidth, and losses
    that fit nearly as well move the delay. A phase that is neither that of the front nor inverted
    may be delay, up to a quarter cycle. Where the front was cut off, or only the rises are
    compared, the delay may be off by a half cycle either way.
    """
    shape = np.sqrt(max(0.0, 1.0 - match.correlation**2)) / (2.0 * np.pi * band.width_mhz)
    off = abs((match.turn_rad + 0.5 * np.pi) % np.pi - 0.5 * np.pi) / (2.0 * np.pi)
    unlike = match.gain > 1.0 or match.correlation < SHAPES_ALIKE
    cycles = np.hypot(off, 0.5 if unlike else 0.0) / np.sqrt(3.0)  # of even probability
    return float(np.sqrt(shape**2 + match.model_us**2 + (cycles / band.centre_mhz) ** 2))


def _means(survey: RfSurvey, aligned: Aligned, used: Bools) -> tuple[Complexes, Complexes]:
    """Return the mean front and the mean back echo (2, k), at one sample each."""
    rate, length = survey.sampling_mhz, survey.band.length_us
    room = float(np.median(aligned.at_us[used])) - survey.zero / rate
    before = round(min(LONGEST[0] * length, 0.5 * room) * rate)
    after = round(min(LONGEST[1] * length, 0.6 * room) * rate)
    index = np.arange(-before, after + 1)
    ends = np.maximum(np.where(index < 0, before, after), 1)
    taper = np.minimum(1.0, 2.0 * (1.0 - np.abs(index) / ends))
    whole = np.rint(aligned.at_us * rate).astype(np.int64)
    rows = np.flatnonzero(used)
    size = survey.lines.shape[1]
    place = whole[rows, None] + index
    pieces = survey.lines[rows[:, None], place.clip(0, size - 1)] * (place < size)
    f = np.fft.fftfreq(len(index), 1.0 / rate)
    shift = aligned.at_us[rows] - whole[rows] / rate
    turned = np.fft.ifft(
        np.fft.fft(pieces, axis=1) * np.exp(2j * np.pi * f * shift[:, None]), axis=1
    )
    back = np.median(turned.real, axis=0) + 1j * np.median(turned.imag, axis=0)
    front = survey.lines[rows, survey.zero - before : survey.zero + after + 1].mean(axis=0)
    other = CUT_SHARE if survey.cut else OTHER_SHARE
    taper = taper * _alone(np.abs(back), before, round(0.5 * length * rate), other)
    return np.asarray(front * taper), np.asarray(back * taper)


def _alone(envelope: Floats, middle: int, near: int, share: float) -> Floats:
    """Return 1 (k,) about the peak at ``middle``, falling to 0 where something else comes."""
    low = max(0, middle - near)
    peak = low + int(np.argmax(envelope[low : middle + near + 1]))
    index, window = np.arange(len(envelope)) - peak, np.ones(len(envelope))
    for side in (-1, 1):
        part = envelope[peak::side]
        lowest = np.minimum.accumulate(part)
        risen = part > np.maximum(OTHER_RISE * lowest, share * part[0])
        if risen.any():
            end = int(np.argmin(part[: int(np.argmax(risen))]))
            window *= np.clip((end - side * index) / max(near, 1), 0.0, 1.0)
    return window


def match_echoes(front: Complexes, back: Complexes, rate: float, band: Band) -> Match:
    """Return how the mean back echo (k,) is like the mean front (k,), both analytic.

    Loss grows with frequency and has its Kramers-Kronig dispersion, 0 in mid-band. A front at the
    limit of the amplifier is what is left of the back echo, its loss taken back, amplified and cut
    off: the phase is free throughout, so that no delay is a cycle off for it.
    """
    size = 8 * len(front)
    f: Floats = np.fft.fftfreq(size, 1.0 / rate).astype(np.float64)
    fronts, backs = np.fft.fft(front, size), np.fft.fft(back, size)
    reach = round(REACH_LENGTHS * band.length_us * rate)
    passed = np.where(f > 0, 2.0 * band.response(np.abs(f)), 0.0)
    models: list[Match] = []
    for loss in LOSSES:
        damped = fronts * damping(float(loss), f, band)
        models.append(_compared(damped[None], backs[None], reach, GAINS[:1]))
    for loss in LOSSES[::3]:
        undamped = damping(-float(loss), f, band)
        undamped = undamped * np.minimum(1.0, MOST_GAIN / np.maximum(np.abs(undamped), 1e-12))
        wave = np.fft.ifft(backs * undamped).real
        cut = np.clip(GAINS[1:, None] * wave / np.abs(wave).max(), -1.0, 1.0)
        cuts = np.fft.fft(cut, axis=1) * passed
        models.append(_compared(fronts[None], cuts, reach, GAINS[1:]))
    worth = [m.correlation - (CLIPPED_BETTER if m.gain > 1.0 else 0.0) for m in models]
    best = models[int(np.argmax(worth))]
    # models that fit nearly as well say how far the delay is known
    weight = np.exp((np.array(worth) - max(worth)) / CLIPPED_BETTER)
    apart = np.array([m.delay_us - best.delay_us for m in models])
    model_us = float(np.sqrt((weight * apart**2).sum() / weight.sum())) / rate
    delay_us = best.delay_us / rate
    if best.correlation < SHAPES_ALIKE:
        delay_us = (_rise(np.abs(back)) - _rise(np.abs(front))) / rate
    return replace(best, delay_us=delay_us, model_us=model_us)


def _rise(envelope: Floats) -> float:
    """Return the sample at which an envelope (k,) first reaches a share of its largest value."""
    level = RISEN * float(envelope.max())
    at = max(1, int(np.argmax(envelope >= level)))
    low, high = float(envelope[at - 1]), float(envelope[at])
    return at - (high - level) / max(high - low, 1e-12)


def _compared(fronts: Complexes, backs: Complexes, reach: int, gains: Floats) -> Match:
    """Return the best match of spectra (m, f) of fronts and backs, its delay in samples."""
    cross = np.roll(np.fft.ifft(backs * np.conj(fronts), axis=1), reach + 1, axis=1)
    cross = cross[:, : 2 * reach + 3]
    norm = np.sqrt((np.abs(fronts) ** 2).sum(axis=1) * (np.abs(backs) ** 2).sum(axis=1))
    value = np.abs(cross) * fronts.shape[1] / np.maximum(norm, 1e-300)[:, None]
    row, at = np.unravel_index(int(np.argmax(value[:, 1:-1])), value[:, 1:-1].shape)
    left, mid, right = (float(value[row, at + k]) for k in range(3))
    bend = left - 2.0 * mid + right
    step = float(np.clip(0.5 * (left - right) / bend, -0.5, 0.5)) if bend < 0 else 0.0
    turn = float(np.angle(cross[row, at + 1]))
    return Match(int(at) - reach + step, turn, mid, float(gains[row]))


def damping(loss_np_per_mhz: Floats | float, f: Floats, band: Band) -> Complexes:
    """Return what a loss in proportion to frequency does to a spectrum (..., f)."""
    safe = np.where(f > 0, f, band.centre_mhz)
    turn = 2.0 * safe / np.pi * np.log(safe / band.centre_mhz)
    # level at mid-band stays
    return np.exp(loss_np_per_mhz * (-(safe - band.centre_mhz) + 1j * turn))


def _ends_in_echo(survey: RfSurvey, centers: Ints) -> Bools:
    """Return which lines (n,) end while an echo is under way that may be the back wall's.

    Near ``centers`` it is what is left of the same echo; elsewhere one that is louder, unless it
    comes when the front's multiple by way of the probe does.
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
    end = float(np.median(last)) - zero  # where the rise of an echo is seen first
    again = any(repeats_standoff(survey, (end + k * length * rate) / rate) for k in (0.0, 0.5, 1.0))
    return at_end > np.where(close, ENDS_LOUD, 1e9 if again else ENDS_LOUDER) * loudest
