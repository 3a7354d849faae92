"""Removal of constant rolls that the robot cannot drive although the arm alone could.

On the path it would touch something, the probe could not be retracted from one of its ends, or a
motion that was tried with the roll was refused.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.constant_roll import Pair, RollEvaluation
from rona_core.robot.redundancy.infeasibility import FailureCause, verdict_on
from rona_core.robot.trajectory.lines_back import (
    LEAST_STANDOFF_MM,
    clear_part,
    lines_back,
    require_standoff,
)

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
