"""Where a milling is rehearsed: what is commanded, and all that is measured."""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from rona_core.devices.samples import AScanTrack
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose

LEAST_STEP_MM = 0.1  # a shorter one counts as this long


@dataclass(frozen=True, slots=True, eq=False)
class BurrWay:
    """Commanded places of the burr while it cuts: n, in their order."""

    T_base_bed: Pose
    bottoms_bed: Floats  # (n, 3) lowest place of the ball
    radii_mm: Floats  # (n,) of the ball
    qs_rad: Floats  # (n, 6) posture of the arm there
    times_s: Floats  # (n,) of the planned motion
    feeds_mm_per_s: Floats  # (n,) planned
    layers: Ints  # (n,) counted from the top, as in the milling path

    def __len__(self) -> int:
        return len(self.times_s)

    def part(self, which: Bools) -> "BurrWay":
        """Return some of the places (n,)."""
        return BurrWay(
            self.T_base_bed,
            self.bottoms_bed[which],
            self.radii_mm[which],
            self.qs_rad[which],
            self.times_s[which],
            self.feeds_mm_per_s[which],
            self.layers[which],
        )

    def steps_mm(self) -> Floats:
        """Return the lengths (n,) of the steps to each place, never quite zero."""
        steps = np.diff(self.bottoms_bed, axis=0, prepend=self.bottoms_bed[:1])
        return np.maximum(np.linalg.norm(steps, axis=1), LEAST_STEP_MM)

    def after(self, other: "BurrWay") -> "BurrWay":
        """Return the way with its times going on from those of another one, if that has any."""
        return replace(self, times_s=self.times_s + other.times_s.max(initial=0.0))


@dataclass(frozen=True, slots=True, eq=False)
class ProbeWay:
    """Commanded places of a floor at which the probe is pressed on: m, in their order."""

    places_bed: Floats  # (m, 3) of the middle of its face
    qs_rad: Floats  # (m, 6) posture of the arm there
    times_s: Floats  # (m,) of the planned motion


@dataclass(frozen=True, slots=True)
class ForceReading:
    """Cutting force along one step of the way, as the force sensor measures it."""

    mean_n: float
    sigma_n: float  # of the single readings along the step


class MillingSite(Protocol):
    """A robot with burr and probe at a bone."""

    def follow(self, way: BurrWay) -> None:
        """Make ready for a way, its first place the next; the bone stays as it was left."""
        ...

    def advance(self, feed_mm_per_s: float) -> ForceReading:
        """Drive to the next place of the way."""
        ...

    def scan_floor(self, way: ProbeWay) -> AScanTrack:
        """Return an A-scan for each place, with the probe pressed on the floor along its axis."""
        ...
