"""Fronts that were cut off: which cycle of the pulse is which.

Zero crossings survive clipping and time a front to nanoseconds, but a restored peak is rounder
than the real one, so that two neighbouring cycles look alike. The limits decide: the mean front,
moved by whole cycles and cut off as the recorder does, must give the recorded line, flanks and all.
"""

from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.arrays import Bools, Floats
from rona_core.ultrasound.learned_pulse import locate_echoes
from rona_core.ultrasound.recorded_front import FrontEchoes
from rona_core.ultrasound.recorded_signal import Band, Complexes

REACH = 3.0  # of the comparison about the front, over the pulse length
CYCLES = (0, -1, 1, -2, 2)
KEPT = 0.9  # another cycle must leave less than this share of the misfit
SEARCH_CYCLES = 0.3


def settle_clipped(
    rf: Floats,
    clipped: Bools,
    z: Complexes,
    front: FrontEchoes,
    lines: Complexes,
    zero: int,
    sampling_mhz: float,
    band: Band,
) -> FrontEchoes:
    """Return the fronts with those of clipped lines at the cycle that explains the line best.

    Args:
        rf: Lines (n, samples) as they were recorded.
        clipped: Samples (n, samples) at a limit of the converter.
        z: Analytic lines with the clipped samples restored.
        front: The fronts so far.
        lines: Analytic lines with every front at sample ``zero``, height 1.
        zero: That sample.
        sampling_mhz: Of the lines.
        band: Of the echoes.
    """
    rows = np.flatnonzero(front.ok & clipped.any(axis=1))
    at = front.aligned.at_us * sampling_mhz
    reach = round(REACH * band.length_us * sampling_mhz)
    cycle = sampling_mhz / band.centre_mhz
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
    aligned = locate_echoes(
        z,
        np.rint(moved).astype(np.int64),
        front.aligned,
        sampling_mhz,
        band,
        search_us=SEARCH_CYCLES / band.centre_mhz,
    )
    return replace(front, aligned=aligned)
