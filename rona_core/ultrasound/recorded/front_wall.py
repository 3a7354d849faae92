"""The front of a plate in recorded lines: the first strong echo after the transmitter is quiet."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.recorded.band import Band, Complexes, noise_rms
from rona_core.ultrasound.recorded.template_learning import Aligned, align_echoes

FIRST_SHARE = 0.25  # of the strongest echo; the first one above it is the front
LOUD_START = 0.2  # of the strongest echo; a line that begins so loud begins with ring-down
RISE = 3.0  # over the quietest moment so far: something has arrived
QUIET = 0.2  # of what comes later: ring-down that counts no more
QUIET_LENGTHS = 2.5  # of the pulse, for which it has to be quiet
BANG_US = 1.0  # an emission is over this long after its time, but for ring-down
FAINT_SHARE = 0.12  # of the usual front; below it there is no contact
NOISE_FACTOR = 5.0  # a front is this far above the noise
BEGINS_LOUD = 0.5  # of its peak: so much of an echo is missed that begins at the first sample
GAP_LENGTHS = 4.0  # of the pulse, between the arrivals of two scans: not the same wall
FEW = 5  # scans, of which no one is a stray
ALIKE = 0.6  # correlation with the mean front


@dataclass(frozen=True, slots=True, eq=False)
class FrontEchoes:
    """The front echo of each line."""

    aligned: Aligned
    ok: Bools  # (n,)
    cut_off: Bools  # (n,) the record begins within that echo
    quiet_from: Ints  # (n,) sample from which there is no ring-down


def find_recorded_fronts(
    z: Complexes, clipped: Bools, recorded: RecordedRf, band: Band
) -> FrontEchoes:
    """Return the front echo of each line (n, samples) of analytic signals."""
    sampling_mhz = recorded.sampling_mhz
    envelope = np.abs(z)
    length = max(2, round(band.length_us * sampling_mhz))
    smooth = uniform_filter1d(envelope, max(1, length // 2), axis=1)
    quiet = _quiet_from(envelope, smooth, clipped, recorded, length)
    index = np.arange(z.shape[1])
    audible = np.where(index >= quiet[:, None], envelope, 0.0)
    noise = noise_rms(envelope)
    strongest = audible.max(axis=1)
    least = np.maximum(FIRST_SHARE * strongest, np.minimum(NOISE_FACTOR * noise, 0.7 * strongest))
    rows = np.arange(len(z))
    onset = np.argmax(audible >= least[:, None], axis=1)
    first, last = _usual_span(onset, GAP_LENGTHS * length)
    stray = (onset < first) | (onset > last)  # something else comes before the plate, or nothing
    expected = (index >= first - length) & (index <= last + length)
    onset = np.where(stray, np.argmax(np.where(expected, audible, -1.0), axis=1), onset)
    span = (index >= onset[:, None]) & (index <= onset[:, None] + round(1.2 * length))
    center = np.argmax(np.where(span, audible, -1.0), axis=1)
    level = audible[rows, center]
    usual = float(np.median(level))
    ok = (level > NOISE_FACTOR * noise) & (level > FAINT_SHARE * usual)
    aligned = align_echoes(
        z,
        center,
        ok,
        sampling_mhz,
        band,
        search_us=min(0.8 * band.length_us, 1.5 / band.centre_mhz),
    )
    ok = ok & (aligned.correlation > ALIKE) & (aligned.level > FAINT_SHARE)
    # an echo that is loud at the first sample, and over soon, began before
    begins = envelope[:, : max(1, length // 4)].max(axis=1) > BEGINS_LOUD * level
    cut_off = ok & begins & (quiet == 0) & (aligned.at_us < band.length_us)
    return FrontEchoes(aligned, ok & ~cut_off, cut_off, quiet)


def _usual_span(onset: Ints, gap: float) -> tuple[int, int]:
    """Return first and last of the onsets (n,) that follow each other without a larger gap.

    Of all, where few do.
    """
    order = np.sort(onset)
    runs = np.split(order, np.flatnonzero(np.diff(order) > gap) + 1)
    most = max(runs, key=len)
    most = most if 3 * len(most) > len(order) and len(order) >= FEW else order
    return int(most[0]), int(most[-1])


def _quiet_from(
    envelope: Floats,
    smooth: Floats,
    clipped: Bools,
    recorded: RecordedRf,
    length: int,
) -> Ints:
    """Return the sample (n,) at which the first arrival after the emission rises."""
    sampling_mhz, start_known = recorded.sampling_mhz, recorded.start_known
    n, size = envelope.shape
    nothing = np.zeros(n, dtype=np.int64)
    usual = np.median(envelope, axis=0)
    # the emission, if it is in the record at all, is at time 0; a record that was cut out of a
    # longer one without saying so begins anywhere
    zero = round(-recorded.start_us * sampling_mhz)
    if start_known and zero < -2 * length:
        end = length // 2  # only if it is loud from the first sample on
    elif 0 <= zero < size:
        end = zero + length + round(BANG_US * sampling_mhz)
    else:
        end = length // 2
    # a receiver that is driven to its limit shows nothing in the band before it comes back
    cut = False
    for sample in np.flatnonzero(2 * clipped.sum(axis=0) > n):
        if sample > end + length:
            break
        cut, end = True, max(end, int(sample) + length)
    end = min(end, size)
    bang = float(usual[:end].max())
    later = float(np.median(envelope[:, end:].max(axis=1))) if end < size else 0.0
    if bang < LOUD_START * later and not cut:
        return nothing
    top = np.argmax(envelope[:, :end], axis=1)
    moves = float(np.std(top)) / sampling_mhz
    if not start_known and n >= 5 and moves > 0.1:
        return nothing  # an emission would not move
    over = _ring_down_over(envelope, top, length)
    if over is not None:
        return over
    quietest = np.minimum.accumulate(
        np.where(np.arange(size) >= top[:, None], smooth, np.inf), axis=1
    )
    risen = (smooth > RISE * quietest) & np.isfinite(quietest)
    arrived = np.where(risen, smooth, 0.0)
    strong = arrived > FIRST_SHARE * arrived.max(axis=1)[:, None]
    first = np.argmax(strong, axis=1)
    return np.where(strong.any(axis=1), np.maximum(first - length // 2, 0), 0).astype(np.int64)


def _ring_down_over(envelope: Floats, top: Ints, length: int) -> Ints | None:
    """Return the sample (n,) before which there is but ring-down, None where it does not end.

    Ring-down has beats, so that it may rise again for a while: it is over after a stretch of
    several pulse lengths in which everything was faint against what comes later.
    """
    reach = round(QUIET_LENGTHS * length)
    size = envelope.shape[1]
    later = np.maximum.accumulate(envelope[:, ::-1], axis=1)[:, ::-1]
    recent = maximum_filter1d(envelope, reach, axis=1, origin=(reach - 1) // 2)
    index = np.arange(size)
    quiet = (recent < QUIET * later) & (index >= top[:, None] + reach)
    found = quiet.any(axis=1)
    if 2 * found.sum() < len(envelope):
        return None
    # the same in all scans, for the transmitter is
    over = round(float(np.median(np.argmax(quiet[found], axis=1))))
    return np.full(len(envelope), over, dtype=np.int64)
