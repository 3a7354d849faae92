"""Echo profiles: the level of the echoes of each A-scan against the time behind its front echo.

The front echo is fitted and taken away with its side lobes, and its main lobe is put back: the
CLEAN algorithm (Högbom 1974, see docs/references.md) with one component whose place is known.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.ultrasound.detection.single.candidates import BLOCK, clear_fronts
from rona_core.ultrasound.detection.single.matched_filter import BONE_REFLECTION, Template
from rona_core.ultrasound.probe.materials import GEL, Complexes
from rona_core.ultrasound.probe.probe_model import (
    SLOWEST_BONE_MM_PER_US,
    ProbeModel,
    ProbeSurvey,
)

ABOVE_MM = 2.0  # of gel before the outer boundary that a profile holds
BEYOND_MM = 1.0  # of bone behind the thickest that the probe can measure


@dataclass(frozen=True, slots=True, eq=False)
class EchoProfiles:
    """Envelopes (n, m) of A-scans behind the matched filter, aligned to the outer boundary."""

    first_us: float  # two-way time of the first sample after the outer boundary; negative
    step_us: float
    level: NDArray[np.float32]  # (n, m) 1: front echo of flat bone in perfect contact

    def __len__(self) -> int:
        return len(self.level)

    def at(self, lags_us: Floats) -> Floats:
        """Return the levels (n, k) at these times (n, k) behind the outer boundary, linearly.

        What a profile does not hold is 0.
        """
        place = (lags_us - self.first_us) / self.step_us
        last = self.level.shape[1] - 2
        inside = (place >= 0.0) & (place <= last + 1)
        whole = np.clip(np.floor(place), 0, last).astype(np.int64)
        share, rows = place - whole, np.arange(len(self.level))[:, None]
        before, after = self.level[rows, whole], self.level[rows, whole + 1]
        return np.where(inside, before + share * (after - before), 0.0)


def deepest_mm(probe: ProbeModel) -> float:
    """Return how deep below the outer boundary profiles tell of bone."""
    return probe.max_thickness_mm + BEYOND_MM


def echo_profiles(survey: ProbeSurvey) -> EchoProfiles:
    """Return the profiles of a survey whose outer boundaries are known.

    Raises:
        InvalidInputError: the survey does not say where the outer boundary is.
    """
    if survey.known_standoff_mm is None:
        raise InvalidInputError("profiles are aligned to the outer boundary: detect it first")
    cleared = clear_fronts(survey)
    template = cleared.template
    first = -int(np.ceil(2.0 * ABOVE_MM / GEL.speed_mm_per_us / template.step_us))
    last = int(np.ceil(2.0 * deepest_mm(survey.probe) / SLOWEST_BONE_MM_PER_US / template.step_us))
    lobe = _main_lobe(template)
    fronts = template.filtered(cleared.aligned, template.spectrum, np.zeros(1))  # (n, 1)
    level = np.zeros((len(survey), last - first + 1), dtype=np.float32)
    for start in range(0, len(survey), BLOCK):
        rows = slice(start, start + BLOCK)
        trace = template.compress(cleared.behind[rows], template.spectrum) + fronts[rows] * lobe
        level[rows] = np.abs(np.take(trace, np.arange(first, last + 1), axis=1, mode="wrap"))
    level /= BONE_REFLECTION
    level.setflags(write=False)
    return EchoProfiles(first * template.step_us, template.step_us, level)


def _main_lobe(template: Template) -> Complexes:
    """Return the compressed echo of a mirror at time 0, up to the first minimum on either side."""
    whole = template.compress(template.spectrum, template.spectrum)
    rises = np.diff(np.abs(whole[: len(whole) // 2])) > 0.0
    reach = int(np.argmax(rises))
    lobe = np.zeros_like(whole)
    lobe[: reach + 1], lobe[-reach:] = whole[: reach + 1], whole[-reach:]
    return lobe
