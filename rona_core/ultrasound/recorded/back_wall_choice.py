"""Choice of the back wall of the first plate among the echoes behind the front.

Behind a plate lie its own multiples, a floor or a second plate, and the front seen again by way of
the probe; in front of its back wall lie the last lobes of the pulse, holes and, in bone, layers.
An echo counts by the level that most scans reach at its lag, whatever their order and places: the
echo of a hole is loud in a few scans, that of a wall in most.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.robust import mad_sigma, reweighted_least_squares
from rona_core.ultrasound.recorded.aligned_lines import RfSurvey, is_swept, pulse_delay_us
from rona_core.ultrasound.recorded.band import Band, noise_rms

USUAL = 0.35  # share of the scans that may have less of an echo
SPREAD_LENGTHS = 0.7  # of the pulse, by which a back wall may be off its usual lag in a scan
FAR_LENGTHS = 2.0  # the same, for a scan that has nothing within the above
NEAR_SHARE, FAR_SHARE = 0.3, 0.6  # of the usual level, at least
LEAST_SNR = 4.0
LEAST_LENGTHS = 0.7  # of the pulse, between the peaks of two echoes
RISE = 2.0  # of an echo, over the quietest moment between the front and it
LEAST_SHARE, CUT_SHARE = 0.22, 0.35  # of the loudest echo; the second where fronts were cut off
MORE, STILL = 1.5, 0.05  # times as much, and pulse lengths: holes wander more than walls do
LESS = 0.9  # of its share of scans
PROMINENT = 0.33  # of a peak near a louder one, over the valley between them
MOST_ECHOES = 24
LOBES = ((2.6, 0.22), (4.5, 0.13), (9.0, 0.065))  # reach in pulse lengths, level over the front
LATE, LOST_NP = 4.5, 1.0  # pulse lengths, loss: a lobe so late is a copy of the front
LONE = 6.0, 0.08  # reach in pulse lengths, level of a lobe behind which nothing louder comes
CUT_SHORT = 6.0  # times as high a front may be that was cut off
TWICE = 0.35  # of the pulse length: how well a multiple fits
MIRROR = 30.0  # R / (1 - R^2) of steel in water is 8, and the field spreads
MOVES_US = 0.05  # of the front; less does not show what moves with it
MOVED_BETTER = 1.25  # level of an echo aligned as one of the probe, over that as one of the plate
AT_FRONT_US = 0.25  # how near a multiple between front and probe is to its time
PULSE_DELAY = 1.5  # from the emission to the middle of the pulse, over its length
CONTACT_LEVEL = 0.2  # of the second round trip in a plate, over the first
CONTACT_LOSS = 0.3  # Np on that way in mid-band: water has less, up to 10 MHz and 60 mm
LOSS_LENGTHS = 1.5  # of the pulse, either side of an echo whose spectrum is taken
MOST_AGAIN = 3.0  # times as loud behind an echo of the probe: there are two such ways
FAINT = 0.05
LEAST_US = 1e-4


@dataclass(frozen=True, slots=True)
class Echo:
    """What most scans have behind the front at about one lag."""

    lag_us: float  # between the peaks of the envelopes
    level: float  # over the front
    foreign: bool = False  # has nothing to do with the plate
    again: bool = False  # as late after the front as this is after the emission
    loss_np: float = 0.0  # in mid-band on the way since the front, from the slope of the spectrum
    wander_us: float = 0.0  # robust deviation of the lag from scan to scan
    share: float = 1.0  # of the scans that have a peak near the lag


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """The echo of the back wall through all scans."""

    lag_us: Floats  # (n,) after the front; the usual one where not present
    present: Bools  # (n,)
    level: float  # over the front, usual


def find_back_wall(survey: RfSurvey) -> Track | None:
    """Return the echo of the back wall in lines aligned to their fronts, or None."""
    if not survey.front.ok.any() or is_swept(survey):
        return None
    echoes = find_echoes(survey)
    best = choose_back_wall(echoes, survey.band, cut=survey.cut)
    return None if best is None else _picked(survey, echoes[best])


def choose_back_wall(echoes: list[Echo], band: Band, *, cut: bool = False) -> int | None:
    """Return which echo is the back wall: the first that is loud and explained by nothing else.

    Args:
        echoes: In the order of their lags.
        band: Of the echoes.
        cut: Whether the front was cut off, so that all levels over it are too large.
    """
    contact = _contact(echoes, band, cut)
    if contact is not None:
        return contact
    by_probe = [echo for echo in echoes if echo.foreign]
    own = [k for k, echo in enumerate(echoes) if not echo.foreign]
    own = [k for k in own if not _is_behind(echoes[k], by_probe, [echoes[j] for j in own], band)]
    while own:
        loudest = max((echoes[k] for k in own), key=lambda echo: echo.level)
        loud = [
            k
            for k in own
            if echoes[k].level >= (CUT_SHARE if cut else LEAST_SHARE) * loudest.level
            and (
                echoes[k].lag_us > loudest.lag_us
                or echoes[k].wander_us <= MORE * loudest.wander_us + STILL * band.length_us
            )
            and echoes[k].share >= LESS * loudest.share
        ]
        for k in loud:
            if not _is_lobe(echoes[k], [echoes[j] for j in own if j != k], band, cut):
                return k
        own = [] if cut else [k for k in own if k not in loud]
    return None


def _contact(echoes: list[Echo], band: Band, cut: bool) -> int | None:
    """Return the echo that is the second round trip in a plate under the probe itself.

    Then nothing lies between emission and back wall: what was taken for the front is the back
    wall, and whatever follows comes at multiples of its time. Behind water the second arrival
    from the front is fainter.
    """
    again = [k for k, echo in enumerate(echoes) if echo.again]
    if not again:
        return None
    first = max(again, key=lambda k: echoes[k].level)
    lag, level, late_us = echoes[first].lag_us, echoes[first].level, LATE * band.length_us
    order = [
        echo.lag_us / lag
        for echo in echoes
        if echo.level > FAINT * level
        and not (echo.lag_us < late_us and is_early_and_weak(echo.lag_us, echo.level, band))
        and not is_early_and_weak(echo.lag_us - lag, echo.level / level, band)
    ]
    even = all(abs(k - round(k)) * lag < TWICE * band.length_us * max(round(k), 1) for k in order)
    loss = echoes[first].loss_np
    if cut:  # the third against the second
        third = [e for e in echoes if abs(e.lag_us / lag - 2.0) < 0.1]
        level = max((e.level for e in third), default=0.0) / level
        loss = max((e.loss_np for e in third), default=loss) - loss
    return first if even and (level > CONTACT_LEVEL or loss > CONTACT_LOSS) else None


def _is_behind(echo: Echo, by_probe: list[Echo], own: list[Echo], band: Band) -> bool:
    """Return whether an echo is to one by way of the probe what others are to the front."""
    for main in by_probe:
        after, level = echo.lag_us - main.lag_us, echo.level / main.level
        if is_early_and_weak(after, level, band) or any(
            abs(after - o.lag_us) < TWICE * band.length_us and level < MOST_AGAIN * o.level
            for o in own
            if o.lag_us < echo.lag_us
        ):
            return True
    return False


def _is_lobe(echo: Echo, others: list[Echo], band: Band, cut: bool) -> bool:
    """Return whether an early weak echo is the end of the front's own pulse.

    A louder one is behind it, and nothing at twice its lag, which would speak for a plate: level
    and ratio of multiples tell how strongly that reflects, and there is no better mirror than
    ``MIRROR``.
    """
    over_front = echo.level / (CUT_SHORT if cut else 1.0)
    lossy = echo.lag_us > LATE * band.length_us and echo.loss_np > LOST_NP and not cut
    if lossy or not is_early_and_weak(echo.lag_us, over_front, band):
        return False
    later = [o for o in others if o.level > 0.6 * echo.level and o.lag_us > echo.lag_us]
    lobes = [o.lag_us + echo.lag_us for o in later]
    lobes += [2.0 * o.lag_us for o in later if o.level > 2.0 * echo.level]
    apart = TWICE * band.length_us
    multiple = any(
        0.05 < o.level / echo.level < min(1.1 if cut else 1.0, MIRROR * echo.level)
        and all(abs(o.lag_us - lobe) > apart for lobe in lobes)
        and abs(o.lag_us - 2.0 * echo.lag_us) < apart
        for o in others
    )
    reach, most = LONE
    alone = echo.lag_us < reach * band.length_us and over_front < most
    return (bool(later) or alone) and not multiple


def is_early_and_weak(after_us: float, level: float, band: Band) -> bool:
    """Return whether an echo could be a lobe of one that is before it and has level 1."""
    return after_us > 0 and any(
        after_us < reach * band.length_us and level < most for reach, most in LOBES
    )


def find_echoes(survey: RfSurvey) -> list[Echo]:
    """Return the echoes that most scans share, in the order of their lags."""
    front, band, rate, zero = survey.front, survey.band, survey.sampling_mhz, survey.zero
    length = band.length_us * rate
    envelope = _envelopes(survey)[front.ok]
    peak, first, near = _front_peak(survey), round(length), round(SPREAD_LENGTHS * length)
    moves = _moves(survey) * rate
    echoes: list[Echo] = []
    for at, height in _places(envelope, zero, length):
        again = repeats_standoff(survey, at / rate)
        lag, reached = _loudest(envelope, zero + at, SPREAD_LENGTHS * length, zero + first)
        peaked = (reached > NEAR_SHARE * height) & (np.abs(lag - zero - at) < near)
        usual = float(np.median(lag[peaked])) if peaked.any() else zero + at
        if usual - peak > LEAST_LENGTHS * length:
            foreign = again or _is_moved(envelope, zero + at, moves, length)
            wander_us = mad_sigma(lag[peaked] - usual) / rate if peaked.any() else 0.0
            loss, share = _loss_np(survey, zero + at), float(peaked.mean())
            lag_us = (usual - peak) / rate
            echoes.append(Echo(lag_us, height, foreign, again, loss, wander_us, share))
    return sorted(echoes, key=lambda echo: echo.lag_us)


def _places(envelope: Floats, zero: int, length: float) -> list[tuple[int, float]]:
    """Return where echoes are behind the front, in samples, and their levels."""
    from scipy.signal import find_peaks  # 0.5 s, which only readers of recorded lines wait for

    usual = np.quantile(envelope, USUAL, axis=0)[zero:]
    near = round(SPREAD_LENGTHS * length)
    wide = maximum_filter1d(envelope, 2 * near + 1, axis=1)
    level = np.quantile(wide, USUAL, axis=0)[zero:]
    least = LEAST_SNR * float(np.median(noise_rms(envelope, zero, length)))
    first = round(length)
    # the quietest moment so far, before all that counts as near
    lowest = np.minimum.accumulate(usual)
    before = np.concatenate((np.full(near, lowest[0]), lowest))
    alive = np.where((level < least) | (level < RISE * before[: len(level)]), 0.0, level)
    alive[: first + 1] = 0.0
    middles = uniform_filter1d(alive, 2 * round(0.5 * length) + 1)
    found: list[tuple[int, float]] = []
    while alive.any() and len(found) < MOST_ECHOES:
        at = int(np.argmax(np.where(alive > 0, middles, 0.0)))
        alive[max(0, at - first) : at + first + 1] = 0.0
        if middles[at] >= middles[max(0, at - 2) : at + 3].max():  # no flank of a louder one
            found.append((at, float(level[at])))
    # near a louder one only a peak of its own shows that there is another
    least_here = np.maximum(least, RISE * lowest)
    for at in find_peaks(usual, least_here, prominence=PROMINENT * usual)[0]:
        if at > first and all(abs(int(at) - other) > first for other, _ in found):
            found.append((int(at), float(usual[at])))
    return found


def _front_peak(survey: RfSurvey) -> int:
    """Return the sample at which the envelope of the mean front is largest."""
    reach = round(survey.band.length_us * survey.sampling_mhz)
    mean = np.abs(survey.lines[survey.front.ok].mean(axis=0))
    return survey.zero - reach + int(np.argmax(mean[survey.zero - reach : survey.zero + reach + 1]))


def _loss_np(survey: RfSurvey, middle: int) -> float:
    """Return the loss in mid-band, in proportion to frequency, from the front to a sample."""
    rate, band = survey.sampling_mhz, survey.band
    half = round(LOSS_LENGTHS * band.length_us * rate)
    f: Floats = np.fft.fftfreq(4 * half, 1.0 / rate).astype(np.float64)
    powers: list[Floats] = []
    for at in (survey.zero, middle):
        pieces = survey.lines[survey.front.ok, at - half : at + half]
        spectra = np.fft.fft(pieces * np.hanning(2 * half)[: pieces.shape[1]], 4 * half, axis=1)
        powers.append(np.maximum((np.abs(spectra) ** 2).sum(axis=0), 1e-300))
    front, later = powers
    inside = np.abs(f - band.centre_mhz) < 0.5 * band.width_mhz
    fit = np.polyfit(f[inside], 0.5 * np.log(later / front)[inside], 1, w=np.sqrt(front[inside]))
    return -float(fit[0]) * band.centre_mhz


def _envelopes(survey: RfSurvey) -> Floats:
    """Return the envelopes (n, samples) of the aligned lines, 0 behind the end of the record."""
    last = survey.recorded.rf.shape[1] - survey.front.aligned.at_us * survey.sampling_mhz
    last = last + survey.zero - 0.5 * survey.band.length_us * survey.sampling_mhz
    index = np.arange(survey.lines.shape[1])
    return np.where(index < last[:, None], np.abs(survey.lines), 0.0)


def _moves(survey: RfSurvey) -> Floats:
    """Return how far each front (n,) is off a plane over the positions, in us.

    Beyond that, for a wedge on a tilted plate moves with it too.
    """
    ok = survey.front.ok
    time_us, place = survey.front.aligned.at_us[ok], survey.positions_mm
    place = np.arange(len(ok), dtype=np.float64)[:, None] if place is None else place
    return plane_residuals(time_us, place[ok]) if len(time_us) >= 8 else np.zeros(len(time_us))


def _is_moved(envelope: Floats, at: int, off: Floats, length: float) -> bool:
    """Return whether an echo stands still in the record, or moves twice as far as the front."""
    if mad_sigma(off) < MOVES_US * length:
        return False
    sharp: list[float] = []
    for times in (0.0, -1.0, 1.0, 2.0):
        index = at + np.rint(times * off).astype(int)[:, None]
        index = np.clip(
            index + np.arange(-round(length), round(length) + 1), 0, envelope.shape[1] - 1
        )
        moved = np.take_along_axis(envelope, index, axis=1)
        sharp.append(float(np.quantile(moved, USUAL, axis=0).max()))
    return max(sharp[1:]) > MOVED_BETTER * sharp[0]


def repeats_standoff(survey: RfSurvey, lag_us: float) -> bool:
    """Return whether an echo is as late after the front as this is after the emission.

    Or a small number of times as late: a multiple between probe and front.
    """
    front, recorded, length_us = survey.front, survey.recorded, survey.band.length_us
    if not (recorded.start_known or (front.quiet_from > 0).any()):
        return False  # a record that begins with ring-down begins with the emission
    time_us = recorded.start_us + float(np.median(front.aligned.at_us[front.ok]))
    # what was timed of the front is later than its begin, by less than a pulse
    late = AT_FRONT_US + max(PULSE_DELAY * length_us, pulse_delay_us(survey) + 0.5 * length_us)
    return any(-AT_FRONT_US < time_us - lag_us / times < late for times in range(1, 7))


def plane_residuals(values: Floats, place: Floats) -> Floats:
    """Return the residuals (n,) of a plane of least absolute deviation over places (n, d)."""
    centred = place - place.mean(axis=0)
    design = np.column_stack((np.ones(len(values)), centred / max(np.abs(centred).max(), 1e-12)))
    plane = reweighted_least_squares(
        design, values, lambda off: 1.0 / np.maximum(np.abs(off), LEAST_US), rounds=12
    )
    return np.asarray(values - design @ plane)


def _picked(survey: RfSurvey, echo: Echo) -> Track:
    """Return the loudest moment of each scan near the lag of an echo, where it is loud enough."""
    rate, zero = survey.sampling_mhz, survey.zero
    length = survey.band.length_us * rate
    envelope = _envelopes(survey)
    middle = _front_peak(survey) + round(echo.lag_us * rate)
    lag, near = _loudest(envelope, middle, SPREAD_LENGTHS * length, zero + round(length))
    wide, far = _loudest(envelope, middle, FAR_LENGTHS * length, zero + round(length))
    # at the edge of what is near it is the flank of something farther
    close = (near > NEAR_SHARE * echo.level) & (
        np.abs(lag - middle) < round(SPREAD_LENGTHS * length)
    )
    lag = np.where(close, lag, wide)
    present = survey.front.ok & (close | (far > FAR_SHARE * echo.level))
    lag_us = np.where(present, (lag - zero) / rate, echo.lag_us)
    return Track(lag_us.astype(np.float64), present, echo.level)


def _loudest(envelope: Floats, middle: int, reach: float, first: int) -> tuple[Floats, Floats]:
    """Return place in samples and level (n,) of the largest value about a sample."""
    low, high = max(first, middle - round(reach)), middle + round(reach) + 1
    part = envelope[:, low:high]
    at, rows = np.argmax(part, axis=1), np.arange(len(part))
    left, mid, right = (part[rows, np.clip(at + k, 0, part.shape[1] - 1)] for k in (-1, 0, 1))
    bend = np.minimum(left - 2.0 * mid + right, -1e-12)
    return low + at + np.clip(0.5 * (left - right) / bend, -0.5, 0.5), mid
