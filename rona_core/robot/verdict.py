"""Say in plain words what stops a roll first."""

import numpy as np

from rona_core.robot.model import RobotModel
from rona_core.robot.plan import Reason, RollVerdict
from rona_core.robot.room import EVEN_DIGITS, Room, RoomRules

Blame = tuple[int, float, float, str, str]  # joint, value, limit, unit, sentence


def describe(
    roll_deg: float, room: Room, branch: int, model: RobotModel, rules: RoomRules
) -> RollVerdict:
    """Return the verdict on one roll, judged on one branch."""
    least = room.least()[:, branch]
    margin = float(least.min())
    feasible = margin >= 0.0
    if feasible:
        index, reason = int(np.argmin(np.round(least, EVEN_DIGITS))), "none"
        sentence = f"roll {roll_deg:.4g}°: the whole path can be followed, least room {margin:.2f}"
        blame: Blame = (0, margin, 0.0, "", sentence)
    else:
        index = int(np.argmax(least < 0.0))
        reason = _first_reason(room, index, branch)
        blame = _BLAME[reason](room, index, branch, model, rules)
    joint, value, limit, unit, sentence = blame
    if not feasible:
        sentence = f"roll {roll_deg:.4g}°: {sentence} at path point {index} of {len(least)}"
    return RollVerdict(
        roll_deg=roll_deg,
        feasible=feasible,
        branch=branch,
        margin=margin,
        reason=reason,
        index=index,
        joint=joint,
        value=float(value),
        limit=float(limit),
        unit=unit,
        sentence=sentence,
    )


def _first_reason(room: Room, index: int, branch: int) -> Reason:
    if room.reach[index, branch] < 0.0:
        return "reach"
    if room.singularity[index, branch] < 0.0:
        return "singularity"
    return "limit" if room.limit[index, branch] < 0.0 else "jump"


def _reach(room: Room, index: int, branch: int, model: RobotModel, rules: RoomRules) -> Blame:
    outside_mm = -room.reach[index, branch] * rules.reach_unit_mm
    sentence = f"the wrist would have to be {outside_mm:.0f} mm outside the reach of the arm"
    return 0, -outside_mm, 0.0, "mm", sentence


def _singularity(room: Room, index: int, branch: int, model: RobotModel, rules: RoomRules) -> Blame:
    q = room.qs_rad[index, branch]
    out_mm = float(model.inverse(model.forward(q[None])).wrist_distance_mm[0])
    elbow_deg, wrist_deg = (float(np.rad2deg(np.arcsin(abs(np.sin(q[j]))))) for j in (2, 4))
    limit_deg = float(np.rad2deg(rules.singular_rad))
    if elbow_deg < limit_deg:
        return (
            3,
            elbow_deg,
            limit_deg,
            "deg",
            f"the elbow is {elbow_deg:.1f}° from straight, {limit_deg:.0f}° are needed",
        )
    if wrist_deg < limit_deg:
        return (
            5,
            wrist_deg,
            limit_deg,
            "deg",
            f"joint 5 is {wrist_deg:.1f}° from straight, {limit_deg:.0f}° are needed",
        )
    sentence = f"the wrist is {out_mm:.0f} mm from axis 1, {rules.shoulder_mm:.0f} mm are needed"
    return 1, out_mm, rules.shoulder_mm, "mm", sentence


def _limit(room: Room, index: int, branch: int, model: RobotModel, rules: RoomRules) -> Blame:
    q = room.qs_rad[index, branch]
    joint = int(np.argmin(model.limits.clearance_rad(q)))
    bound = model.lower_rad[joint] if q[joint] < model.lower_rad[joint] else model.upper_rad[joint]
    value_deg, limit_deg = float(np.rad2deg(q[joint])), float(np.rad2deg(bound))
    sentence = f"joint {joint + 1} would be at {value_deg:.1f}°, its limit is {limit_deg:.1f}°"
    return joint + 1, value_deg, limit_deg, "deg", sentence


def _jump(room: Room, index: int, branch: int, model: RobotModel, rules: RoomRules) -> Blame:
    steps = np.abs(room.qs_rad[index, branch] - room.qs_rad[index - 1, branch])
    joint = int(np.argmax(steps))
    value_deg, limit_deg = float(np.rad2deg(steps[joint])), float(np.rad2deg(rules.step_rad))
    sentence = f"joint {joint + 1} would jump by {value_deg:.1f}°, {limit_deg:.0f}° are allowed"
    return joint + 1, value_deg, limit_deg, "deg", sentence


_BLAME = {"reach": _reach, "singularity": _singularity, "limit": _limit, "jump": _jump}
