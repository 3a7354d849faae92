"""Cost of a roll along the path, and the result of the search for one.

What a roll along the path costs: joint motion, nearness to limits and to singularities. One
objective for constant, varying and refined rolls, so that they can be compared. See
docs/algorithms/robot/variable_roll.md.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.kinematics.robot_model import TURN_RAD, JointLimits
from rona_core.robot.redundancy.margins import MarginLimits, joint_limit_margin

LEAST_STRIDE = 0.05  # a repeated point still counts as a step of this length
EVERY_JOINT = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True)
class RollCost:
    """Weights of the objective, and how fast the roll may change.

    A *stride* is the length of a step along the path in mm, or its turn in degrees where that is
    more. Margins are those of ``MarginLimits``: they cost nothing from 1 upwards.
    """

    travel: float = 1.0  # per radian of joint travel, the root of the squares of all joints
    joint_weights: tuple[float, ...] = EVERY_JOINT  # of each joint in that root
    evenness: float = 5.0  # per squared radian and stride: many small steps, not one big one
    limits: float = 0.05  # per stride and joint at its limit, falling to 0 at margin 1
    singularities: float = 0.05  # per stride at the edge of a singularity, falling to 0 at margin 1
    roll_deg_per_mm: float = 10.0  # largest change of the roll, per mm of stride

    def __post_init__(self) -> None:
        for name in ("travel", "evenness", "limits", "singularities"):
            value = getattr(self, name)
            require(0.0 <= value <= 1e6, f"{name} must be 0 to 1e6, not {value}")
        require(self.travel + self.evenness > 0.0, "joint motion must cost something")
        weights = self.joint_weights
        require(
            len(weights) == 6 and all(0.0 < weight <= 1e3 for weight in weights),
            f"joint_weights must be six numbers above 0, not {weights}",
        )
        require(
            0.0 < self.roll_deg_per_mm <= 360.0,
            f"roll_deg_per_mm must be above 0 and at most 360, not {self.roll_deg_per_mm}",
        )

    def largest_roll_rad(self, strides: Floats) -> Floats:
        """Return the largest change of the roll (n - 1,) over steps of these strides."""
        return np.deg2rad(self.roll_deg_per_mm) * strides

    def motion(self, squares: Floats, strides: Floats) -> Floats:
        """Return the cost of steps whose weighted squared joint travel is ``squares``."""
        cost = self.travel * np.sqrt(squares)
        if self.evenness:
            cost += self.evenness * squares / np.maximum(strides, LEAST_STRIDE)
        return cost


@dataclass(frozen=True, slots=True)
class CostShares:
    """The cost of one path, by cause."""

    motion: float
    limits: float
    singularities: float

    @property
    def total(self) -> float:
        """Return the objective."""
        return self.motion + self.limits + self.singularities


def strides_of(path: Path5D) -> Floats:
    """Return the stride (n - 1,) of each step: mm, or degrees where the axis turns by more."""
    steps_mm, turns_rad = path.steps()
    return np.maximum(steps_mm, np.rad2deg(turns_rad))


def shares_of_points(strides: Floats) -> Floats:
    """Return the stride (n,) that each point stands for: half of either side."""
    half = strides / 2.0
    return np.concatenate((half, [0.0])) + np.concatenate(([0.0], half))


def limit_penalty(
    q_rad: Floats, limits: JointLimits, joint: int, margin_limits: MarginLimits, *, turning: bool
) -> Floats:
    """Return the penalty (...) of one joint: 1 at its limit, 0 from margin 1, at its best turn."""
    return hinge(joint_limit_margin(q_rad, limits, joint, margin_limits, turning=turning))


def hinge(margin: Floats) -> Floats:
    """Return the penalty of a margin: (1 - margin) squared below 1, 0 above."""
    return np.square(np.maximum(0.0, 1.0 - margin))


def turn_to_suit(
    qs_rad: Floats, limits: JointLimits, turning: Bools, margin_limits: MarginLimits
) -> tuple[Floats, Floats]:
    """Return a continuous joint path (n, 6) turned by whole turns, and its penalties (n, 6).

    Each joint that may turn is shifted as a whole to where it keeps its limits and its penalty is
    least; of equal ones, to where it has the largest margin.
    """
    qs, penalties = qs_rad.copy(), np.zeros_like(qs_rad)
    for joint in range(6):
        lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
        q = qs_rad[:, joint]
        if turning[joint]:
            first = round(float(((lower + upper) / 2.0 - q.mean()) / TURN_RAD))
            best = (-np.inf, -np.inf, -np.inf)
            for turns in range(first - 2, first + 3):
                moved = q + TURN_RAD * turns
                margin = float(np.minimum(moved - lower, upper - moved).min())
                penalty = limit_penalty(moved, limits, joint, margin_limits, turning=False).sum()
                score = (min(0.0, margin), -round(float(penalty), 9), margin)
                if score > best:
                    best, qs[:, joint] = score, moved
        penalties[:, joint] = limit_penalty(
            qs[:, joint], limits, joint, margin_limits, turning=False
        )
    return qs, penalties


def path_cost(
    qs_rad: Floats,
    penalties: Floats,
    singular: Floats,
    strides: Floats,
    cost: RollCost,
) -> CostShares:
    """Return the cost of a joint path.

    Args:
        qs_rad: Continuous joint angles (n, 6).
        penalties: Of each joint's limits (n, 6), as ``turn_to_suit`` gives them.
        singular: Room (n,) to singularities.
        strides: Stride (n - 1,) of each step.
        cost: The weights.
    """
    squares = np.square(np.diff(qs_rad, axis=0) * np.array(cost.joint_weights)).sum(axis=1)
    share = shares_of_points(strides)
    return CostShares(
        motion=float(cost.motion(squares, strides).sum()),
        limits=cost.limits * float(share @ penalties.sum(axis=1)),
        singularities=cost.singularities * float(share @ hinge(singular)),
    )


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
