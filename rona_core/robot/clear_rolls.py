"""Take constant rolls out of the choice with which the robot would touch something on its path."""

from dataclasses import replace

import numpy as np

from rona_core.arrays import Floats, Ints
from rona_core.robot.collision import CollisionWorld
from rona_core.robot.judged_rolls import JudgedRolls
from rona_core.robot.plan import RankedRoll, RollVerdict
from rona_core.robot.roll_search import joint_path
from rona_core.robot.roll_sweep import column_room
from rona_core.robot.verdict import Blame, failing, passing

EVERY = 4  # path points between two looks; the verifier looks at all, and in between


def clear_of(judged: JudgedRolls, world: CollisionWorld) -> JudgedRolls:
    """Return what is known of constant rolls with what stands around taken into account.

    A roll keeps the branch with the most room that touches nothing. Where every branch touches
    something the verdict says what, and where first.
    """
    swept = judged.swept
    at = np.unique(np.append(np.arange(0, len(judged.path), EVERY), len(judged.path) - 1))
    verdicts, ranked = list(judged.verdicts), list(judged.ranked)
    qs, least, branches = swept.qs_rad.copy(), swept.least.copy(), swept.branches.copy()
    for i in sorted({pair.index for pair in judged.ranked}):
        kept: RankedRoll | None = None
        for pair in [pair for pair in judged.ranked if pair.index == i]:
            curve = _curve(judged, pair)
            if not bool(world.clear(curve[at]).all()):
                ranked.remove(pair)
            elif kept is None:
                kept = pair
                qs[:, i] = curve.T
        if kept is None:
            verdicts[i] = _blocked(judged, i, at, world)
        elif kept.branch != judged.verdicts[i].branch:
            room = column_room(judged.grid, kept.branch, judged.model.limits, judged.rules)[i]
            least[i], branches[i] = room, kept.branch
            roll_deg = judged.verdicts[i].roll_deg
            verdicts[i] = passing(
                f"roll {roll_deg:.4g}°", roll_deg, kept.branch, kept.margin, int(np.argmin(room))
            )
    return replace(
        judged,
        swept=replace(swept, qs_rad=qs, least=least, branches=branches),
        verdicts=tuple(verdicts),
        ranked=tuple(ranked),
    )


def _curve(judged: JudgedRolls, pair: RankedRoll) -> Floats:
    """Return the joints (n, 6) along the path with one roll on one branch."""
    if pair.branch == judged.swept.branches[pair.index]:
        return judged.swept.qs_rad[:, pair.index].T
    roll_rad = float(np.deg2rad(judged.verdicts[pair.index].roll_deg))
    return joint_path(judged.path, judged.model, roll_rad, pair.branch, judged.rules)


def _blocked(judged: JudgedRolls, i: int, at: Ints, world: CollisionWorld) -> RollVerdict:
    """Return the verdict on a roll that touches something on its best branch."""
    verdict = judged.verdicts[i]
    report = world.report(judged.swept.qs_rad[:, i, at].T)
    hit = max(0, report.first_hit)
    pair = int(report.closest[hit])
    wanted = float(report.least_mm[pair])
    apart = wanted + float(report.room_mm[hit])
    first, second = report.names[pair]
    words = f"{first} and {second} are {apart:.1f} mm apart, {wanted:.0f} mm are needed,"
    blame = Blame("blocked", 0, apart, wanted, "mm", words)
    name = f"roll {verdict.roll_deg:.4g}°"
    n = len(judged.path)
    return failing(name, verdict.roll_deg, verdict.branch, verdict.margin, int(at[hit]), n, blame)
