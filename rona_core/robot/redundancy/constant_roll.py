"""Constant rolls of a working set on every branch: margins, verdicts, ranking and choice.

Each roll is followed along the whole path on each branch of the arm: reach, singularities, joint
limits, discontinuities (RONA, Section III.D and Figure 8).

Removal of constant rolls that the robot cannot drive although the arm alone could. On the path it
would touch something, the probe could not be retracted from one of its ends, or a motion that was
tried with the roll was refused.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rona_core.devices.limits import require
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import TURN_RAD, RobotModel, shift_to_fit
from rona_core.robot.redundancy.infeasibility import FailureCause, find_failure_cause, verdict_on
from rona_core.robot.redundancy.margins import (
    EVEN_DIGITS,
    MarginLimits,
    RollGrid,
    flange_parts,
    flange_poses,
    joint_limit_margin,
    roll_groups,
    solve_roll_grid,
)
from rona_core.robot.redundancy.result import Choice, RankedRoll, RollSearch, RollVerdict
from rona_core.robot.trajectory.scan_timing import (
    LEAST_STANDOFF_MM,
    clear_part,
    lines_back,
    require_standoff,
)

Pair = tuple[int, int]  # a roll, and a branch

FULL_TURN_DEG = 360.0
MAX_SHOWN = 240  # samples of each joint curve that are kept for drawing


def working_set_deg(n_rolls: int, roll_from_deg: float, roll_to_deg: float) -> Floats:
    """Return the working set V of rolls (n,), evenly spaced; a full turn ends before its start.

    Raises:
        InvalidInputError: no roll, or an empty or endless range.
    """
    require(1 <= n_rolls <= 3600, f"n_rolls must be 1 to 3600, not {n_rolls}")
    span = roll_to_deg - roll_from_deg
    require(
        bool(np.isfinite(span)) and 0.0 <= span <= FULL_TURN_DEG,
        f"rolls must run upwards over at most 360 degrees, not {roll_from_deg} to {roll_to_deg}",
    )
    whole = span > FULL_TURN_DEG - 1e-9
    return np.linspace(roll_from_deg, roll_to_deg, n_rolls, endpoint=not whole)


def choose_constant_roll(verdicts: tuple[RollVerdict, ...], choice: Choice) -> int:
    """Choose the feasible roll with the largest margin, or the first; -1 where none is feasible."""
    feasible = [i for i, verdict in enumerate(verdicts) if verdict.feasible]
    if choice == "first":
        return min(feasible, default=-1)
    return max(feasible, key=lambda i: verdicts[i].margin, default=-1)


@dataclass(frozen=True, slots=True, eq=False)
class FollowedRoll:
    """One constant roll on one branch along the path of n points."""

    qs_rad: Floats  # (6, n) continuous, turned so that they fit their limits
    margins: Floats  # (n,) with those of the steps


@dataclass(frozen=True, slots=True, eq=False)
class ConstantRolls:
    """The joint paths and margins of constant rolls; R rolls, n path points."""

    branch_margins: Floats  # (8, R) least margin along the path
    first_failures: Ints  # (8, R) path point that fails first; n where none does
    branches: Ints  # (R,) the branch with the largest margin, or the one that gets furthest
    margins: Floats  # (R, n) of that branch, with those of the steps
    qs_rad: Floats  # (6, R, n) that branch, continuous, turned so that it fits its limits
    node_margins: Floats  # (R, n) largest margin of any branch, without those of the steps
    others: Mapping[Pair, FollowedRoll]  # feasible rolls on their other branches

    def on_branch(self, roll: int, branch: int) -> FollowedRoll:
        """Return a roll on a branch on which it is feasible, or on the one that it is on."""
        if branch == self.branches[roll]:
            return FollowedRoll(self.qs_rad[:, roll], self.margins[roll])
        return self.others[roll, branch]


def follow_constant_rolls(grid: RollGrid) -> ConstantRolls:
    """Follow every roll of a grid on every branch along the whole path."""
    n_branches, count, n = grid.margins.shape
    margins = np.stack([constant_roll_margins(grid, branch) for branch in range(n_branches)])
    least = margins.min(axis=2)
    first = np.where(least < 0.0, (margins < 0.0).argmax(axis=2), n)
    branches = np.array([best_branch(least[:, i], first[:, i]) for i in range(count)], np.int64)
    rolls = np.arange(count)
    feasible_elsewhere = least >= 0.0
    feasible_elsewhere[branches, rolls] = False
    on, of = np.nonzero(feasible_elsewhere)
    curves = constant_roll_curves(grid, of, on)
    others = {
        (roll, branch): FollowedRoll(curves[:, i], margins[branch, roll])
        for i, (roll, branch) in enumerate(zip(of.tolist(), on.tolist(), strict=True))
    }
    return ConstantRolls(
        branch_margins=least,
        first_failures=first,
        branches=branches,
        margins=margins[branches, rolls],
        qs_rad=constant_roll_curves(grid, rolls, branches),
        node_margins=grid.margins.max(axis=0),
        others=others,
    )


def _joined(groups: Sequence[ConstantRolls]) -> ConstantRolls:
    """Return groups of rolls, one after the other, as one."""
    starts = np.cumsum([0, *(len(group.branches) for group in groups)]).tolist()
    return ConstantRolls(
        branch_margins=np.concatenate([group.branch_margins for group in groups], axis=1),
        first_failures=np.concatenate([group.first_failures for group in groups], axis=1),
        branches=np.concatenate([group.branches for group in groups]),
        margins=np.concatenate([group.margins for group in groups]),
        qs_rad=np.concatenate([group.qs_rad for group in groups], axis=1),
        node_margins=np.concatenate([group.node_margins for group in groups]),
        others={
            (start + roll, branch): followed
            for start, group in zip(starts[:-1], groups, strict=True)
            for (roll, branch), followed in group.others.items()
        },
    )


def constant_roll_curves(grid: RollGrid, rolls: Ints, branches: Ints) -> Floats:
    """Return the joints (6, k, n) along the path for rolls (k,) of a grid on branches (k,).

    They are continuous, and turned so that they fit their limits.
    """
    qs = np.ascontiguousarray(grid.qs_rad[branches, :, rolls].transpose(1, 0, 2))
    for joint in np.flatnonzero(grid.turning):
        lower, upper = float(grid.model.lower_rad[joint]), float(grid.model.upper_rad[joint])
        qs[joint] = shift_to_fit(np.unwrap(qs[joint]).T, lower, upper).T
    return qs


def constant_roll_margins(grid: RollGrid, branch: int) -> Floats:
    """Return the margins (R, n) of constant rolls on one branch, with jumps and whole turns.

    A joint that may make full turns is followed from its start; it has to fit as a whole.
    """
    limits, margin_limits = grid.model.limits, grid.margin_limits
    margins = grid.margins[branch].copy()
    widest = np.zeros((margins.shape[0], max(0, margins.shape[1] - 1)))
    for joint in range(6):
        q = grid.qs_rad[branch, joint]
        steps = np.diff(q, axis=1)
        if grid.turning[joint]:
            turns = np.round(steps / TURN_RAD)
            steps -= TURN_RAD * turns
            lower, upper = float(limits.lower_rad[joint]), float(limits.upper_rad[joint])
            shifted = shift_to_fit(_turned(q, turns).T, lower, upper).T
            limit = joint_limit_margin(shifted, limits, joint, margin_limits, turning=False)
            np.minimum(margins, limit, out=margins)
        np.maximum(widest, np.abs(steps, out=steps), out=widest)
    jump = (margin_limits.step_rad - widest) / margin_limits.step_unit_rad
    np.minimum(margins[:, 1:], jump, out=margins[:, 1:])
    # the first sample has no step that leads to it
    at_rest = margin_limits.step_rad / margin_limits.step_unit_rad
    return np.minimum(margins, at_rest, out=margins)


def _turned(angles_rad: Floats, turns: Floats) -> Floats:
    """Return angles (R, n) less the full turns (R, n - 1) that were made before them."""
    rows = np.flatnonzero(turns.any(axis=-1))
    result = angles_rad.copy()
    result[rows, 1:] -= TURN_RAD * np.cumsum(turns[rows], axis=-1)
    return result


def best_branch(margins: Floats, first: Ints) -> int:
    """Return the branch with the largest margin, or the one that gets furthest if all fail.

    Mirrored branches often have the same margin; then the first counts, not the last digit.

    Args:
        margins: Least margin (8,).
        first: Path point (8,) that fails first, the number of points where none does.
    """
    even = np.round(margins, EVEN_DIGITS)
    if even.max() >= 0.0:
        return int(np.argmax(even))
    return max(range(len(even)), key=lambda branch: (int(first[branch]), float(even[branch])))


@dataclass(frozen=True, slots=True, eq=False)
class RollEvaluation:
    """Everything known of constant rolls on one path; working memory of a search, never stored."""

    path: Path5D  # n dense points, in ``base``
    model: RobotModel
    margin_limits: MarginLimits
    rolls_rad: Floats  # (R,) ascending, evenly spaced
    rolls: ConstantRolls
    verdicts: tuple[RollVerdict, ...]
    ranked: tuple[RankedRoll, ...]  # feasible rolls and branches, largest margin first

    def grid(self, *, cancel: Cancel = never) -> RollGrid:
        """Return the postures of every roll on every branch, solved anew: they take much memory.

        Raises:
            CancelledError: ``cancel`` returned True.
        """
        return solve_roll_grid(
            self.path, self.model, self.rolls_rad, self.margin_limits, cancel=cancel
        )

    def search(self, varying: RollVerdict | None = None) -> RollSearch:
        """Return the search with every verdict, that on a varying roll too, and no roll chosen."""
        rolls, n = self.rolls, len(self.path)
        shown = np.unique(np.round(np.linspace(0, n - 1, MAX_SHOWN)).astype(np.int64))
        nodes = np.minimum.reduceat(rolls.node_margins, shown, axis=1).T
        return RollSearch(
            mode="none",
            verdicts=self.verdicts,
            ranked=self.ranked,
            varying=varying,
            chosen=-1,
            branch=-1,
            rolls_rad=readonly(np.zeros(n)),
            path=self.path,
            shown_points=readonly(shown),
            curves_rad=readonly(rolls.qs_rad[:, :, shown].transpose(1, 2, 0).astype(np.float32)),
            room=readonly(np.minimum.reduceat(rolls.margins, shown, axis=1).astype(np.float32)),
            node_room=readonly(nodes.astype(np.float32)),
            chosen_curve_rad=readonly(np.zeros((0, 6), dtype=np.float32)),
        )


def evaluate_constant_rolls(
    path: Path5D,
    model: RobotModel,
    rolls_deg: Floats,
    margin_limits: MarginLimits,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> RollEvaluation:
    """Evaluate constant rolls (R,) in degrees, ascending and evenly spaced, on every branch.

    The postures of a group of rolls at a time are held: of all they take some 100 MB on a long
    path.

    Raises:
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: ``cancel`` returned True.
    """
    rolls_rad = np.deg2rad(rolls_deg)
    groups = [
        follow_constant_rolls(solve_roll_grid(path, model, rolls_rad[group], margin_limits))
        for group in roll_groups(len(rolls_rad), len(path), progress, cancel)
    ]
    rolls = _joined(groups)
    pairs = np.argwhere(rolls.branch_margins.T >= 0.0).tolist()
    ranked = [RankedRoll(i, branch, float(rolls.branch_margins[branch, i])) for i, branch in pairs]
    ranked.sort(key=lambda pair: -round(pair.margin, EVEN_DIGITS))
    unjudged = RollEvaluation(path, model, margin_limits, rolls_rad, rolls, (), tuple(ranked))
    return replace(unjudged, verdicts=_verdicts(unjudged, rolls_deg))


def _verdicts(evaluation: RollEvaluation, rolls_deg: Floats) -> tuple[RollVerdict, ...]:
    """Return a verdict on each roll (R,) on its best branch."""
    rolls, model = evaluation.rolls, evaluation.model
    n, numbers, branches = len(evaluation.path), np.arange(len(rolls_deg)), rolls.branches
    first = rolls.first_failures[branches, numbers]
    parts = flange_parts(evaluation.path, model)[:, np.minimum(first, n - 1)]
    solutions = model.inverse(flange_poses(parts, evaluation.rolls_rad))
    tightest = np.argmin(np.round(rolls.margins, EVEN_DIGITS), axis=1)
    verdicts: list[RollVerdict] = []
    for i in numbers.tolist():
        branch, index, cause = int(branches[i]), int(tightest[i]), None
        if first[i] < n:
            index = int(first[i])
            q = rolls.qs_rad[:, i, index]
            step = q - rolls.qs_rad[:, i, max(0, index - 1)]
            cause = find_failure_cause(
                solutions, (i, branch), q, step, model.limits, evaluation.margin_limits
            )
        margin = float(rolls.branch_margins[branch, i])
        verdicts.append(verdict_on(float(rolls_deg[i]), branch, margin, index, n, cause))
    return tuple(verdicts)


CHECK_MM = 4.0  # of path from one check to the next; the verifier checks all, and in between

Cause = Callable[[], tuple[int, FailureCause]]  # path point and why


def remove_blocked_rolls(
    evaluation: RollEvaluation, world: CollisionWorld | None
) -> RollEvaluation:
    """Remove the constant rolls that obstacles rule out.

    A roll keeps the branch with the largest margin that touches nothing and from which the probe
    can be retracted at both ends of the path, as every scan has to. Where no branch will do, the
    verdict says why not.

    Args:
        evaluation: The rolls, as the arm alone allows them.
        world: The obstacles; None: only the retraction is checked.
    """
    last = len(evaluation.path) - 1
    stretches = np.floor(evaluation.path.arc_length_mm() / CHECK_MM)
    checked = np.unique(np.append(np.unique(stretches, return_index=True)[1], last))
    refused: dict[Pair, Cause] = {}
    free: dict[Pair, Floats] = {}  # that touch nothing: joint angles (2, 6) at both ends
    for pair in evaluation.ranked:
        curve = evaluation.rolls.on_branch(pair.index, pair.branch).qs_rad.T
        hit = -1 if world is None else world.first_hit(curve[checked])
        if world is not None and hit >= 0:
            place = int(checked[hit])
            refused[pair.index, pair.branch] = lambda q=curve[place], p=place, w=world: (
                p,
                _collision(q, w),
            )
        else:
            free[pair.index, pair.branch] = curve[[0, last]]
    clear = None if world is None else world.clear
    for end, place in enumerate((0, last)):
        starts = {pair: qs[end] for pair, qs in free.items() if pair not in refused}
        for pair, error in _not_retracted(evaluation.model, starts, clear).items():
            refused[pair] = lambda p=place, e=error: (p, no_way(str(e)))
    return remove_rolls(evaluation, refused)


def _not_retracted(
    model: RobotModel, starts: Mapping[Pair, Floats], clear: Clear | None
) -> dict[Pair, NotReachableError]:
    """Return the rolls with which the probe cannot be retracted from postures (6,), and why."""
    if not starts:
        return {}
    refused: dict[Pair, NotReachableError] = {}
    lines = lines_back(model, np.array(list(starts.values())), LEAST_STANDOFF_MM)
    for pair, line in zip(starts, lines, strict=True):
        try:
            require_standoff(clear_part(line, clear)[1])
        except NotReachableError as error:
            refused[pair] = error
    return refused


def remove_rolls(evaluation: RollEvaluation, refused: Mapping[Pair, Cause]) -> RollEvaluation:
    """Remove some rolls on some branches.

    A roll goes over to its next best branch; where it has none left, its verdict gives the cause
    that refused the best.
    """
    rolls, n = evaluation.rolls, len(evaluation.path)
    verdicts = list(evaluation.verdicts)
    ranked = tuple(p for p in evaluation.ranked if (p.index, p.branch) not in refused)
    qs, margins, branches = rolls.qs_rad.copy(), rolls.margins.copy(), rolls.branches.copy()
    for i in sorted({index for index, _ in refused}):
        verdict = verdicts[i]
        kept = next((pair for pair in ranked if pair.index == i), None)
        if kept is None:
            place, cause = refused[i, verdict.branch]()
            branch, margin = verdict.branch, verdict.margin
            verdicts[i] = verdict_on(verdict.roll_deg, branch, margin, place, n, cause)
        elif kept.branch != verdict.branch:
            followed = rolls.on_branch(i, kept.branch)
            branches[i], qs[:, i], margins[i] = kept.branch, followed.qs_rad, followed.margins
            worst = int(np.argmin(margins[i]))
            verdicts[i] = verdict_on(verdict.roll_deg, kept.branch, kept.margin, worst, n)
    return replace(
        evaluation,
        rolls=replace(rolls, qs_rad=qs, margins=margins, branches=branches),
        verdicts=tuple(verdicts),
        ranked=ranked,
    )


def no_way(words: str) -> FailureCause:
    """Return the failure cause of a missing way to the path or back, in words."""
    return FailureCause("no way", 0, 0.0, 0.0, "", words)


def _collision(q_rad: Floats, world: CollisionWorld) -> FailureCause:
    """Return what the robot touches at joint angles (6,)."""
    pair = world.report(q_rad[None]).closest_pair(0)
    words = (
        f"{pair.first} and {pair.second} are {pair.apart_mm:.1f} mm apart, "
        f"{pair.least_mm:.0f} mm are needed,"
    )
    return FailureCause("blocked", 0, pair.apart_mm, pair.least_mm, "mm", words)
