"""Which probe suits the bone, as far as a scan that was made already says."""

from dataclasses import replace

from rona_core.app.steps.boundaries.handlers import detection_of_scan
from rona_core.session.document import Session
from rona_core.ultrasound.detection.bone_verdict import (
    PROBE_TITLES,
    THICK_MM,
    THIN_MM,
    BoneVerdict,
    judge_bone,
)
from rona_core.ultrasound.detection.manual_corrections import ScanName

__all__ = ["PROBE_TITLES", "THICK_MM", "THIN_MM", "BoneVerdict", "judge_bone", "probe_advice"]
SCANS: tuple[ScanName, ...] = ("first", "hand")


def probe_advice(session: Session) -> BoneVerdict | None:
    """Return what the robot's first scan, else that by hand, says about bone and probe.

    None before a scan was mapped.
    """
    found = next((d for d in (detection_of_scan(session, s) for s in SCANS) if d is not None), None)
    if found is None:
        return None
    verdict = judge_bone(found)
    if not verdict.another:
        return verdict
    chosen = session.setup.devices.probe.name == verdict.advised
    words = "It is chosen: scan again." if chosen else "Choose it in step 1 and scan again."
    return replace(verdict, sentence=f"{verdict.sentence} {words}")
