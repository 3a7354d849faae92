"""Which probe suits the bone, as far as a scan that was made already says."""

from dataclasses import replace

from rona_core.app.steps.boundaries.handlers import detection_of_scan
from rona_core.session.document import Session
from rona_core.ultrasound.detection.bone_verdict import BoneVerdict, judge_bone
from rona_core.ultrasound.detection.manual_corrections import ScanName

SCANS: tuple[ScanName, ...] = ("first", "second", "hand")


def probe_advice(session: Session) -> BoneVerdict | None:
    """Return what the robot's passes, else the scan by hand, say about bone and probe.

    None before a scan was mapped.
    """
    first, second, by_hand = (detection_of_scan(session, scan) for scan in SCANS)
    found = by_hand if first is None else first
    if found is None:
        return None
    further = (second,) if second is not None and second.probe == found.probe else ()
    verdict = judge_bone(found, *further)
    if not verdict.another:
        return verdict
    chosen = session.setup.devices.probe.name == verdict.advised
    words = "It is chosen: scan again." if chosen else "Choose it in step 1 and scan again."
    return replace(verdict, sentence=f"{verdict.sentence} {words}")
