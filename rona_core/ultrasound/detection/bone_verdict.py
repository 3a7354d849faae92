"""What a survey says about the bone and its probe: thin, thick, faint, or no echo at all.

The one judge of it: page, REST, report and acceptance write its sentence. A thickness is known
where an inner echo is sure and nowhere else. Without enough of them thin, thick and lossy bone look
alike, and then no figure is given and no probe is advised.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.devices.probes import PROBE_DATA, neighbours
from rona_core.devices.settings import ProbeSettings
from rona_core.ultrasound.detection.detect import (
    REMOVED,
    TILTED,
    TOO_THICK,
    TOO_THIN,
    Detection,
    has_inner_echoes,
)

BoneEvidence = Literal["no front", "no echo", "faint", "thin", "thick", "mixed", "suits"]
ENOUGH = 20  # sure echoes, from which on something is said about the thickness
MANY = 0.2  # share of thin or thick places at which another probe is better
LEAST_SURE = 0.5  # share of places with a sure echo, below which it is open what the others are


@dataclass(frozen=True, slots=True)
class BoneVerdict:
    """What a survey says about the bone, in one sentence with the next step."""

    kind: BoneEvidence
    scanned_with: str
    advised: str | None  # the same one if it suits; None: the echoes do not say
    sentence: str

    @property
    def another(self) -> bool:
        """Whether another probe than that of the survey is advised."""
        return self.advised not in (None, self.scanned_with)


@dataclass(frozen=True, slots=True)
class Suited:
    """Bone that suits a probe, and the probes for thinner and thicker bone."""

    used: str
    finer: str  # for thinner bone; the same where there is none
    coarser: str  # for thicker bone; the same where there is none
    thin_mm: float  # below it the echoes merge: of the coarser of two neighbours
    thick_mm: float  # beyond it the echoes fade: of the finer of two neighbours

    @property
    def other(self) -> str:
        """The probe to try where the echoes do not say which way to go."""
        return self.coarser if self.coarser != self.used else self.finer


def judge_bone(found: Detection, *further: Detection) -> BoneVerdict:
    """Return what the echoes of a survey say about thickness and probe.

    Places are A-scans with a front echo whose probe did not lean and that stand as detected.

    Args:
        found: The survey.
        further: Passes over its gaps with the same probe: their A-scans count as well.
    """
    used = found.probe if found.probe in PROBE_DATA else ProbeSettings().name
    suits = suited(used)
    other = PROBE_DATA[suits.other].title
    passes = (found, *further)
    flag = np.concatenate([one.flag for one in passes])
    places = np.concatenate([one.outer_ok for one in passes]) & ~np.isin(flag, (TILTED, REMOVED))
    sure = np.concatenate([one.inner_ok for one in passes]) & places
    mm = np.concatenate([one.thickness_mm for one in passes])
    n_places, n_sure = int(places.sum()), int(sure.sum())
    if n_places < ENOUGH:
        words = (
            f"{n_places} of {len(flag)} A-scans can be judged, {ENOUGH} are the least: nothing "
            "is said about bone or probe. Next: check gel, force and tilt of the probe and scan "
            "again, or scan a longer path."
        )
        return BoneVerdict("no front", used, None, words)
    if n_sure < ENOUGH or not has_inner_echoes(found):
        words = (
            f"Inner echo sure at {n_sure} of {n_places} places, {ENOUGH} are the least: thin, "
            "thick and lossy bone look alike without it, so neither a thickness nor a probe is "
            f"given. Next: scan once with {other} (step 1) and compare, or move the "
            "region (step 1)."
        )
        return BoneVerdict("no echo", used, None, words)
    span = "{:.1f} to {:.1f} mm".format(*np.percentile(mm[sure], (5.0, 95.0)))
    # an echo outside the depth range of the probe is no sure one, but beside sure ones it counts
    thin = (sure & (mm < suits.thin_mm)) | (places & (flag == TOO_THIN))
    thick = (sure & (mm > suits.thick_mm)) | (places & (flag == TOO_THICK))
    n_known = int((sure | thin | thick).sum())
    if n_sure < LEAST_SURE * n_places:
        words = (
            f"Inner echo sure at only {_percent(n_sure, n_places)} of the places, where the bone "
            f"is {span}; at the others a leaning inner table and thin, thick or lossy bone look "
            "alike. Next: a further pass over the gaps (step 9), or scan once with "
            f"{other} (step 1) and compare."
        )
        return BoneVerdict("faint", used, None, words)
    return _by_thickness(suits, span, int(thin.sum()), int(thick.sum()), n_known)


def suited(used: str) -> Suited:
    """Return what suits a probe of the catalogue, beside those of the next frequencies."""
    finer, coarser = neighbours(used)
    merging = PROBE_DATA[used if finer or not coarser else coarser]
    fading = PROBE_DATA[used if coarser or not finer else finer]
    return Suited(used, finer or used, coarser or used, merging.min_thickness_mm, fading.fades_mm)


def _by_thickness(suits: Suited, span: str, n_thin: int, n_thick: int, n_known: int) -> BoneVerdict:
    """Return which probe suits bone of known thickness, by how many places are thin or thick."""
    used, finer, coarser = (PROBE_DATA[n].title for n in (suits.used, suits.finer, suits.coarser))
    thinner, thicker = n_thin >= MANY * n_known, n_thick >= MANY * n_known
    if thinner and thicker:
        words = (
            f"Bone from under {suits.thin_mm:g} to over {suits.thick_mm:g} mm: no probe suits "
            f"all of it. Next: scan the thin places with {finer}, the thick ones with {coarser}."
        )
        return BoneVerdict("mixed", suits.used, suits.used, words)
    if finer != used and thinner:
        words = (
            f"The bone is under {suits.thin_mm:g} mm at {_percent(n_thin, n_known)} of the "
            f"places: there the two echoes merge at {used}. Better: the {finer} probe."
        )
        return BoneVerdict("thin", suits.used, suits.finer, words)
    if coarser != used and thicker:
        words = (
            f"The bone is over {suits.thick_mm:g} mm at {_percent(n_thick, n_known)} of the "
            f"places: {used} fades there. Better: the {coarser} probe."
        )
        return BoneVerdict("thick", suits.used, suits.coarser, words)
    words = f"The {used} probe suits this bone of {span}."
    return BoneVerdict("suits", suits.used, suits.used, words)


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.0f} %"
