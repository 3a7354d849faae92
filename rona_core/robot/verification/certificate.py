"""What the verifier says of one motion: its checks, and the digest that ties it to that motion."""

from dataclasses import dataclass

from rona_core.robot.trajectory.trajectory import TimedMotion, motion_digest


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
    """The verifier's word on one motion of one robot; worth nothing for any other motion."""

    model: str
    certified: bool
    checks: tuple[Check, ...]
    digest: str  # of the motion, the name of the robot and what stood around
    obstacles: str = ""  # digest of what stood around; "" where collisions were not looked at
    min_clearance_mm: float | None = None  # least distance of any parts that must not touch

    def certifies(self, motion: TimedMotion, obstacles: str | None = None) -> bool:
        """Return whether this is the motion that was looked at, and everything held.

        With the digest of what stands around now it must also have been looked at among that.
        """
        if obstacles is not None and self.obstacles != obstacles:
            return False
        digest = motion_digest(self.model, motion.times_s, motion.qs_rad, self.obstacles)
        return self.certified and self.digest == digest

    def failures(self) -> tuple[Check, ...]:
        """Return what did not hold."""
        return tuple(check for check in self.checks if not check.holds)


def is_certified(motion: TimedMotion | None, certificate: Certificate | None) -> bool:
    """Return whether there is a motion, and a certificate of it in which everything held."""
    return motion is not None and certificate is not None and certificate.certifies(motion)
