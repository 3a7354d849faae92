"""A planned scan: the roll search, the timed trajectory and its certificate."""

from dataclasses import dataclass, field

from rona_core.robot.redundancy.result import RollSearch, RollVerdict
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.certificate import Certificate, is_certified


@dataclass(frozen=True, slots=True, eq=False)
class RobotPlan:
    """How the robot follows a scan path: a roll search, its roll timed and verified."""

    model: str  # name of the robot
    search: RollSearch = field(metadata={"flatten": True})  # files hold its fields among these
    trajectory: Trajectory | None = None  # None: no roll will do, or it was not timed
    certificate: Certificate | None = None

    @property
    def verdict(self) -> RollVerdict | None:
        """The verdict on the chosen roll, constant or varying; None where none will do."""
        return self.search.verdict

    @property
    def may_move(self) -> bool:
        """Whether there is a trajectory and its certificate stands."""
        return is_certified(self.trajectory, self.certificate)
