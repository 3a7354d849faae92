"""What the marker on the head says of each capture, in figures and in words."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from rona_core.app.dependencies.references import HeadWatch, watch_head
from rona_core.app.steps.scan.inputs import POSES
from rona_core.geometry.arrays import Vector3
from rona_core.session.document import Session

CAPTURES = {"surface": "step 4", "path": "step 5", "scan": "step 8", "second": "step 9"}
Axes = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class HeadShift:
    """How the head lay in one capture, against the first stroke of step 4."""

    capture: str
    state: Literal["still", "moved", "unchecked"]
    shift_mm: Axes | None = None  # mean along x, y, z of ``base``, at the middle of the scan
    sigma_mm: Axes | None = None  # of it
    turn_deg: float | None = None  # likewise
    range_mm: float | None = None  # farthest from its mean place meanwhile
    times_s: tuple[float, float] | None = None  # of the capture, in which it was watched
    reason: str = ""  # why it is unchecked


@dataclass(frozen=True, slots=True)
class HeadReport:
    """Pose of the head in every capture on it, by its marker."""

    shifts: tuple[HeadShift, ...]
    sentence: str  # about the scan


def head_report(session: Session) -> HeadReport | None:
    """Return the motion of the head by its marker; None before a scan that recorded it."""
    center = _middle(session)
    if center is None or watch_head(session, session.captures.scan) is None:
        return None
    shifts: list[HeadShift] = []
    for name in CAPTURES:
        held = session.captures.get(name)
        for capture in held if isinstance(held, tuple) else (held,):
            watch = watch_head(session, capture)
            if watch is not None:
                shifts.append(_shift(name, watch, center))
    scan = next(shift for shift in shifts if shift.capture == "scan")
    return HeadReport(tuple(shifts), head_sentence(scan))


def head_figures(session: Session) -> dict[str, float]:
    """Return shift, its sigma and the motion of the head in the scan, by ``docs/metrics.md``."""
    report = head_report(session)
    scan = None if report is None else next(s for s in report.shifts if s.capture == "scan")
    if scan is None or scan.shift_mm is None or scan.sigma_mm is None or scan.range_mm is None:
        return {}
    return {
        "head_shift_mm": float(np.linalg.norm(scan.shift_mm)),
        "head_shift_sigma_mm": float(np.linalg.norm(scan.sigma_mm)),
        "head_motion_mm": scan.range_mm,
    }


def head_sentence(scan: HeadShift) -> str:
    """Return what the head did up to the scan and in it, as people read it."""
    if scan.shift_mm is None or scan.sigma_mm is None or scan.range_mm is None:
        return f"It is not known whether the head moved: {scan.reason}. The maps are not corrected."
    sigma_mm = max(np.linalg.norm(scan.sigma_mm), 0.01)
    if scan.state == "still":
        return f"The head has not moved since step 4 (± {sigma_mm:.2f} mm, by its marker)."
    x, y, z = (round(part, 2) + 0.0 for part in scan.shift_mm)  # no "-0.00"
    return (
        f"The head has moved by {np.linalg.norm(scan.shift_mm):.2f} ± {sigma_mm:.2f} mm since step "
        f"4 ({x:+.2f}, {y:+.2f}, {z:+.2f} along x, y, z), and by up to {scan.range_mm:.2f} mm in "
        "the course of the scan: the maps are corrected for it, and show it as it lay in step 4."
    )


def unwatched(session: Session) -> str | None:
    """Return why the motion of the head in the scan is unknown; None where it is known or old."""
    watch = watch_head(session, session.captures.scan)
    return watch.reason if watch is not None and watch.state == "unchecked" else None


def _shift(name: str, watch: HeadWatch, center: Vector3) -> HeadShift:
    motion = watch.motion
    if motion is None:
        return HeadShift(name, watch.state, reason=watch.reason)
    return HeadShift(
        capture=name,
        state=watch.state,
        shift_mm=_axes(motion.shift_at(center)),
        sigma_mm=_axes(motion.sigma_at(center)),
        turn_deg=motion.turn_deg,
        range_mm=motion.range_at(center),
        times_s=(float(motion.times_s[0]), float(motion.times_s[-1])),
    )


def _axes(vector: Vector3) -> Axes:
    x, y, z = vector.tolist()
    return x, y, z


def _middle(session: Session) -> Vector3 | None:
    """Return the middle (3,) of the scanned places in ``base``."""
    poses = POSES.read(session)
    return poses.translations.mean(axis=0) if poses is not None and len(poses) else None
