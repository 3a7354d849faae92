"""Which probe suits the bone, as far as a scan that was made already tells."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.boundaries.handlers import detection_of_scan
from rona_core.devices.settings import ProbeName
from rona_core.session.document import Session
from rona_core.ultrasound.detection.detect import NO_INNER, TOO_THICK, TOO_THIN, UNSURE, Detection
from rona_core.ultrasound.detection.manual_corrections import ScanName

THIN_MM, THICK_MM = 4.0, 8.0  # below it the echoes merge at 1 MHz; beyond it 2.25 MHz fades
ENOUGH = 20  # A-scans that tell a thickness
MANY, MOST = 0.2, 0.5  # shares at which something is said
SCANS: tuple[ScanName, ...] = ("first", "hand")
TITLES = {"2.25MHz": "2.25 MHz", "1MHz": "1 MHz"}


@dataclass(frozen=True, slots=True)
class ProbeAdvice:
    """A sentence about the probe, and which one should be taken; the same one if it suits."""

    scanned_with: ProbeName
    advised: ProbeName
    sentence: str

    @property
    def another(self) -> bool:
        """Whether another probe than that of the scan is advised."""
        return self.advised != self.scanned_with


def probe_advice(session: Session) -> ProbeAdvice | None:
    """Return which probe the bone wants, by the robot's first scan, else by the one by hand.

    None before a scan was mapped, and where it tells too little.
    """
    found = next((d for d in (detection_of_scan(session, s) for s in SCANS) if d is not None), None)
    if found is None:
        return None
    advice = advised(found)
    if advice is None or not advice.another:
        return advice
    if session.setup.devices.probe.name == advice.advised:
        words = f"{advice.sentence} It is chosen: scan again."
    else:
        words = f"{advice.sentence} Choose it in step 1 and scan again."
    return ProbeAdvice(advice.scanned_with, advice.advised, words)


def advised(found: Detection) -> ProbeAdvice | None:
    """Return which probe the thicknesses and flags of a scan speak for; None: too few to tell."""
    sure, flag, mm = found.inner_ok, found.flag, found.thickness_mm
    used: ProbeName = "1MHz" if found.probe == "1MHz" else "2.25MHz"
    thin, thick = (sure & (mm < THIN_MM)) | (flag == TOO_THIN), sure & (mm > THICK_MM)
    thick |= flag == TOO_THICK
    known = sure | thin | thick
    silent = found.outer_ok & ~known & ((flag == NO_INNER) | (flag == UNSURE))
    n, with_front = int(np.count_nonzero(known)), int(np.count_nonzero(found.outer_ok))
    n_thin, n_thick = int(np.count_nonzero(thin)), int(np.count_nonzero(thick))
    unheard = np.count_nonzero(silent) / max(with_front, 1)
    thinner, thicker = n_thin >= MANY * n and n >= ENOUGH, n_thick >= MANY * n and n >= ENOUGH
    if thinner and thicker:
        words = (
            f"Bone from under {THIN_MM:g} to over {THICK_MM:g} mm: neither probe suits all of it. "
            "2.25 MHz is the one for the thin, 1 MHz for the thick places."
        )
        return ProbeAdvice(used, used, words)
    if used == "1MHz" and thinner:
        words = (
            f"The bone is under {THIN_MM:g} mm at {_percent(n_thin, n)} of the places: there the "
            "two echoes merge at 1 MHz. Better: the 2.25 MHz probe."
        )
        return ProbeAdvice(used, "2.25MHz", words)
    if used == "2.25MHz" and thicker:
        words = (
            f"The bone is over {THICK_MM:g} mm at {_percent(n_thick, n)} of the places: 2.25 MHz "
            "fades there. Better: the 1 MHz probe."
        )
        return ProbeAdvice(used, "1MHz", words)
    if used == "2.25MHz" and with_front >= ENOUGH and unheard >= MOST and not thinner:
        words = (
            f"No sure inner echo at {100.0 * unheard:.0f} % of the places: the bone is too thick "
            "or too hard for 2.25 MHz, or its inner table leans (second pass). Better: 1 MHz."
        )
        return ProbeAdvice(used, "1MHz", words)
    if n < ENOUGH:
        return None
    low, high = np.percentile(mm[sure], (5.0, 95.0)) if sure.any() else (0.0, 0.0)
    words = f"The {TITLES[used]} probe suits this bone of {low:.1f} to {high:.1f} mm."
    return ProbeAdvice(used, used, words)


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.0f} %"
