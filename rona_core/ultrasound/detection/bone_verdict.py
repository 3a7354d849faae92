"""What a survey says about the bone and its probe: thin, thick, faint, or no echo at all.

The one judge of it: page, REST, report and acceptance write its sentence. A thickness is known
where an inner echo is sure and nowhere else. Without enough of them thin, thick and lossy bone look
alike, and then no figure is given and no probe is advised.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.devices.settings import ProbeName
from rona_core.ultrasound.detection.detect import (
    REMOVED,
    TILTED,
    TOO_THICK,
    TOO_THIN,
    Detection,
    has_inner_echoes,
)

BoneEvidence = Literal["no front", "no echo", "faint", "thin", "thick", "mixed", "suits"]
PROBE_TITLES: Mapping[ProbeName, str] = {"2.25MHz": "2.25 MHz", "1MHz": "1 MHz"}
THIN_MM, THICK_MM = 4.0, 8.0  # below it the echoes merge at 1 MHz; beyond it 2.25 MHz fades
ENOUGH = 20  # sure echoes, from which on something is said about the thickness
MANY = 0.2  # share of thin or thick places at which another probe is better
LEAST_SURE = 0.5  # share of places with a sure echo, below which it is open what the others are


@dataclass(frozen=True, slots=True)
class BoneVerdict:
    """What a survey says about the bone, in one sentence with the next step."""

    kind: BoneEvidence
    scanned_with: ProbeName
    advised: ProbeName | None  # the same one if it suits; None: the echoes do not say
    sentence: str

    @property
    def another(self) -> bool:
        """Whether another probe than that of the survey is advised."""
        return self.advised not in (None, self.scanned_with)


def judge_bone(found: Detection, *further: Detection) -> BoneVerdict:
    """Return what the echoes of a survey say about thickness and probe.

    Places are A-scans with a front echo whose probe did not lean and that stand as detected.

    Args:
        found: The survey.
        further: Passes over its gaps with the same probe: their A-scans count as well.
    """
    used: ProbeName = "1MHz" if found.probe == "1MHz" else "2.25MHz"
    other: ProbeName = "2.25MHz" if used == "1MHz" else "1MHz"
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
            f"given. Next: scan once with {PROBE_TITLES[other]} (step 1) and compare, or move the "
            "region (step 1)."
        )
        return BoneVerdict("no echo", used, None, words)
    span = "{:.1f} to {:.1f} mm".format(*np.percentile(mm[sure], (5.0, 95.0)))
    # an echo outside the depth range of the probe is no sure one, but beside sure ones it counts
    thin = (sure & (mm < THIN_MM)) | (places & (flag == TOO_THIN))
    thick = (sure & (mm > THICK_MM)) | (places & (flag == TOO_THICK))
    n_known = int((sure | thin | thick).sum())
    if n_sure < LEAST_SURE * n_places:
        words = (
            f"Inner echo sure at only {_percent(n_sure, n_places)} of the places, where the bone "
            f"is {span}; at the others a leaning inner table and thin, thick or lossy bone look "
            "alike. Next: a further pass over the gaps (step 9), or scan once with "
            f"{PROBE_TITLES[other]} (step 1) and compare."
        )
        return BoneVerdict("faint", used, None, words)
    return _by_thickness(used, span, int(thin.sum()), int(thick.sum()), n_known)


def _by_thickness(
    used: ProbeName, span: str, n_thin: int, n_thick: int, n_known: int
) -> BoneVerdict:
    """Return which probe suits bone of known thickness, by how many places are thin or thick."""
    thinner, thicker = n_thin >= MANY * n_known, n_thick >= MANY * n_known
    if thinner and thicker:
        words = (
            f"Bone from under {THIN_MM:g} to over {THICK_MM:g} mm: neither probe suits all of it. "
            "Next: scan the thin places with 2.25 MHz, the thick ones with 1 MHz."
        )
        return BoneVerdict("mixed", used, used, words)
    if used == "1MHz" and thinner:
        words = (
            f"The bone is under {THIN_MM:g} mm at {_percent(n_thin, n_known)} of the places: there "
            "the two echoes merge at 1 MHz. Better: the 2.25 MHz probe."
        )
        return BoneVerdict("thin", used, "2.25MHz", words)
    if used == "2.25MHz" and thicker:
        words = (
            f"The bone is over {THICK_MM:g} mm at {_percent(n_thick, n_known)} of the places: "
            "2.25 MHz fades there. Better: the 1 MHz probe."
        )
        return BoneVerdict("thick", used, "1MHz", words)
    words = f"The {PROBE_TITLES[used]} probe suits this bone of {span}."
    return BoneVerdict("suits", used, used, words)


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.0f} %"
