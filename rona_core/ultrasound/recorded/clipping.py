"""Fronts that were cut off: which cycle of the pulse is which.

Zero crossings survive clipping and time a front to nanoseconds, but a restored peak is rounder
than the real one, so that two neighbouring cycles look alike. The limits decide: the mean front,
moved by whole cycles and cut off as the recorder does, must give the recorded line, flanks and all.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.ultrasound.recorded.aligned_lines import RfSurvey
from rona_core.ultrasound.recorded.band import Complexes
from rona_core.ultrasound.recorded.front_wall import FrontEchoes
from rona_core.ultrasound.recorded.template_learning import locate_echoes

REACH = 3.0  # of the comparison about the front, over the pulse length
CYCLES = (0, -1, 1, -2, 2)
KEPT = 0.9  # another cycle must leave less than this share of the misfit
SEARCH_CYCLES = 0.3
HALVES = (0, -1, 1, -2, 2, -3, 3)  # of cycles
GAINS = np.geomspace(1.0, 20.0, 24)  # of the whole front, over the limit that cut it off
FINE = 8
COMPARED = 24  # lines


def settle_clipped(rf: Floats, z: Complexes, survey: RfSurvey) -> FrontEchoes:
    """Return the fronts with those of clipped lines at the cycle that explains the line best.

    Args:
        rf: Lines (n, samples) as they were recorded.
        z: Analytic lines with the clipped samples restored.
        survey: The lines aligned to the fronts so far.
    """
    front, band, rate = survey.front, survey.band, survey.sampling_mhz
    clipped, lines, zero = survey.clipped, survey.lines, survey.zero
    rows = np.flatnonzero(front.ok & clipped.any(axis=1))
    if not len(rows):
        return front
    at = front.aligned.at_us * rate
    reach = round(REACH * band.length_us * rate)
    cycle = rate / band.centre_mhz
    mean = CubicSpline(np.arange(lines.shape[1]), lines[front.ok].mean(axis=0).real)
    moved = at.copy()
    for row in rows:
        index = np.arange(max(0, round(at[row]) - reach), min(rf.shape[1], round(at[row]) + reach))
        line = rf[row] - np.median(rf[row])
        if not clipped[row, index].any():
            continue
        scale = float(np.abs(z[row, index]).max())
        misfits: list[float] = []
        for number in CYCLES:
            place = np.clip(index - at[row] - number * cycle + zero, 0, lines.shape[1] - 1)
            model = np.clip(scale * mean(place), line.min(), line.max())
            misfits.append(float(((line[index] - model) ** 2).sum()))
        best = int(np.argmin(misfits))
        if misfits[best] < KEPT * misfits[0]:
            moved[row] += CYCLES[best] * cycle
    if (moved == at).all():
        return front
    # all again with the one template, so that every front has the same point of time
    centers = np.rint(moved).astype(np.int64)
    search_us = SEARCH_CYCLES / band.centre_mhz
    aligned = locate_echoes(z, centers, front.aligned, rate, band, search_us=search_us)
    return replace(front, aligned=aligned)


def cut_fronts(survey: RfSurvey) -> Bools:
    """Return which lines (n,) have a front that was cut off."""
    return np.asarray(survey.front.ok & (samples_lost(survey, survey.front.aligned.at_us) > 0))


def fronts_are_cut(survey: RfSurvey) -> bool:
    """Return whether most of the fronts were cut off."""
    return are_most_cut(cut_fronts(survey), survey.front.ok)


def samples_lost(survey: RfSurvey, at_us: Floats) -> Ints:
    """Return how many samples (n,) were cut off of echoes at times (n,) from the first sample."""
    index = np.arange(survey.clipped.shape[1]) / survey.sampling_mhz
    near = np.abs(index - at_us[:, None]) < survey.band.length_us
    return (survey.clipped & near).sum(axis=1)


def are_most_cut(cut: Bools, present: Bools) -> bool:
    """Return whether most of the echoes that are present (n,) are among those cut off (n,)."""
    return bool(2 * cut.sum() > present.sum())


def half_cycles_off(survey: RfSurvey, cut: Bools, pulse: Complexes) -> int:
    """Return by how many half cycles a pulse must move (and turn over) to explain the fronts.

    The back wall's echo is whole where the front's was cut off, or lost less at least: with its
    loss taken back, moved, and cut off at the same limits it must give the recorded line.

    Args:
        survey: Lines aligned to the fronts, and as they were recorded.
        cut: Lines (n,) whose front was cut off.
        pulse: Spectrum (f,) of the whole pulse, its time 0 where the fronts were timed.
    """
    rf, band, sampling_mhz = survey.recorded.rf, survey.band, survey.sampling_mhz
    size = len(pulse)
    fine = np.zeros(FINE * size, dtype=np.complex128)
    fine[: size // 2] = pulse[: size // 2]
    wave = np.fft.fftshift(np.fft.ifft(fine).real)
    wave = wave / max(float(np.abs(wave).max()), 1e-12)
    place = (np.arange(len(wave)) - len(wave) // 2) / (FINE * sampling_mhz)
    reach = round(REACH * band.length_us * sampling_mhz)
    rows = np.flatnonzero(cut)
    rows = rows[np.linspace(0, len(rows) - 1, min(COMPARED, len(rows))).astype(int)]
    misfit = np.zeros(len(HALVES))
    for row in rows:
        at = float(survey.front.aligned.at_us[row])
        middle = round(at * sampling_mhz)
        index = np.arange(max(0, middle - reach), min(rf.shape[1], middle + reach))
        line = rf[row] - np.median(rf[row])
        low, high = float(line.min()), float(line.max())
        for number, halves in enumerate(HALVES):
            time = index / sampling_mhz - at + 0.5 * halves / band.centre_mhz
            model = (-1.0) ** halves * np.interp(time, place, wave, 0.0, 0.0)
            scaled = np.clip(max(high, -low) * GAINS[:, None] * model, low, high)
            misfit[number] += float(((line[index] - scaled) ** 2).sum(axis=1).min())
    best = int(np.argmin(misfit))
    return HALVES[best] if misfit[best] < KEPT * misfit[HALVES.index(0)] else 0
