"""Where the figures of a robot come from, as rows for people."""

from dataclasses import dataclass
from functools import lru_cache

from rona_core.robot.kinematics.catalog import figures_of


@dataclass(frozen=True, slots=True)
class RobotFigure:
    """One figure of a robot and its origin."""

    name: str
    key: str  # by which it is overridden; empty where only another description file can
    values: tuple[float, ...]
    unit: str
    trust: str
    sourced: bool  # false: assumed, without a source
    source: str


@lru_cache(maxsize=4)
def robot_figures(model: str) -> tuple[RobotFigure, ...]:
    """Return the rows of one robot.

    Raises:
        InvalidInputError: no robot of that name, or its description is not installed.
    """
    return tuple(
        RobotFigure(f.name, f.key, f.values, f.unit, f.trust, f.sourced, f.source)
        for f in figures_of(model)
    )
