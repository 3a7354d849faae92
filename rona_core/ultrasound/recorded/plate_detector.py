"""Detection of the thickness of a plate in recorded lines of which nothing else is known.

The band, the pulse, where the front is, and what the back wall's echo looks like are all learned
from the lines; only the sound speed must be given.
"""

from dataclasses import dataclass, replace

import numpy as np

from rona_core.devices.files.rf.rf_data import RecordedRf
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.robust import mad_sigma
from rona_core.ultrasound.recorded.aligned_lines import align_fronts
from rona_core.ultrasound.recorded.artefacts import (
    find_clipped,
    find_spikes,
    remove_narrow_band_interference,
    remove_spikes,
)
from rona_core.ultrasound.recorded.back_wall_choice import find_back_wall
from rona_core.ultrasound.recorded.back_wall_timing import BackEchoes, time_back_wall
from rona_core.ultrasound.recorded.band import (
    Band,
    analytic,
    check_lines,
    find_band,
    near_one,
    require_sampled,
)
from rona_core.ultrasound.recorded.front_wall import FrontEchoes, find_recorded_fronts

OK, NO_FRONT, NO_BACK, UNSURE, CUT_OFF = range(5)
SPEEDS_MM_PER_US = (0.5, 10.0)
START_US = 1.0  # after the emission, that a record begins with it
ALIKE = 0.95  # correlation of front and back wall, above which both are echoes
MORE_ALIKE = 0.03
TRIGGER_US = 0.003
FEW = 4  # scans, which do not tell what stands still
LEAST_REST = 0.3  # of a record


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDetection:
    """Front and back of the plate in each recorded line (n,)."""

    front_us: Floats  # after the emission, or after the first sample where that is not known
    lag_us: Floats  # from the front to the back wall and back; 0 where not ok
    thickness_mm: Floats  # 0 where not ok
    ok: Bools
    flag: Ints  # 0 ok, 1 no front, 2 no back wall, 3 unsure, 4 the record begins or ends in an echo
    sigma_mm: Floats  # predicted, what all lines share included; 0 where not ok
    clipped: Bools  # lines with runs of samples at a limit of the converter
    centre_mhz: float
    width_mhz: float  # at -6 dB
    back_level: float  # over the front, typical
    back_inverted: bool  # against the front
    sound_speed_mm_per_us: float

    def __len__(self) -> int:
        return len(self.flag)


