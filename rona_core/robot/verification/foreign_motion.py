"""Verification of a motion that was planned elsewhere: by the same checks as one's own.

What is driven between the samples is stated, see ``verification.joint_motion``. Where it is linear
the samples are verified as they are, so that a motion of one's own has the certificate it had.
"""

import re
from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.verification.certificate import Certificate, Check
from rona_core.robot.verification.joint_motion import (
    DrivenMotion,
    Interpolation,
    JointMotion,
    driven,
)
from rona_core.robot.verification.motion_checks import DenseMotion, singular_checks
from rona_core.robot.verification.tolerances import SHORTEST_S, Tolerances, tolerances_digest
from rona_core.robot.verification.verifier import certify

SAID = re.compile(r"at sample \d+(.*?), (at least|at most)")  # in the sentence of a check
DEGREES_RAD = 4.0 * np.pi  # angles beyond that are hardly radians


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at: its worst value, and where in the file that is."""

    check: Check
    sample: float  # of the file, from 0, with a fraction between samples
    time_s: float
    q_deg: tuple[float, ...]  # (6,) the posture there
    joint: int | None  # from 1, where one joint is the worst

    @property
    def sentence(self) -> str:
        """What was found, where and when, what is allowed, and the posture."""
        one, said = self.check, SAID.search(self.check.sentence)
        parts, relation = said.groups() if said else ("", "at most")
        at = f"sample {self.sample:.2f}".rstrip("0").rstrip(".")
        joint = "" if self.joint is None else f"joint {self.joint}, "
        posture = ", ".join(f"{angle:.1f}" for angle in self.q_deg)
        return (
            f"{one.name} {'holds' if one.holds else 'fails'}: {joint}{one.value:.4g} {one.unit} at "
            f"{at} ({self.time_s:.3f} s){parts}, {relation} {one.limit:.4g} {one.unit} is allowed; "
            f"joints at {posture}°"
        )


@dataclass(frozen=True, slots=True, eq=False)
class ForeignVerdict:
    """What the verifier says of a motion from elsewhere."""

    certificate: Certificate
    driven: DrivenMotion
    interpolation: Interpolation
    findings: tuple[Finding, ...]  # all that was looked at
    not_demanded: tuple[Finding, ...]  # what is only looked at
    hints: tuple[str, ...]  # what may be wrong with the file

    def refused(self) -> tuple[Finding, ...]:
        """Return what does not hold."""
        return tuple(one for one in self.findings if not one.check.holds)


def verify_foreign(
    model: RobotModel,
    motion: JointMotion,
    interpolation: Interpolation | None = None,
    obstacles: Obstacles = NOTHING_AROUND,
    tolerances: Tolerances | None = None,
    *,
    demand_singular: bool = False,
) -> ForeignVerdict:
    """Certify a motion that was planned elsewhere, from rest to rest.

    Args:
        model: The robot with its tool.
        motion: As it was read.
        interpolation: What is driven between the samples; None: as ROS joins what they state.
        obstacles: What stands around; by default nothing, the robot is held against itself alone.
        tolerances: What to insist on.
        demand_singular: Whether the distance to singular postures is demanded as on a scan path.

    Raises:
        InvalidInputError: the samples do not state what the interpolation needs.
    """
    allowed = tolerances or Tolerances()
    kind = interpolation or motion.stated()
    in_order = bool((np.diff(motion.times_s) >= SHORTEST_S).all())
    way = driven(motion, kind if in_order else "linear")  # else only the order is looked at
    margins: list[Check] = []

    def task_checks(dense: DenseMotion) -> list[Check]:
        found = singular_checks(dense.arm, dense.qs_rad, 0, allowed)
        margins.extend(found)
        return found if demand_singular else []

    insisted = tolerances_digest(allowed) + (" singular" if demand_singular else "")
    certificate = certify(model, way, allowed, insisted, obstacles, task_checks)
    findings = tuple(_found(one, model, way) for one in certificate.checks)
    margins_found = () if demand_singular else tuple(_found(one, model, way) for one in margins)
    return ForeignVerdict(
        certificate, way, kind, findings, margins_found, _hints(motion, kind, findings)
    )


def _found(one: Check, model: RobotModel, way: DrivenMotion) -> Finding:
    row = min(one.index, len(way.times_s) - 1)
    return Finding(
        check=one,
        sample=round(float(way.numbers[row]), 3),
        time_s=float(way.times_s[row]),
        q_deg=tuple(np.rad2deg(way.qs_rad[row]).tolist()),
        joint=_joint(one.name, model, way, row),
    )


def _joint(name: str, model: RobotModel, way: DrivenMotion, row: int) -> int | None:
    """Return which joint (from 1) a check of the joints is about, at its worst place."""
    q, times = way.qs_rad, way.times_s
    before, after = max(row - 1, 0), min(row + 1, len(q) - 1)
    worst: Floats
    if name == "margin to the joint limits":
        worst = -model.limits.clearance_rad(q[row])
    elif name == "joint step":
        worst = np.abs(q[row] - q[before])
    elif name == "joint speed":
        worst = np.abs(q[row] - q[before]) / model.speed_rad_per_s
    elif name == "joint acceleration":
        come = (q[row] - q[before]) / max(times[row] - times[before], SHORTEST_S)
        go = (q[after] - q[row]) / max(times[after] - times[row], SHORTEST_S)
        worst = np.abs(go - come) / model.acceleration_rad_per_s2
    else:
        return None
    return int(np.argmax(worst)) + 1


def _hints(
    motion: JointMotion, kind: Interpolation, findings: tuple[Finding, ...]
) -> tuple[str, ...]:
    """Return what may be wrong with the file, where something does not hold."""
    failed = {one.check.name for one in findings if not one.check.holds}
    hints: list[str] = []
    if "margin to the joint limits" in failed and np.abs(motion.qs_rad).max() > DEGREES_RAD:
        hints.append(
            f"joint angles reach {np.abs(motion.qs_rad).max():.0f} rad: if they are degrees, name "
            "the columns q1_deg to q6_deg"
        )
    if "bend between samples" in failed and kind == "linear":
        hints.append(
            "the samples lie so far apart that linear moves between them turn corners: write "
            "more, or state speeds (and accelerations) and the curve that the controller drives"
        )
    return tuple(hints)
