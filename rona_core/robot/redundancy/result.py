"""Result of the search for a roll: a verdict on every roll, and the one chosen."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.redundancy.cost import CostShares

Reason = Literal["none", "reach", "singularity", "limit", "jump", "blocked", "roll rate", "no way"]
Choice = Literal["best", "first"]  # of the feasible constant rolls
RollMode = Literal["auto", "constant", "variable"]  # that is looked for
Mode = Literal["constant", "variable", "none"]  # that was found


@dataclass(frozen=True, slots=True)
class RollVerdict:
    """Whether the whole path can be followed with one roll, and if not, what stops it first.

    For a roll that varies along the path ``roll_deg`` is the roll at the path point ``index``.
    ``branch`` is the best branch of the arm, or for a roll that fails the one that gets furthest.
    ``value`` and ``limit`` are those of the first failing sample; for a feasible roll the least
    margin and 0.
    """

    roll_deg: float
    feasible: bool
    branch: int  # index into ik.BRANCHES
    margin: float  # smallest along the path (docs/algorithms/robot/roll_search.md); >= 0 passes
    reason: Reason
    index: int  # path point that fails first; where the room is smallest if none fails
    joint: int  # 1 to 6, or 0 where no single joint is to blame
    value: float
    limit: float
    unit: str
    sentence: str


def refused_with_largest_margin(verdicts: tuple[RollVerdict, ...]) -> RollVerdict | None:
    """Return the verdict with the largest margin among those without a way to the path or back."""
    refused = [verdict for verdict in verdicts if verdict.reason == "no way"]
    return max(refused, key=lambda verdict: verdict.margin, default=None)


@dataclass(frozen=True, slots=True)
class RankedRoll:
    """One way to follow the whole path with a constant roll."""

    index: int  # into the verdicts
    branch: int  # into ik.BRANCHES
    margin: float  # smallest room along the path


@dataclass(frozen=True, slots=True, eq=False)
class RollCurve:
    """A roll at each path point with the joint path that follows it, and what it costs."""

    rolls_rad: Floats  # (n,) continuous
    branch: int
    qs_rad: Floats  # (n, 6) continuous, within the limits
    cost: CostShares


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
        return float(np.rad2deg(np.ptp(self.rolls_rad))) if len(self.rolls_rad) else 0.0

    @property
    def verdict(self) -> RollVerdict | None:
        """The verdict on the chosen roll, constant or varying; None where none will do."""
        if self.mode == "variable":
            return self.varying
        return self.verdicts[self.chosen] if self.mode == "constant" else None

    @property
    def refused(self) -> RollVerdict | None:
        """The verdict with the largest margin among those without a way to the path or back."""
        return refused_with_largest_margin(self.verdicts)

    def with_constant_roll(self, index: int, branch: int, qs_rad: Floats) -> "RollSearch":
        """Return the search with one of its constant rolls chosen, and its joints (n, 6)."""
        rolls_rad = np.full(len(self.path), np.deg2rad(self.verdicts[index].roll_deg))
        return self._chosen("constant", index, rolls_rad, branch, qs_rad)

    def with_variable_roll(self, curve: RollCurve) -> "RollSearch":
        """Return the search with a roll chosen that varies along the path."""
        return self._chosen("variable", -1, curve.rolls_rad, curve.branch, curve.qs_rad)

    def _chosen(
        self, mode: Mode, index: int, rolls_rad: Floats, branch: int, qs_rad: Floats
    ) -> "RollSearch":
        return replace(
            self,
            mode=mode,
            chosen=index,
            branch=branch,
            rolls_rad=readonly(rolls_rad),
            chosen_curve_rad=readonly(qs_rad[self.shown_points].astype(np.float32)),
        )
