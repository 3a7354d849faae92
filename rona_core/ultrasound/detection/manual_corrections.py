"""Manual corrections of boundaries, kept beside the results of detection."""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from rona_core.geometry.arrays import Bools, readonly
from rona_core.ultrasound.detection.detect import NO_FRONT, NO_INNER, OK, REMOVED, Detection
from rona_core.ultrasound.detection.single.front_echo import standoff_mm
from rona_core.ultrasound.probe.probe_model import ProbeModel

ScanName = Literal["first", "second", "hand"]  # the two passes of the robot; a scan by hand
Boundary = Literal["outer", "inner"]
HAND_CYCLES = 0.25  # sigma of a place read off by eye, in cycles of the probe


@dataclass(frozen=True, slots=True)
class BoundaryEdit:
    """One boundary of one A-scan, set by hand; without a time it is taken away."""

    scan: ScanName
    number: int  # of the A-scan, from 0
    boundary: Boundary
    time_us: float | None  # two-way time from the emission

    @property
    def place(self) -> tuple[str, int, str]:
        """Return what the edit is about; there is one edit for each at most."""
        return self.scan, self.number, self.boundary


@dataclass(frozen=True, slots=True)
class BoundaryEdits:
    """All boundaries set by hand, in the order of the A-scans."""

    changes: tuple[BoundaryEdit, ...] = ()

    def __len__(self) -> int:
        return len(self.changes)

    def of(self, scan: ScanName, boundary: Boundary | None = None) -> "BoundaryEdits":
        """Return those of one pass, or of one of its boundaries alone."""
        return BoundaryEdits(
            tuple(
                edit
                for edit in self.changes
                if edit.scan == scan and boundary in (None, edit.boundary)
            )
        )

    def put(self, edit: BoundaryEdit) -> "BoundaryEdits":
        """Return the edits with one more; it replaces an earlier one of the same boundary."""
        kept = [held for held in self.changes if held.place != edit.place]
        return BoundaryEdits(tuple(sorted((*kept, edit), key=lambda held: held.place)))

    def without(self, scan: ScanName, number: int | None = None) -> "BoundaryEdits":
        """Return the edits without those of a pass, or of one of its A-scans."""
        return BoundaryEdits(
            tuple(
                edit
                for edit in self.changes
                if edit.scan != scan or number not in (None, edit.number)
            )
        )

    def marks(self, scan: ScanName, n: int) -> Bools:
        """Return which of the n A-scans of a pass were touched by hand (n,)."""
        touched = np.zeros(n, dtype=np.bool_)
        touched[[e.number for e in self.changes if e.scan == scan and e.number < n]] = True
        return readonly(touched)


def corrected(
    detection: Detection, edits: BoundaryEdits, scan: ScanName, probe: ProbeModel
) -> Detection:
    """Return a detection with what was set by hand in place of what was found.

    A boundary set by hand counts: its quality is 1 and its sigma that of a place read off by eye.
    One that was taken away does not, and without an outer boundary there is no inner one.
    Edits of A-scans that the detection has not are left out.
    """
    mine = [e for e in edits.of(scan).changes if e.number < len(detection)]
    if not mine:
        return detection
    half_speed = detection.sound_speed_mm_per_us / 2.0
    hand_us = HAND_CYCLES / probe.centre_mhz
    held: dict[str, Any] = {
        name: np.array(getattr(detection, name))
        for name in (
            "outer_us", "inner_us", "outer_ok", "inner_ok", "outer_quality", "inner_quality",
            "flag", "standoff_mm", "thickness_mm", "outer_sigma_mm", "thickness_sigma_mm",
            "inner_sigma_us",
        )
    }  # fmt: skip
    for edit in sorted(mine, key=lambda e: e.boundary, reverse=True):  # outer before inner
        i, present = edit.number, edit.time_us is not None
        if present:
            held[f"{edit.boundary}_us"][i] = edit.time_us
        if edit.boundary == "inner" and scan != "second":  # that one knows the outer boundary
            present = present and bool(held["outer_ok"][i])
        held[f"{edit.boundary}_ok"][i] = present
        held[f"{edit.boundary}_quality"][i] = float(present)
        if edit.boundary == "inner":
            held["flag"][i] = OK if present else REMOVED
            if present:
                held["inner_sigma_us"][i] = hand_us
                held["thickness_sigma_mm"][i] = hand_us * half_speed
        elif present:
            delay = held["outer_us"][i : i + 1] - probe.line_delay_us
            held["standoff_mm"][i] = standoff_mm(delay, probe)[0]
            held["outer_sigma_mm"][i] = hand_us * probe.line.speed_mm_per_us / 2.0
            if held["flag"][i] == NO_FRONT:
                held["flag"][i] = NO_INNER
        else:
            held["flag"][i] = REMOVED
            held["inner_ok"][i] = False
        held["thickness_mm"][i] = half_speed * (held["inner_us"][i] - held["outer_us"][i])
    shown: dict[str, Any] = {name: readonly(value) for name, value in held.items()}
    return replace(detection, **shown)
