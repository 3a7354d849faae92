"""Places of the robot's base: where to look for them, one of them, and a map of all."""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.limits import number, require_limits
from rona_core.devices.settings import RobotSettings
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose
from rona_core.robot.redundancy.margins import MarginLimits

FARTHEST_MM = 2000.0  # settings of the robot allow no more
MAX_PLACES = 2000  # that a session looks at
ALL_AROUND_DEG = tuple(10.0 * k for k in range(36))
FEW = f"at most {MAX_PLACES} places: across, along and by height, `step_mm` apart"


@dataclass(frozen=True, slots=True)
class BaseSearch:
    """Where to look for a place of the base, and how closely."""

    half_x_mm: float = number(
        500.0,
        "Range x, ±",
        "mm",
        0.0,
        FARTHEST_MM,
        50.0,
        hint="From the base along its x",
        rule=FEW,
    )
    half_y_mm: float = number(
        600.0,
        "Range y, ±",
        "mm",
        0.0,
        FARTHEST_MM,
        50.0,
        hint="From the base along its y",
        rule=FEW,
    )
    step_mm: float = number(
        100.0, "Step", "mm", 10.0, 500.0, 25.0, hint="Between places of the base", rule=FEW
    )
    levels_mm: tuple[float, ...] = number(
        (0.0,),
        "Heights",
        "mm",
        -1000.0,
        1000.0,
        50.0,
        hint="From where the base stands",
        minItems=1,
        maxItems=20,
        rule=FEW,
    )
    keep_off_mm: float = number(
        350.0, "Least distance", "mm", 0.0, FARTHEST_MM, 10.0, hint="Level, from the path"
    )
    n_points: int = number(60, "Path points", "", 2, 2000, 1, hint="Looked at when screening")
    rolls_deg: tuple[float, ...] = number(
        ALL_AROUND_DEG,
        "Roll angles",
        "deg",
        -360.0,
        720.0,
        5.0,
        hint="Looked at when screening",
        minItems=1,
        maxItems=360,
    )
    # that another place must have: calibrated anew, the path is another
    reserve: float = number(0.05, "Margin", "", 0.0, 2.0, 0.05, hint="That another place must have")
    margin_limits: MarginLimits = field(default_factory=MarginLimits)

    def __post_init__(self) -> None:
        require_limits(self)


@dataclass(frozen=True, slots=True)
class BasePlace:
    """A place of the base from which the whole scan was planned, timed and certified."""

    shift_mm: tuple[float, float, float]  # as in RobotSettings: from the default place
    turn_deg: float  # likewise, about the vertical
    moved_mm: float  # from where the base stands
    turned_deg: float
    margin: float  # room with the best constant roll, as screened; negative where only
    mode: str  # a roll that varies along the path works: "constant" or "variable"
    n_feasible: int  # constant rolls that work from there on the dense path
    sentence: str

    def moved(self, robot: RobotSettings) -> RobotSettings:
        """Return the robot's settings with its base at this place."""
        return replace(robot, base_shift_mm=self.shift_mm, base_turn_deg=self.turn_deg)


@dataclass(frozen=True, slots=True, eq=False)
class BasePlacement:
    """A map of places for the base, the best of them and the smallest move that works.

    The map is screened: its margins are of some points of the path and do not know of jumps.
    Only ``best``, ``smallest`` and the places marked ``verified`` were planned in full.
    """

    x_mm: Floats  # (nx,) base_shift_mm[0] of the columns
    y_mm: Floats  # (ny,) base_shift_mm[1]
    margins: NDArray[np.float32]  # (nx, ny) at the best height; 0 and more seems to work
    turns_deg: NDArray[np.float32]  # (nx, ny) base_turn_deg, towards the head
    levels_mm: NDArray[np.float32]  # (nx, ny) base_shift_mm[2], the best height
    blocked: Bools  # (nx, ny) too near the head, not looked at; the margin means nothing
    planned: Bools  # (nx, ny) planned in full
    verified: Bools  # (nx, ny) of those, certified
    here: float  # margin where the base stands, as screened
    best: BasePlace | None
    smallest: BasePlace | None
    reasons: tuple[str, ...]


def base_pose(shift_mm: tuple[float, float, float] | Floats, turn_deg: float) -> Pose:
    """Return the pose of the base in its default place: turned about the vertical, shifted."""
    return Pose.from_rotvec((0.0, 0.0, float(np.deg2rad(turn_deg))), shift_mm)


def path_from(path: Path5D, old_in_new: Pose) -> Path5D:
    """Return a path (in ``base``) as it is seen from a new place of the base.

    Args:
        path: The path in ``base`` as the base stands now.
        old_in_new: Pose of the base as it stands now, in the frame of the base at its new place.
    """
    return Path5D(old_in_new @ path.points_base, path.axes_base @ old_in_new.rotation.T)
