"""What planning a scan results in: verdicts on all rolls, a timed trajectory, its certificate."""

import hashlib
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rona_core.arrays import Floats, Ints
from rona_core.geometry.path5d import Path5D

Reason = Literal["none", "reach", "singularity", "limit", "jump", "blocked", "roll rate", "no way"]
Mode = Literal["constant", "variable", "none"]


@dataclass(frozen=True, slots=True)
class RollVerdict:
    """Whether the whole path can be followed with one roll, and if not, what stops it first.

    For a roll that varies along the path ``roll_deg`` is the roll at the path point ``index``.
    ``branch`` is the best branch of the arm, or for a roll that fails the one that gets furthest.
    ``value`` and ``limit`` are those of the first failing sample in ``unit``; for a roll that is
    feasible they are the smallest room of the whole path and 0, both without unit.
    """

    roll_deg: float
    feasible: bool
    branch: int  # index into ik.BRANCHES
    margin: float  # smallest room along the path, see docs/algorithms/roll_search.md; >= 0 passes
    reason: Reason
    index: int  # path point that fails first; where the room is smallest if none fails
    joint: int  # 1 to 6, or 0 where no single joint is to blame
    value: float
    limit: float
    unit: str
    sentence: str


@dataclass(frozen=True, slots=True)
class RankedRoll:
    """One way to follow the whole path with a constant roll."""

    index: int  # into the verdicts
    branch: int  # into ik.BRANCHES
    margin: float  # smallest room along the path


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


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that the verifier looked at: its worst value, where, and what is allowed."""

    name: str
    value: float
    limit: float
    unit: str
    index: int  # sample of the motion
    holds: bool
    sentence: str


@dataclass(frozen=True, slots=True)
class Certificate:
    """The verifier's word on one motion of one robot; worth nothing for any other motion."""

    model: str
    certified: bool
    checks: tuple[Check, ...]
    digest: str  # of the motion, the name of the robot and what stood around
    obstacles: str = ""  # digest of what stood around; "" where collisions were not looked at
    min_clearance_mm: float | None = None  # least distance of any parts that must not touch

    def certifies(self, motion: TimedMotion, obstacles: str | None = None) -> bool:
        """Return whether this is the motion that was looked at, and everything held.

        With the digest of what stands around now it must also have been looked at among that.
        """
        if obstacles is not None and self.obstacles != obstacles:
            return False
        return self.certified and self.digest == motion_digest(self.model, motion, self.obstacles)

    def failures(self) -> tuple[Check, ...]:
        """Return what did not hold."""
        return tuple(check for check in self.checks if not check.holds)


def motion_digest(model: str, motion: TimedMotion, obstacles: str = "") -> str:
    """Return the SHA-256 of a motion, its robot and what stands around, as hexadecimal digits."""
    digest = hashlib.sha256(f"{model}\n{obstacles}".encode())
    for array in (motion.times_s, motion.qs_rad):
        exact = np.ascontiguousarray(array, dtype="<f8")
        digest.update(str(exact.shape).encode())
        digest.update(exact.tobytes())
    return digest.hexdigest()


@dataclass(frozen=True, slots=True, eq=False)
class RollSearch:
    """Every roll that was tried on a path, and the one chosen: constant or varying."""

    mode: Mode
    verdicts: tuple[RollVerdict, ...]  # on constant rolls
    ranked: tuple[RankedRoll, ...]  # every constant roll and branch that is feasible, best first
    varying: RollVerdict | None  # on a roll that varies; None where none was looked for
    chosen: int  # index into verdicts; -1 where the chosen roll varies, and where none will do
    branch: int  # of the chosen roll; -1 where none will do
    rolls_rad: Floats  # (n,) the chosen roll at every path point; zeros where none will do
    path: Path5D
    shown_points: Ints  # (k,) path points at which the curves below are kept
    curves_rad: NDArray[np.float32]  # (rolls, k, 6) joints of the branch named in the verdict
    room: NDArray[np.float32]  # (rolls, k) smallest room from each shown point to the next
    node_room: NDArray[np.float32]  # (k, rolls) the same on the best branch there, by itself
    chosen_curve_rad: NDArray[np.float32]  # (k, 6) joints of the chosen roll; empty where none

    @property
    def n_feasible(self) -> int:
        """Number of constant rolls with which the whole path can be followed."""
        return sum(verdict.feasible for verdict in self.verdicts)

    @property
    def roll_variation_deg(self) -> float:
        """Largest less smallest roll of the chosen one along the path; 0 if it is constant."""
        return _spread_deg(self.rolls_rad)


@dataclass(frozen=True, slots=True, eq=False)
class RobotPlan:
    """How the robot follows a scan path: the roll search, the chosen roll, timed and verified."""

    model: str
    mode: Mode
    verdicts: tuple[RollVerdict, ...]  # this and all below up to the curve as in RollSearch
    ranked: tuple[RankedRoll, ...]
    varying: RollVerdict | None
    chosen: int
    branch: int
    rolls_rad: Floats
    path: Path5D
    shown_points: Ints
    curves_rad: NDArray[np.float32]
    room: NDArray[np.float32]
    node_room: NDArray[np.float32]
    chosen_curve_rad: NDArray[np.float32]
    trajectory: Trajectory | None
    certificate: Certificate | None

    @property
    def n_feasible(self) -> int:
        """Number of constant rolls with which the whole path can be followed."""
        return sum(verdict.feasible for verdict in self.verdicts)

    @property
    def roll_variation_deg(self) -> float:
        """Largest less smallest roll of the chosen one along the path; 0 if it is constant."""
        return _spread_deg(self.rolls_rad)

    @property
    def verdict(self) -> RollVerdict | None:
        """The verdict on the chosen roll, constant or varying; None where none will do."""
        if self.mode == "variable":
            return self.varying
        return self.verdicts[self.chosen] if self.mode == "constant" else None

    @property
    def refused(self) -> RollVerdict | None:
        """The verdict with the most room of those that have no way to the path or back, if any."""
        refused = [verdict for verdict in self.verdicts if verdict.reason == "no way"]
        return max(refused, key=lambda verdict: verdict.margin, default=None)

    @property
    def may_move(self) -> bool:
        """Whether there is a trajectory and its certificate stands."""
        return (
            self.trajectory is not None
            and self.certificate is not None
            and self.certificate.certifies(self.trajectory)
        )


def _spread_deg(rolls_rad: Floats) -> float:
    return float(np.rad2deg(np.ptp(rolls_rad))) if len(rolls_rad) else 0.0
