"""Detection of the outer boundary alone, A-scan by A-scan: for views that follow a scan."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.ultrasound.detection.single.front_echo import find_fronts, fronts_found, standoff_mm
from rona_core.ultrasound.detection.single.matched_filter import quiet_template, trace_spectra
from rona_core.ultrasound.probe.probe_model import ProbeSurvey


@dataclass(frozen=True, slots=True, eq=False)
class OuterBoundary:
    """The outer boundary along the probe axis in each A-scan (n,); what is not ok is a guess."""

    standoff_mm: Floats  # from the face of the uncompressed line; negative if pressed
    ok: Bools


def detect_outer(survey: ProbeSurvey) -> OuterBoundary:
    """Return the outer boundary as ``detect`` finds it, without looking for an inner one.

    Only the noise that the template is chosen for is that of these A-scans.
    """
    track, probe = survey.track, survey.probe
    template = quiet_template(probe, survey.excitation, track.rf)
    spectra, noise = trace_spectra(track.rf.astype(np.float64), track.start_us, template)
    fronts = find_fronts(spectra, noise, template)
    ok = fronts_found(fronts, probe) & ~np.asarray(track.clipped)
    return OuterBoundary(readonly(standoff_mm(fronts.delay_us, probe)), readonly(ok))
