"""A certified motion as it goes out: for which robot, and the digests of motion and certificate."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import TimedMotion, motion_digest
from rona_core.robot.verification.certificate import Certificate

CAUTION = "Check it at reduced speed, without a burr and without a patient; no medical device."


@dataclass(frozen=True, slots=True)
class Pause:
    """A time at which the motion stands still and waits for a confirmation."""

    time_s: float
    words: str  # what is to be done, plain letters


@dataclass(frozen=True, slots=True, eq=False)
class CertifiedMotion:
    """A motion, linear between its samples, with what a file says of it."""

    model: RobotModel
    motion: TimedMotion
    certificate: Certificate
    name: str  # what it does, letters and underscores
    columns: Mapping[str, Sequence[object]] = field(default_factory=dict)  # (n,) more of a table
    pauses: Sequence[Pause] = ()  # of a program; at each the motion must stand still

    def digests(self) -> dict[str, str]:
        """Return name and digest (SHA-256) of motion, certificate and robot."""
        motion = self.motion
        return {
            "motion": motion_digest("", motion.times_s, motion.qs_rad),
            "certificate": self.certificate.digest,
            "robot": self.certificate.robot,
        }

    def lines(self) -> tuple[str, ...]:
        """Return lines for the head of a file of text, without signs of a comment."""
        last_s = float(self.motion.times_s[-1])
        return (
            f"Motion {self.name} of a {self.model.name} by RONA, {last_s:.2f} s, certified.",
            "Linear in the joints between samples, from rest to rest.",
            CAUTION,
            *(f"{name} sha256 {digest}" for name, digest in self.digests().items()),
        )
