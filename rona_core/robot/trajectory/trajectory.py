"""Motions to be timed and timed ones: the path of a burr, and the motion of the joints."""

import hashlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rona_core.devices.limits import require
from rona_core.geometry.arrays import (
    Bools,
    Floats,
    Ints,
    as_floats,
    as_points,
    as_unit_vectors,
    readonly,
)
from rona_core.geometry.pose import Pose

SAMPLE_S = 0.02  # time between samples of a motion


class TimedMotion(Protocol):
    """Joint angles (n, 6) in radians at times (n,) in seconds."""

    @property
    def times_s(self) -> Floats: ...  # noqa: D102
    @property
    def qs_rad(self) -> Floats: ...  # noqa: D102


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """A timed motion of the joints, at rest at both ends; linear between its samples."""

    times_s: Floats  # (n,) from 0
    qs_rad: Floats  # (n, 6)
    scan_start_s: float  # the probe touches the first path point
    scan_end_s: float  # it reaches the last one
    path_mm: Floats  # (n,) way along the scan path: 0 before the scan, its length afterwards

    @property
    def duration_s(self) -> float:
        """Time from first to last sample."""
        return float(self.times_s[-1] - self.times_s[0])


def sampled_motion(qs_rad: Floats) -> Trajectory:
    """Return samples (n, 6), ``SAMPLE_S`` apart, as a motion that is no scan."""
    times_s = np.arange(len(qs_rad), dtype=np.float64) * SAMPLE_S
    return Trajectory(
        readonly(times_s), readonly(qs_rad), 0.0, 0.0, readonly(np.zeros(len(qs_rad)))
    )


def motion_digest(
    robot: str, times_s: Floats, qs_rad: Floats, obstacles: str = "", tolerances: str = ""
) -> str:
    """Return the SHA-256 of a motion and of what it was verified for, as hexadecimal digits.

    Args:
        robot: Digest of the robot.
        times_s: Times (n,).
        qs_rad: Joint angles (n, 6), or (n, m, 6) of a motion with m corrections.
        obstacles: Digest of what stands around; "" where that was not looked at.
        tolerances: Digest of what the verifier insisted on; "" in files of earlier versions.
    """
    stated = (robot, obstacles, tolerances) if tolerances else (robot, obstacles)
    digest = hashlib.sha256("\n".join(stated).encode())
    for array in (times_s, qs_rad):
        exact = np.ascontiguousarray(array, dtype="<f8")
        digest.update(str(exact.shape).encode())
        digest.update(exact.tobytes())
    return digest.hexdigest()


