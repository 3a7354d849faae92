"""What the verifier says of one motion: its checks, and the digest that ties it to that motion."""

from dataclasses import dataclass

from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import TimedMotion, motion_digest
from rona_core.robot.verification.robot_digest import robot_digest
from rona_core.robot.verification.tolerances import (
    CuttingTolerances,
    Tolerances,
    tolerances_digest,
)

OF_EVERY_MOTION = Tolerances()


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
    """The verifier's word on one motion of one robot; worth nothing for any other."""

    model: str  # name of the robot, for people
    certified: bool
    checks: tuple[Check, ...]
    digest: str  # of robot, motion, what stood around and what was insisted on
    robot: str  # digest of the robot
    tolerances: str  # digest of what the verifier insisted on
    obstacles: str = ""  # digest of what stood around; "" where that was not looked at
    min_clearance_mm: float | None = None  # least distance of any parts that must not touch

    def belongs_to(self, motion: TimedMotion) -> bool:
        """Return whether this is the motion that was looked at, and everything held.

        That is not enough to drive it: see ``certifies``.
        """
        digest = motion_digest(
            self.robot, motion.times_s, motion.qs_rad, self.obstacles, self.tolerances
        )
        return self.certified and self.digest == digest

    def certifies(
        self,
        motion: TimedMotion,
        model: RobotModel,
        obstacles: Obstacles,
        insisted: Tolerances | CuttingTolerances = OF_EVERY_MOTION,
    ) -> bool:
        """Return whether this robot may drive this motion among these things; see ``refusal``."""
        return self.refusal(motion, model, obstacles, insisted) is None

    def refusal(
        self,
        motion: TimedMotion,
        model: RobotModel,
        obstacles: Obstacles,
        insisted: Tolerances | CuttingTolerances = OF_EVERY_MOTION,
    ) -> str | None:
        """Return why a robot may not drive a motion, and what to do; None where it may.

        Args:
            motion: The motion.
            model: The robot that is to drive it, with the tool that it holds.
            obstacles: What stands around it.
            insisted: What the verifier insists on in such a motion.
        """
        if failures := self.failures():
            return "; ".join(check.sentence for check in failures)
        superseded = self.superseded(model, insisted)
        if superseded is not None:
            return superseded
        if self.obstacles != obstacles.digest():
            return "the plan was verified among other obstacles: plan again"
        if not self.belongs_to(motion):
            return "the plan was verified for another motion: plan again"
        return None

    def superseded(
        self, model: RobotModel, insisted: Tolerances | CuttingTolerances = OF_EVERY_MOTION
    ) -> str | None:
        """Return what to do where a motion was verified for another robot or other tolerances."""
        if self.robot != robot_digest(model):
            return (
                f"the plan was verified for another robot than this {model.name} (its lengths, "
                "limits, tool, bodies or pairs of bodies differ): plan again"
            )
        if self.tolerances != tolerances_digest(insisted):
            return (
                "the plan was verified with other tolerances than this version insists on in such "
                "a motion: plan again"
            )
        return None

    def failures(self) -> tuple[Check, ...]:
        """Return what did not hold."""
        return tuple(check for check in self.checks if not check.holds)


def is_certified(motion: TimedMotion | None, certificate: Certificate | None) -> bool:
    """Return whether there is a motion, and a certificate of it in which everything held."""
    return motion is not None and certificate is not None and certificate.belongs_to(motion)
