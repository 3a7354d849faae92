"""The problem of a roll that varies along a path: postures, objective and what is blocked."""

from dataclasses import dataclass, field, replace

import numpy as np

from rona_core.devices.settings import require
from rona_core.geometry.arrays import Bools, Floats
from rona_core.robot.redundancy.cost import RollCost, strides_of
from rona_core.robot.redundancy.roll_grid import RollGrid


@dataclass(frozen=True, slots=True, eq=False)
class RollProblem:
    """What a varying roll is searched in: redundancy resolution along one path."""

    grid: RollGrid  # postures along the path, and what is allowed
    cost: RollCost  # the objective, and how fast the roll may change
    blocked: Bools | None = None  # (n, R, 8) postures that must not be used, as those that touch
    strides: Floats = field(init=False)  # (n - 1,) of each step along the path

    def __post_init__(self) -> None:
        require(
            self.blocked is None or self.blocked.shape == self.grid.shape,
            f"blocked must have shape {self.grid.shape}, not "
            f"{None if self.blocked is None else self.blocked.shape}",
        )
        object.__setattr__(self, "strides", strides_of(self.grid.path))

    def allowed(self) -> Bools:
        """Return which postures (8, R, n) are allowed by themselves."""
        allowed = self.grid.margins >= 0.0
        if self.blocked is not None:
            allowed &= ~self.blocked.transpose(2, 1, 0)
        return allowed

    def with_blocked(self, blocked: Bools) -> "RollProblem":
        """Return the problem with other postures blocked."""
        return replace(self, blocked=blocked)

    def copy_blocked(self) -> Bools:
        """Return a copy (n, R, 8) of what is blocked, to be added to."""
        if self.blocked is None:
            return np.zeros(self.grid.shape, dtype=np.bool_)
        return self.blocked.copy()