TURN_WAY_MM = 10.0  # a turn of one radian on the spot counts as this much way
UP = np.array((0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True, eq=False)
class BurrPlaces:
    """Where a burr is at n places of its way."""

    bottoms_bed: Floats  # (n, 3) its lowest place
    axes_bed: Floats  # (n, 3) into the bone
    tips_bed: Floats  # (n, 3) where it meets its own axis


@dataclass(frozen=True, slots=True, eq=False)
class CuttingPath:
    """Places (n) of a burr in ``bed``, z out of the bone; it goes straight from one to the next.

    Entry k of feeds, ``in_air`` and radii belongs to the move that ends at place k. The burr rests
    at some places, the first and the last among them: there a part of the work is done, and it
    may be left for good.
    """

    T_base_bed: Pose
    bottoms_bed: Floats  # (n, 3) lowest place of the burr
    axes_bed: Floats  # (n, 3) into the bone; of burrs that are no balls straight down
    radii_mm: Floats  # (n,) of the burr
    feeds_mm_per_s: Floats  # (n,) most speed of the tip
    in_air: Bools  # (n,) the move cuts nothing
    rests: Ints  # (k,) places, ascending
    surface_mm: float  # height in ``bed`` that no bone beside the path rises above

    def __post_init__(self) -> None:
        object.__setattr__(self, "bottoms_bed", as_points(self.bottoms_bed, at_least=2))
        object.__setattr__(self, "axes_bed", as_unit_vectors(self.axes_bed, name="axes_bed"))
        n = len(self.bottoms_bed)
        for name in ("radii_mm", "feeds_mm_per_s"):
            values = as_floats(getattr(self, name), name=name)
            require(values.shape == (n,) and values.min() > 0.0, f"{name} must be {n} lengths > 0")
            object.__setattr__(self, name, readonly(values))
        require(len(self.axes_bed) == n == len(self.in_air), f"a path of {n} places needs as many")
        rests = self.rests.tolist()
        require(
            len(rests) >= 2 and rests[0] == 0 and rests[-1] == n - 1 and rests == sorted({*rests}),
            "a path must rest at its first and at its last place",
        )

    def tips_bed(self) -> Floats:
        """Return where the burr meets its axis (n, 3)."""
        return _tips(self.bottoms_bed, self.axes_bed, self.radii_mm)

    def way_mm(self) -> Floats:
        """Return the way (n,): that of the tip, or where the burr turns on the spot, the turn."""
        before, after = self.axes_bed[:-1], self.axes_bed[1:]
        sines = np.linalg.norm(np.cross(before, after), axis=1)
        turns = np.arctan2(sines, np.einsum("ij,ij->i", before, after))
        turns[turns < 1e-6] = 0.0  # rounding, not a turn
        steps_mm = np.linalg.norm(np.diff(self.tips_bed(), axis=0), axis=1)
        return np.concatenate(([0.0], np.cumsum(np.maximum(steps_mm, TURN_WAY_MM * turns))))

    def moves_at(self, ways_mm: Floats) -> Ints:
        """Return the place (m,) at which the move ends that is under way at ways (m,)."""
        ends = np.searchsorted(self.way_mm(), ways_mm, side="left")
        return np.clip(ends, 1, len(self.bottoms_bed) - 1)

    def at(self, ways_mm: Floats) -> BurrPlaces:
        """Return where the burr is at ways (m,): it goes straight and turns evenly in between."""
        way = self.way_mm()
        end = self.moves_at(ways_mm)
        length = np.maximum(way[end] - way[end - 1], 1e-12)
        share = np.clip((ways_mm - way[end - 1]) / length, 0.0, 1.0)[:, None]
        bottoms = self.bottoms_bed[end - 1] * (1.0 - share) + self.bottoms_bed[end] * share
        axes = self.axes_bed[end - 1] * (1.0 - share) + self.axes_bed[end] * share
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        return BurrPlaces(bottoms, axes, _tips(bottoms, axes, self.radii_mm[end]))

    def changes(self) -> Bools:
        """Return at which of the rests (k,) another burr is put in; at the first and last none."""
        inner = self.rests[1:-1]
        other = self.radii_mm[inner] != self.radii_mm[inner + 1]
        return np.concatenate(([False], other, [False]))

    def rest_times_s(self, motion: Trajectory) -> Floats:
        """Return when a motion comes to each of the rests (k,)."""
        ways = self.way_mm()[self.rests]
        return motion.times_s[np.searchsorted(motion.path_mm, ways - 1e-6)]

    def change_times_s(self, motion: Trajectory) -> Floats:
        """Return when a motion stands at home for another burr (c,)."""
        ways = self.way_mm()[self.rests[self.changes()]]
        found: list[float] = []
        for way in ways:
            rows = np.flatnonzero(np.abs(motion.path_mm - way) <= 1e-6)
            from_home = np.abs(motion.qs_rad[rows] - motion.qs_rad[0]).max(axis=1)
            found.append(float(motion.times_s[rows[int(np.argmin(from_home))]]))
        return np.array(found, dtype=np.float64)


def _tips(bottoms: Floats, axes: Floats, radii: Floats) -> Floats:
    return bottoms + radii[:, None] * (axes + UP)
