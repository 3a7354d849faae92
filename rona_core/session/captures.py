"""Captures: what the devices measured in one go, as it came, with the set-up it was taken with."""

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

from rona_core.devices.samples import AScanTrack, JointTrack, ToolTrack
from rona_core.devices.settings import FIRST_PLACE, TrackerPlace
from rona_core.devices.wrench import ForceTrack
from rona_core.geometry.arrays import Floats, Ints
from rona_core.session.codec import OMIT_EMPTY, OpenType


@dataclass(frozen=True, slots=True, eq=False)
class ToolCapture:
    """Step 2: the tool marker while the robot pivots and translates the tool, dwelling at poses."""

    ordinal: int
    setup_digest: str  # of the setup it was taken with
    marker: ToolTrack
    joints: JointTrack
    dwell_start_s: Floats  # (n,)
    dwell_end_s: Floats  # (n,)
    phases: Ints  # (n,) 0 pivot, 1 along tool x, 2 along tool y
    partial: bool = False
    base: ToolTrack | None = None  # the base marker meanwhile; None: not recorded
    tracker_place: TrackerPlace = FIRST_PLACE  # as the set-up had it


@dataclass(frozen=True, slots=True, eq=False)
class PointerCapture:
    """Steps 3, 4 and 5: the pointer marker during a pivot, a sweep or a demonstrated path."""

    ordinal: int
    setup_digest: str
    pointer: str  # which one, see devices.settings
    marker: ToolTrack
    partial: bool = False
    base: ToolTrack | None = None  # the base marker meanwhile; None: not recorded
    tracker_place: TrackerPlace = FIRST_PLACE  # as the set-up had it
    head: ToolTrack | None = field(default=None, metadata=OMIT_EMPTY)  # likewise, of the head
    # (m, 3) mm, markers of an imported pivot, where its files have them
    geometry_marker: Floats | None = field(default=None, metadata=OMIT_EMPTY)


@dataclass(frozen=True, slots=True, eq=False)
class ScanCapture:
    """Step 8: A-scans, joint angles and forces, each with the time at which it arrived."""

    ordinal: int
    setup_digest: str
    scans: AScanTrack
    joints: JointTrack
    partial: bool = False
    forces: ForceTrack | None = None  # None: driven by position alone
    clock_scans: AScanTrack | None = None  # while pressing on and lifting: they tell the delay
    base: ToolTrack | None = field(default=None, metadata=OMIT_EMPTY)  # the markers meanwhile, at a
    head: ToolTrack | None = field(
        default=None, metadata=OMIT_EMPTY
    )  # slow pace; None: not recorded


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceCapture:
    """Step 9: places of known thickness, each along the probe's axis; for the speed of sound."""

    ordinal: int
    setup_digest: str
    places_base: Floats  # (n, 3) on the outer surface
    thickness_mm: Floats  # (n,)
    sigma_mm: Floats  # (n,) standard deviation of the caliper
    partial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class BlockCapture:
    """Step 1: the probe at rest on a flat block of metal, a track for each temperature."""

    ordinal: int
    setup_digest: str
    tracks: tuple[AScanTrack, ...]
    temperatures_c: Floats  # (n,) of the delay line, by thermometer
    partial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SonoCapture:
    """The probe in the hand: A-scans and the marker on the probe, on one clock."""

    ordinal: int
    setup_digest: str
    marker: ToolTrack
    scans: AScanTrack
    partial: bool = False
    base: ToolTrack | None = None  # the base marker meanwhile; None: not recorded
    tracker_place: TrackerPlace = FIRST_PLACE  # as the set-up had it


@dataclass(frozen=True, slots=True, eq=False)
class PointsCapture:
    """Steps 4 and 5: points that were measured or drawn elsewhere, in ``base``."""

    ordinal: int
    setup_digest: str
    points_base: Floats  # (n, 3) mm, in their order
    partial: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class MotionCapture:
    """Step 7: a motion of the robot that was planned elsewhere, linear between its samples."""

    ordinal: int
    setup_digest: str
    times_s: Floats  # (n,) from 0
    qs_rad: Floats  # (n, 6)
    partial: bool = False


class OpenCapture(OpenType, Protocol):
    """A capture of a declared class that has no field of its own in the session."""

    @property
    def ordinal(self) -> int:
        """Number of the capture in the session, from 1."""
        ...

    @property
    def setup_digest(self) -> str:
        """Digest of the set-up it was taken with."""
        ...

    @property
    def partial(self) -> bool:
        """Whether it was stopped early."""
        ...


Capture = (
    ToolCapture
    | PointerCapture
    | ScanCapture
    | ReferenceCapture
    | BlockCapture
    | SonoCapture
    | OpenCapture
)


IMPORTED = "imported:"


def imported_digest(contents: Iterable[bytes], setup: str = "") -> str:
    """Return what an imported capture holds as the digest of its set-up.

    Args:
        contents: Of the files that it came out of.
        setup: Digest of what of the set-up it rests on all the same; "" for nothing.
    """
    hasher = hashlib.sha256()
    for data in contents:
        hasher.update(hashlib.sha256(data).digest())
    return IMPORTED + hasher.hexdigest() + (f":{setup}" if setup else "")


def imported_setup(capture: "Capture") -> str:
    """Return the digest of what of the set-up an imported capture rests on; "" for nothing."""
    return capture.setup_digest.removeprefix(IMPORTED).partition(":")[2]


def is_imported(capture: Capture | None) -> bool:
    """Return whether a capture came out of a file: no virtual device knows its truth."""
    return capture is not None and capture.setup_digest.startswith(IMPORTED)