def detect_recorded(
    recorded: RecordedRf,
    sound_speed_mm_per_us: float,
    *,
    prior_mhz: float | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RecordedDetection:
    """Return the thickness of the first plate in each line.

    Args:
        recorded: Lines from a file.
        sound_speed_mm_per_us: In the plate; thickness is proportional to it.
        prior_mhz: Nominal frequency of the probe, where it is known.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between steps.

    Raises:
        InvalidInputError: an impossible speed, lines that are none, or too few samples a cycle.
        DegenerateGeometryError: there is no echo in them.
        CancelledError: ``cancel`` said so.
    """
    low, high = SPEEDS_MM_PER_US
    if not low <= sound_speed_mm_per_us <= high:
        raise InvalidInputError(
            f"the sound speed must be {low} to {high} mm/us: {sound_speed_mm_per_us:g}"
        )
    check_lines(recorded.rf)
    recorded = replace(recorded, rf=near_one(recorded.rf))
    found = _found(recorded, prior_mhz, _Steps(progress, cancel))
    begins = recorded.start_known or found.front.quiet_from.any()
    if not begins and found.front.ok.any() and _stands_still(found):
        later = _behind(recorded, found)
        again = found if later is None else _found(later, prior_mhz, _Steps(silent, cancel))
        moves = again.alike > ALIKE and not _stands_still(again)
        if later is not None and (moves or again.alike > found.alike + MORE_ALIKE):
            recorded, found = later, again
    judged = _judged(recorded, found, sound_speed_mm_per_us)
    if judged.ok.any():  # noise reaches up to half the sampling rate, too, but holds no plate
        require_sampled(found.band, recorded.sampling_mhz)
    return judged


@dataclass(frozen=True, slots=True, eq=False)
class _Found:
    front: FrontEchoes
    back: BackEchoes | None
    cut: Bools  # (n,) lines with clipped samples
    band: Band

    @property
    def alike(self) -> float:
        return 0.0 if self.back is None else self.back.alike


def _found(recorded: RecordedRf, prior_mhz: float | None, report: "_Steps") -> _Found:
    rf, rate = recorded.rf, recorded.sampling_mhz
    clipped = find_clipped(rf)
    emitting = recorded.start_known and abs(recorded.start_us) < START_US
    band = find_band(rf, clipped, rate, prior_mhz, emitting)
    report(0.1)
    spikes = find_spikes(rf, clipped, rate, band)
    if spikes.any():
        rf = remove_spikes(rf, spikes)
        band = find_band(rf, clipped, rate, prior_mhz, emitting)
    rf = remove_narrow_band_interference(rf, clipped, rate, band)
    z = analytic(rf, rate, band)
    report(0.3)
    front = find_recorded_fronts(z, clipped, recorded, band)
    report(0.5)
    survey = align_fronts(z, front, recorded, clipped, band)
    track = find_back_wall(survey)
    report(0.7)
    back = None if track is None else time_back_wall(survey, track)
    report(1.0)
    return _Found(front, back, np.asarray(clipped.any(axis=1)), band)


def _stands_still(found: _Found) -> bool:
    """Return whether the front stands still to the trigger's precision, as an emission does."""
    at = found.front.aligned.at_us[found.front.ok]
    return len(at) < FEW or mad_sigma(at, center=float(np.median(at))) < TRIGGER_US


def _behind(recorded: RecordedRf, found: _Found) -> RecordedRf | None:
    """Return what was recorded from the emission on, its time known; None where that is nothing."""
    emitted = float(np.median(found.front.aligned.at_us[found.front.ok]))
    first = max(0, round((emitted + 0.5 * found.band.length_us) * recorded.sampling_mhz))
    rf = recorded.rf[:, first:]
    if rf.shape[1] < LEAST_REST * recorded.rf.shape[1]:
        return None
    start = first / recorded.sampling_mhz - emitted
    return replace(recorded, rf=rf, start_us=start, start_known=True)


class _Steps:
    def __init__(self, progress: Progress, cancel: Cancel) -> None:
        self._progress, self._cancel = progress, cancel

    def __call__(self, share: float) -> None:
        if self._cancel():
            raise CancelledError("the detection of echoes was cancelled")
        self._progress(share)


def _judged(
    recorded: RecordedRf,
    found: _Found,
    speed: float,
) -> RecordedDetection:
    n = len(recorded)
    front, back, band = found.front, found.back, found.band
    nothing, no = np.zeros(n), np.zeros(n, dtype=np.bool_)
    detected = no if back is None else back.detected
    confident = no if back is None else back.confident
    cut_off = front.cut_off | (no if back is None else back.cut_off)
    flag = np.select(
        [cut_off, ~front.ok, ~detected, ~confident], [CUT_OFF, NO_FRONT, NO_BACK, UNSURE], OK
    )
    ok = flag == OK
    lag = nothing if back is None else np.where(ok, back.lag_us, 0.0)
    sigma = nothing if back is None else np.where(ok, back.sigma_us * speed / 2.0, 0.0)
    return RecordedDetection(
        front_us=readonly(recorded.start_us + front.aligned.at_us),
        lag_us=readonly(lag),
        thickness_mm=readonly(lag * speed / 2.0),
        ok=readonly(ok),
        flag=readonly(flag.astype(np.int64)),
        sigma_mm=readonly(sigma),
        clipped=readonly(found.cut),
        centre_mhz=band.centre_mhz,
        width_mhz=band.width_mhz,
        back_level=0.0 if back is None else back.level,
        back_inverted=back is not None and back.inverted,
        sound_speed_mm_per_us=speed,
    )
