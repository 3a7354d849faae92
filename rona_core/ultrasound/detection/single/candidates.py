"""Search of a survey for front echoes, and for candidates of the inner echo behind them."""

from collections.abc import Iterator
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
)
from rona_core.ultrasound.detection.single.matched_filter import (
    Template,
    joined,
    quiet_template,
    rows_of,
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


@dataclass(frozen=True, slots=True, eq=False)
class Cleared:
    """A survey with its fronts found and taken away: what does not depend on the bone."""

    template: Template
    noise: Floats  # (n,) rms in each sample
    aligned: Complexes  # (n, f) spectra with the front echo at time 0
    behind: Complexes  # (n, f) the same without it
    fronts: Fronts


def clear_fronts(
    survey: ProbeSurvey, *, progress: Progress = silent, cancel: Cancel = never
) -> Cleared:
    """Return the fronts of all A-scans, and what is left without them.

    Where the survey knows the outer boundary, it is not looked for.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    template = quiet_template(survey.probe, survey.excitation, survey.track.rf)
    blocks = _blocks(len(survey), progress, cancel)
    return joined([_clear_block(survey, rows, template) for rows in blocks])


def _clear_block(survey: ProbeSurvey, rows: slice, template: Template) -> Cleared:
    track, probe = survey.track, survey.probe
    spectra, noise = trace_spectra(track.rf[rows].astype(np.float64), track.start_us, template)
    if survey.known_standoff_mm is None:
        fronts = find_fronts(spectra, noise, template)
    else:
        fronts = fronts_at(survey.known_standoff_mm[rows], probe)
    aligned = spectra * template.shift(probe.line_delay_us + fronts.delay_us)
    return Cleared(template, noise, aligned, subtract_fronts(aligned, template), fronts)


def search_echoes(
    cleared: Cleared,
    bone: Material,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> Echoes:
    """Return the fronts of all A-scans, and the candidates behind them in bone like this.

    Raises:
        CancelledError: ``cancel`` said so.
    """
    blocks = _blocks(len(cleared.noise), progress, cancel)
    return joined([_search_block(cleared, rows, bone) for rows in blocks])


def _search_block(cleared: Cleared, rows: slice, bone: Material) -> Echoes:
    template, noise, aligned = cleared.template, cleared.noise[rows], cleared.aligned[rows]
    fronts = rows_of(cleared.fronts, rows)
    candidates, log_likelihood, snr = find_candidates(cleared.behind[rows], noise, template, bone)
    return Echoes(template, noise, aligned, fronts, candidates, log_likelihood, snr)


def _blocks(n: int, progress: Progress, cancel: Cancel) -> Iterator[slice]:
    """Yield the rows of n A-scans, some at a time; progress counts those that were worked on."""
    for start in range(0, max(n, 1), BLOCK):
        if cancel():
            raise CancelledError("the detection of echoes was cancelled")
        yield slice(start, start + BLOCK)
        progress(min(1.0, (start + BLOCK) / max(n, 1)))
