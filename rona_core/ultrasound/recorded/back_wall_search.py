"""Search for the back wall among the echoes behind the front wall.

Peaks behind the front are followed from scan to scan (`echo_tracks.py`), echoes of the probe are
told from those of the plate (`probe_reverberations.py`), and one is chosen (`back_wall_choice.py`).
"""

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.recorded.aligned_lines import RfSurvey, least_lag_us
from rona_core.ultrasound.recorded.back_wall_choice import Evidence, choose_back_wall, is_smeared
from rona_core.ultrasound.recorded.back_wall_timing import SEARCH_CYCLES, match_echoes
from rona_core.ultrasound.recorded.band import Complexes, filtered, inverse_filter
from rona_core.ultrasound.recorded.clipping import fronts_are_cut
from rona_core.ultrasound.recorded.echo_tracks import (
    Peaks,
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
)
from rona_core.ultrasound.recorded.template_learning import align_echoes


def find_back_wall(survey: RfSurvey, pulse_delay_us: float) -> Track | None:
    """Return the echo of the back wall, or None.

    Args:
        survey: Lines aligned to their fronts.
        pulse_delay_us: From the begin of a pulse to the point at which it is timed.
    """
    recorded, front, band = survey.recorded, survey.front, survey.band
    if not front.ok.any():
        return None
    # a record that begins with ring-down begins with the emission
    timed = recorded.start_known or bool((front.quiet_from > 0).any())
    fronts = FrontArrivals(
        time_us=recorded.start_us + front.aligned.at_us,
        ok=front.ok,
        emission_known=timed,
        band=band,
        positions_mm=recorded.positions_mm,
        pulse_delay_us=pulse_delay_us,
        cut=fronts_are_cut(survey),
    )
    peaks = _peaks_behind_front(survey)
    place = recorded.positions_mm
    tree, near = neighbour_tree(front.ok, place), neighbours(len(survey.lines), place)
    followed = follow(peaks, tree, band, front.ok)
    tracks = [mended(track, peaks, near, place, band) for track in followed]
    foreign = [is_reverberation(track, fronts) for track in tracks]
    evidence = Evidence(
        timed,
        again=lambda track: timed and repeats_standoff(track, fronts),
        loss_np=lambda track: _loss_np(survey, track),
        cut=fronts.cut,
    )
    best = choose_back_wall(tracks, foreign, evidence, band, near, place)
    return None if best is None or is_smeared(tracks[best], band) else tracks[best]


def _peaks_behind_front(survey: RfSurvey) -> Peaks:
    rate, zero = survey.sampling_mhz, survey.zero
    last = survey.recorded.rf.shape[1] - survey.front.aligned.at_us * rate + zero
    ends = np.minimum(np.floor(last).astype(np.int64), survey.lines.shape[1])
    lines = _compress_like_front(survey)
    return find_peaks(lines, 1.0 / rate, zero, survey.band, least_lag_us(survey), ends)


def _loss_np(survey: RfSurvey, track: Track) -> float:
    """Return the loss at mid-band that the spectrum of an echo shows against the front."""
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
