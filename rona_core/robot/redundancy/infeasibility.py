"""Verdicts on rolls, and the failure cause of a posture that is not allowed."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.robot.kinematics.arm import IkSolutions
from rona_core.robot.kinematics.joint_limits import JointLimits
from rona_core.robot.redundancy.margins import ROUNDED_MM, MarginLimits
from rona_core.robot.redundancy.result import Reason, RollVerdict


@dataclass(frozen=True, slots=True, eq=False)
class Posture:
    """The arm at the path point that fails, and the step that leads there."""

    q_rad: Floats  # (6,)
    step_rad: Floats  # (6,) from the path point before
    valid: bool  # the pose can be reached
    reach_mm: float
    sin_elbow: float
    sin_wrist: float
    wrist_distance_mm: float


@dataclass(frozen=True, slots=True)
class FailureCause:
    """Why a posture fails: the joint (1 to 6, 0 for none), its value and what is allowed."""

    reason: Reason
    joint: int
    value: float
    limit: float
    unit: str
    words: str


def posture_at(
    solutions: IkSolutions, index: int, branch: int, q_rad: Floats, step_rad: Floats
) -> Posture:
    """Return one of the solved poses on one branch, with its continuous joint angles."""
    return Posture(
        q_rad=q_rad,
        step_rad=step_rad,
        valid=bool(solutions.valid[index, branch]),
        reach_mm=float(solutions.reaches_mm[index, branch]),
        sin_elbow=float(solutions.sin_elbows[index, branch]),
        sin_wrist=float(solutions.sin_wrist[index, branch]),
        wrist_distance_mm=float(solutions.wrist_distance_mm[index]),
    )


def feasible_verdict(
    name: str, roll_deg: float, branch: int, margin: float, index: int
) -> RollVerdict:
    """Return the verdict on a roll with which the whole path can be followed."""
    return RollVerdict(
        roll_deg=roll_deg,
        feasible=True,
        branch=branch,
        margin=margin,
        reason="none",
        index=index,
        joint=0,
        value=margin,
        limit=0.0,
        unit="",
        sentence=f"{name}: the whole path can be followed, least room {margin:.2f}",
    )


def infeasible_verdict(
    name: str, roll_deg: float, branch: int, margin: float, index: int, n: int, cause: FailureCause
) -> RollVerdict:
    """Return the verdict on a roll that fails first at one of n path points."""
    return RollVerdict(
        roll_deg=roll_deg,
        feasible=False,
        branch=branch,
        margin=margin,
        reason=cause.reason,
        index=index,
        joint=cause.joint,
        value=cause.value,
        limit=cause.limit,
        unit=cause.unit,
        sentence=f"{name}: {cause.words} at path point {index} of {n}",
    )


def find_failure_cause(
    posture: Posture, limits: JointLimits, margin_limits: MarginLimits
) -> FailureCause:
    """Find why a posture fails: reach, then singularities, then limits, then a jump."""
    if not posture.valid:
        return _reach(posture)
    return (
        _singularity(posture, margin_limits)
        or _limit(posture, limits)
        or _jump(posture, margin_limits)
    )


def _reach(posture: Posture) -> FailureCause:
    outside_mm = max(ROUNDED_MM, -posture.reach_mm)
    words = f"the wrist would have to be {outside_mm:.3g} mm outside the reach of the arm"
    return FailureCause("reach", 0, -outside_mm, 0.0, "mm", words)


def _singularity(posture: Posture, margin_limits: MarginLimits) -> FailureCause | None:
    least_deg = float(np.rad2deg(margin_limits.singular_rad))
    for joint, name, sine in (
        (3, "the elbow", posture.sin_elbow),
        (5, "joint 5", posture.sin_wrist),
    ):
        if sine < np.sin(margin_limits.singular_rad):
            angle_deg = float(np.rad2deg(np.arcsin(min(1.0, sine))))
            words = f"{name} is {angle_deg:.1f}° from straight, {least_deg:.0f}° are needed"
            return FailureCause("singularity", joint, angle_deg, least_deg, "deg", words)
    out_mm = posture.wrist_distance_mm
    if out_mm >= margin_limits.shoulder_mm:
        return None
    words = (
        f"the wrist is {out_mm:.0f} mm from axis 1, {margin_limits.shoulder_mm:.0f} mm are needed"
    )
    return FailureCause("singularity", 1, out_mm, margin_limits.shoulder_mm, "mm", words)


def _limit(posture: Posture, limits: JointLimits) -> FailureCause | None:
    q, clearance = posture.q_rad, limits.clearance_rad(posture.q_rad)
    joint = int(np.argmin(clearance))
    if clearance[joint] >= 0.0:
        return None
    below = q[joint] < limits.lower_rad[joint]
    bound = limits.lower_rad[joint] if below else limits.upper_rad[joint]
    value_deg, limit_deg = float(np.rad2deg(q[joint])), float(np.rad2deg(bound))
    words = f"joint {joint + 1} would be at {value_deg:.1f}°, its limit is {limit_deg:.1f}°"
    return FailureCause("limit", joint + 1, value_deg, limit_deg, "deg", words)


def _jump(posture: Posture, margin_limits: MarginLimits) -> FailureCause:
    steps = np.abs(posture.step_rad)
    joint = int(np.argmax(steps))
    value_deg, limit_deg = (
        float(np.rad2deg(steps[joint])),
        float(np.rad2deg(margin_limits.step_rad)),
    )
    words = f"joint {joint + 1} would jump by {value_deg:.1f}°, {limit_deg:.0f}° are allowed"
    return FailureCause("jump", joint + 1, value_deg, limit_deg, "deg", words)
