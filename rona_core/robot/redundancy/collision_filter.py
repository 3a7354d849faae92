"""Take constant rolls out of the choice that the robot cannot drive: something is in the way.

On the path it would touch something, the probe could not be drawn back from one of its ends, or a
motion that was tried with the roll was refused.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Floats, Ints
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.redundancy.choice import joint_path
from rona_core.robot.redundancy.constant_roll import column_room
from rona_core.robot.redundancy.evaluate_rolls import JudgedRolls
from rona_core.robot.redundancy.infeasibility import Blame, failing, passing
from rona_core.robot.redundancy.result import RankedRoll
from rona_core.robot.trajectory.scan_timing import LEAST_STANDOFF_MM, line_back

EVERY = 4  # path points between two looks; the verifier looks at all, and in between

Pair = tuple[int, int]  # roll, branch
Cause = Callable[[], tuple[int, Blame]]  # path point and what is to blame


def clear_of(judged: JudgedRolls, world: CollisionWorld | None) -> JudgedRolls:
    """Return what is known of constant rolls with what stands around taken into account.

    A roll keeps the branch with the most room that touches nothing and from which the probe can be
    drawn back at both ends of the path, as every scan has to. Where no branch will do, the verdict
    says why not.

    Args:
        judged: The rolls, as the arm alone allows them.
        world: What stands around; None: nothing is looked at but the drawing back.
    """
    last = len(judged.path) - 1
    at = np.unique(np.append(np.arange(0, last + 1, EVERY), last))
    refused: dict[Pair, Cause] = {}
    for pair in judged.ranked:
        curve = _curve(judged, pair)
        if world is not None and not bool(world.clear(curve[at]).all()):
            refused[pair.index, pair.branch] = lambda qs=curve[at], w=world: _touch(qs, at, w)
            continue
        for end in (0, last):
            try:
                line_back(
                    judged.model,
                    curve[end],
                    pair.branch,
                    LEAST_STANDOFF_MM,
                    None if world is None else world.clear,
                )
            except NotReachableError as error:
                refused[pair.index, pair.branch] = lambda end=end, e=error: (end, no_way(str(e)))
                break
    return without(judged, refused)


def without(judged: JudgedRolls, refused: Mapping[Pair, Cause]) -> JudgedRolls:
    """Return what is known of constant rolls where some rolls cannot be driven on some branches.

    A roll goes over to its next best branch; where it has none left, its verdict says what became
    of the best.
    """
    swept, n = judged.swept, len(judged.path)
    verdicts = list(judged.verdicts)
    ranked = tuple(p for p in judged.ranked if (p.index, p.branch) not in refused)
    qs, least, branches = swept.qs_rad.copy(), swept.least.copy(), swept.branches.copy()
    for i in sorted({index for index, _ in refused}):
        verdict = verdicts[i]
        name = f"roll {verdict.roll_deg:.4g}°"
        kept = next((pair for pair in ranked if pair.index == i), None)
        if kept is None:
            place, cause = refused[i, verdict.branch]()
            branch, margin = verdict.branch, verdict.margin
            verdicts[i] = failing(name, verdict.roll_deg, branch, margin, place, n, cause)
            if cause.reason == "no way":
                verdicts[i] = replace(verdicts[i], sentence=f"{name}: {cause.words}")
        elif kept.branch != verdict.branch:
            room = column_room(judged.grid, kept.branch, judged.model.limits, judged.rules)[i]
            least[i], branches[i], qs[:, i] = room, kept.branch, _curve(judged, kept).T
            worst = int(np.argmin(room))
            verdicts[i] = passing(name, verdict.roll_deg, kept.branch, kept.margin, worst)
    return replace(
        judged,
        swept=replace(swept, qs_rad=qs, least=least, branches=branches),
        verdicts=tuple(verdicts),
        ranked=ranked,
    )


def no_way(words: str) -> Blame:
    """Blame what stops the way to the path or back, in words."""
    return Blame("no way", 0, 0.0, 0.0, "", words)


def _curve(judged: JudgedRolls, pair: RankedRoll) -> Floats:
    """Return the joints (n, 6) along the path with one roll on one branch."""
    if pair.branch == judged.swept.branches[pair.index]:
        return judged.swept.qs_rad[:, pair.index].T
    roll_rad = float(np.deg2rad(judged.verdicts[pair.index].roll_deg))
    return joint_path(judged.path, judged.model, roll_rad, pair.branch, judged.rules)


def _touch(qs_rad: Floats, at: Ints, world: CollisionWorld) -> tuple[int, Blame]:
    """Return where the robot first touches something at path points (k,), and what."""
    report = world.report(qs_rad)
    hit = max(0, report.first_hit)
    pair = int(report.closest[hit])
    wanted = float(report.least_mm[pair])
    apart = wanted + float(report.room_mm[hit])
    first, second = report.names[pair]
    words = f"{first} and {second} are {apart:.1f} mm apart, {wanted:.0f} mm are needed,"
    return int(at[hit]), Blame("blocked", 0, apart, wanted, "mm", words)
