"""Search for the back wall among the echoes behind the front wall.

Peaks behind the front are followed from scan to scan (`echo_tracks.py`), echoes of the probe are
suppressed (`probe_reverberations.py`), and one of the tracks is chosen (`back_wall_choice.py`).
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.recorded.aligned_lines import RfSurvey, least_lag_us
from rona_core.ultrasound.recorded.back_wall_choice import (
    WANDERS,
    Evidence,
    choose_back_wall,
    is_early_and_weak,
    is_repeated,
    is_smeared,
    may_be_ghost,
    steadiness,
)
from rona_core.ultrasound.recorded.back_wall_timing import SEARCH_CYCLES, match_echoes
from rona_core.ultrasound.recorded.band import Band, Complexes, filtered, inverse_filter
from rona_core.ultrasound.recorded.clipping import fronts_are_cut
from rona_core.ultrasound.recorded.echo_tracks import (
    Track,
    find_peaks,
    follow,
    mended,
    neighbour_tree,
    neighbours,
)
from rona_core.ultrasound.recorded.probe_reverberations import (
    FrontArrivals,
    is_reverberation,
    repeats_standoff,
    robust_sd,
    suppress_reverberations,
)
from rona_core.ultrasound.recorded.template_learning import align_echoes

LOCKED_REACH = 6.0  # over the pulse length
LOCKED = 0.5  # share of the power behind the front that is the same in all scans
SIDE_LOBE = 0.06
MANY = 8  # scans, from which on an average is one


def find_back_wall(survey: RfSurvey, pulse_delay_us: float, compressed: bool) -> Track | None:
    """Return the echo of the back wall, or None.

    Args:
        survey: Lines aligned to their fronts.
        pulse_delay_us: From the begin of a pulse to the point at which it is timed.
        compressed: Whether the pulse was long and compressed, which leaves side lobes.
    """
    front, band = survey.front, survey.band
    if not front.ok.any():
        return None
    search = _TrackSearch(survey, pulse_delay_us)
    lines = _compress_like_front(survey)
    track, certain = search.best_in(lines)
    side_lobe = compressed and track is not None and _is_side_lobe(track, band)
    if front.ok.sum() < MANY or (certain and not side_lobe):
        return track
    # what is the same in all scans may be the end of the front's own pulse
    cleared, _ = search.best_in(_without_locked(lines, survey))
    if cleared is None:
        return track
    if track is None:  # what is left of the pulse's end is no plate
        return None if may_be_ghost(cleared, band) else cleared
    if side_lobe and cleared.typical_level > 0.5 * track.typical_level:
        return cleared
    return cleared if search.is_better(cleared, track) else track


class _TrackSearch:
    """What does not change between searches in differently filtered lines of one survey."""

    def __init__(self, survey: RfSurvey, pulse_delay_us: float) -> None:
        recorded, front = survey.recorded, survey.front
        self._survey = survey
        self._least_us = least_lag_us(survey)
        self._tree = neighbour_tree(front.ok, recorded.positions_mm)
        self._near = neighbours(len(survey.lines), recorded.positions_mm)
        # a record that begins with ring-down begins with the emission
        timed = recorded.start_known or bool((front.quiet_from > 0).any())
        cut = fronts_are_cut(survey)
        self._fronts = FrontArrivals(
            time_us=recorded.start_us + front.aligned.at_us,
            ok=front.ok,
            emission_known=timed,
            band=survey.band,
            positions_mm=recorded.positions_mm,
            pulse_delay_us=pulse_delay_us,
            cut=cut,
        )
        last = recorded.rf.shape[1] - front.aligned.at_us * survey.sampling_mhz + survey.zero
        self._ends = np.minimum(np.floor(last).astype(np.int64), survey.lines.shape[1])
        self._evidence = Evidence(timed, self._again, self._loss_np, cut)

    def best_in(self, compressed: Complexes) -> tuple[Track | None, bool]:
        """Return the back wall in compressed lines, and whether its own multiple confirms it."""
        survey, fronts = self._survey, self._fronts
        band, ok, place = survey.band, survey.front.ok, survey.positions_mm
        step_us = 1.0 / survey.sampling_mhz
        peaks = find_peaks(compressed, step_us, survey.zero, band, self._least_us, self._ends)
        peaks, suppressed = suppress_reverberations(peaks, self._tree, fronts)
        tracks = [
            mended(track, peaks, self._near, place, band)
            for track in follow(peaks, self._tree, band, ok)
        ]
        foreign = [is_reverberation(track, fronts) for track in tracks]
        tracks, foreign = tracks + suppressed, foreign + [True] * len(suppressed)
        best = choose_back_wall(tracks, foreign, self._evidence, band, self._near, place)
        if best is None or is_smeared(tracks[best], band):
            return None, False
        return tracks[best], is_repeated(tracks[best], tracks, band, self._evidence)

    def is_better(self, cleared: Track, track: Track) -> bool:
        """Return whether the search without the locked part shows the back wall better.

        Args:
            cleared: Found behind what all scans have in common.
            track: Found in the lines as they are.
        """
        band, least_us = self._survey.band, self._least_us
        wanders = steadiness(cleared, self._near, self._survey.positions_mm, band)[1]
        same = abs(cleared.typical_us - track.typical_us) < 0.3 * band.length_us
        cleaner = same and cleared.typical_level > 0.8 * track.typical_level
        # a plate as even as that is the same in all scans itself
        cleaner = cleaner and robust_sd(track.lag_us[track.present]) > WANDERS / band.centre_mhz
        lobe = is_early_and_weak(track, band) and cleared.typical_level > 0.5 * track.typical_level
        lobe = lobe and wanders
        # what is left of a front that was cut off is alike in all scans too
        rest = track.typical_us < LOCKED_REACH * band.length_us and least_us > band.length_us
        rest = rest and cleared.typical_level > track.typical_level
        earlier = cleared.typical_us < track.typical_us - band.length_us
        earlier = earlier and cleared.typical_level > 0.5 * track.typical_level
        earlier = earlier and not is_early_and_weak(cleared, band)
        return bool(cleaner or lobe or rest or earlier)

    def _again(self, track: Track) -> bool:
        return self._fronts.emission_known and repeats_standoff(track, self._fronts)

    def _loss_np(self, track: Track) -> float:
        survey = self._survey
        rate, band = survey.sampling_mhz, survey.band
        lag = np.where(track.present, track.lag_us, track.typical_us)
        echo = align_echoes(
            survey.lines,
            np.rint(survey.zero + lag * rate).astype(np.int64),
            track.present & survey.front.ok,
            rate,
            band,
            search_us=SEARCH_CYCLES / band.centre_mhz,
        )
        return match_echoes(survey.front.aligned, echo, band).loss_np_per_mhz * band.centre_mhz


def _is_side_lobe(track: Track, band: Band) -> bool:
    near = track.typical_us < LOCKED_REACH * band.length_us
    return near and track.typical_level < SIDE_LOBE


def _compress_like_front(survey: RfSurvey) -> Complexes:
    """Return lines in which an echo like the front is one short lobe of height 1."""
    lines, rate, band = survey.lines, survey.sampling_mhz, survey.band
    pulse = np.fft.ifft(survey.front.aligned.spectrum)
    half = len(pulse) // 2
    padded = max(lines.shape[1] + 4 * round(band.length_us * rate), half)
    f: Floats = np.fft.fftfreq(padded, 1.0 / rate).astype(np.float64)
    whole = np.zeros(padded, dtype=np.complex128)
    whole[:half] = pulse[:half]
    whole[-half:] += pulse[-half:]
    spectrum = np.fft.fft(whole)
    weight = inverse_filter(spectrum, f, band)
    weight = weight / np.abs(np.fft.ifft(spectrum * weight)).max()
    weight = weight * float(np.abs(pulse).max())  # the lines are over the height of the front
    return filtered(lines, weight)


def _without_locked(compressed: Complexes, survey: RfSurvey) -> Complexes:
    """Return lines without what all have in common shortly behind the front."""
    zero, ok, length = survey.zero, survey.front.ok, survey.band.length_us
    rate = survey.sampling_mhz
    last = min(compressed.shape[1], zero + round(LOCKED_REACH * length * rate))
    part = compressed[ok, zero:last]
    mean = part.mean(axis=0)
    share = np.abs(mean) ** 2 / np.maximum((np.abs(part) ** 2).mean(axis=0), 1e-12)
    # softly, for an edge would be an echo
    soft = np.clip((share - LOCKED) / (1.0 - LOCKED), 0.0, 1.0) ** 0.5
    end = np.clip((last - zero - np.arange(last - zero)) / (length * rate), 0, 1)
    result = compressed.copy()
    result[:, zero:last] -= mean * soft * end
    return result
