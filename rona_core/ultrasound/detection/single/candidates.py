"""Search of a survey for front echoes, and for candidates of the inner echo behind them."""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.front_echo import (
    Fronts,
    find_fronts,
    fronts_at,
    subtract_fronts,
)
from rona_core.ultrasound.detection.single.inner_echo import (
    Candidates,
    find_candidates,
    inner_grid_mm,
    merged_levels,
)
from rona_core.ultrasound.detection.single.matched_filter import (
    Template,
    quiet_template,
    trace_spectra,
)
from rona_core.ultrasound.probe.materials import Complexes, Material
from rona_core.ultrasound.probe.probe_model import ProbeSurvey

BLOCK = 256  # A-scans at a time


@dataclass(frozen=True, slots=True, eq=False)
class Echoes:
    """Fronts and candidates of a survey, before any is selected."""

    template: Template
    noise: Floats  # (n,) rms in each sample
    aligned: Complexes  # (n, f) spectra with the front echo at time 0
    fronts: Fronts
    candidates: Candidates
    log_likelihood: Floats  # (n, m) ratio for an inner echo at each depth of `inner_grid_mm`
    snr: Floats  # (n, m) level over the noise there
    merged: Floats  # (n,) level of what follows the front at once, see `inner_echo.py`


def search_echoes(
    survey: ProbeSurvey,
    bone: Material,
    *,
    candidates: bool = True,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Echoes:
    """Return the fronts of all A-scans, and behind them the candidates unless not wanted.

    Where the survey knows the outer boundary, it is not looked for.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    track, probe, standoff_mm = survey.track, survey.probe, survey.known_standoff_mm
    template = quiet_template(probe, survey.excitation, track.rf)
    noises: list[Floats] = []
    fronts: list[Fronts] = []
    aligned: list[Complexes] = [np.zeros((0, len(template.frequencies_mhz)), np.complex128)]
    found: list[Candidates] = []
    nothing = np.zeros((0, len(inner_grid_mm(probe, bone))))
    log_likelihood, snr = [nothing], [nothing]
    merged = [np.zeros(0)]
    for start in range(0, len(track), BLOCK):
        if cancel():
            raise CancelledError("the detection of echoes was cancelled")
        rf = track.rf[start : start + BLOCK].astype(np.float64)
        spectra, noise = trace_spectra(rf, track.start_us, template)
        if standoff_mm is None:
            front = find_fronts(spectra, noise, template)
        else:
            front = fronts_at(standoff_mm[start : start + BLOCK], probe)
        spectra = spectra * template.shift(probe.line_delay_us + front.delay_us)
        noises.append(noise)
        fronts.append(front)
        aligned.append(spectra)
        if candidates:
            behind = subtract_fronts(spectra, template)
            peaks, ratio, over_noise = find_candidates(behind, noise, template, bone)
            found.append(peaks)
            log_likelihood.append(ratio)
            snr.append(over_noise)
            merged.append(merged_levels(spectra, front, template, bone))
        progress(min(1.0, (start + BLOCK) / max(len(track), 1)))
    return Echoes(
        template,
        np.concatenate([np.zeros(0), *noises]),
        np.concatenate(aligned),
        Fronts.concatenate(fronts),
        Candidates.concatenate(found),
        np.concatenate(log_likelihood),
        np.concatenate(snr),
        np.concatenate(merged),
    )
