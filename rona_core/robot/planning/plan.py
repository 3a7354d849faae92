"""What planning a scan results in: verdicts on all rolls, a timed trajectory, its certificate."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.path5d import Path5D
from rona_core.robot.redundancy.result import Mode, RankedRoll, RollVerdict, spread_deg
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.certificate import Certificate


@dataclass(frozen=True, slots=True, eq=False)
class RobotPlan:
    """How the robot follows a scan path: the roll search, the chosen roll, timed and verified."""

    model: str
    mode: Mode
    verdicts: tuple[RollVerdict, ...]  # this and all below up to the curve as in RollSearch
    ranked: tuple[RankedRoll, ...]
    varying: RollVerdict | None
    chosen: int
    branch: int
    rolls_rad: Floats
    path: Path5D
    shown_points: Ints
    curves_rad: NDArray[np.float32]
    room: NDArray[np.float32]
    node_room: NDArray[np.float32]
    chosen_curve_rad: NDArray[np.float32]
    trajectory: Trajectory | None
    certificate: Certificate | None

    @property
    def n_feasible(self) -> int:
        """Number of constant rolls with which the whole path can be followed."""
        return sum(verdict.feasible for verdict in self.verdicts)

    @property
    def roll_variation_deg(self) -> float:
        """Largest less smallest roll of the chosen one along the path; 0 if it is constant."""
        return spread_deg(self.rolls_rad)

    @property
    def verdict(self) -> RollVerdict | None:
        """The verdict on the chosen roll, constant or varying; None where none will do."""
        if self.mode == "variable":
            return self.varying
        return self.verdicts[self.chosen] if self.mode == "constant" else None

    @property
    def refused(self) -> RollVerdict | None:
        """The verdict with the most room of those that have no way to the path or back, if any."""
        refused = [verdict for verdict in self.verdicts if verdict.reason == "no way"]
        return max(refused, key=lambda verdict: verdict.margin, default=None)

    @property
    def may_move(self) -> bool:
        """Whether there is a trajectory and its certificate stands."""
        return (
            self.trajectory is not None
            and self.certificate is not None
            and self.certificate.certifies(self.trajectory)
        )
