"""Work cell: table, floor, head rest, tracker stand and added obstacles, as stated at set-up.

Frame ``room``: the robot base at its default place, so that moving the base does not move the
table. Table and head are given relative to the place of work, where the scanned region lies.
See docs/algorithms/robot/collision.md.
"""

from dataclasses import MISSING, dataclass, replace
from typing import ClassVar

import numpy as np

from rona_core.devices.limits import limited, number, require, require_limits, switch
from rona_core.devices.settings import STRICT, RobotSettings
from rona_core.errors import NotFoundError
from rona_core.geometry.pose import Pose

Triple = tuple[float, float, float]
FAR_MM = 5000.0  # no place of the room is farther from the robot
MOST_BOXES = 20
MOST_NAME = 40  # characters
KNOWN = ("head", "table", "floor", "tracker", "tracker stand")  # names of what is there anyway
BOX_NAME = {  # nodes of the scene have it
    "minLength": 1,
    "maxLength": MOST_NAME,
    "pattern": r"^\w(?:[\w .()-]*[\w.)])?$",
    "rule": f"1 to {MOST_NAME} letters, digits and blanks, and not {', '.join(KNOWN)}",
}


@dataclass(frozen=True, slots=True)
class RoomBox:
    """One more thing in the room, as a box that stands upright: a wall, a cupboard, a lamp."""

    __pydantic_config__: ClassVar = STRICT

    name: str = limited(**BOX_NAME)
    center_mm: Triple = number(
        MISSING, "Centre", "mm", -FAR_MM, FAR_MM, 1.0, hint="x, y, z in the work cell"
    )
    size_mm: Triple = number(
        MISSING, "Size", "mm", 1.0, FAR_MM, 1.0, hint="Along its own x, y and z"
    )
    turn_deg: float = number(0.0, "Rotation", "deg", -180.0, 180.0, 5.0, hint="About the vertical")

    def __post_init__(self) -> None:
        require_limits(self)
        taken = self.name.lower() in KNOWN
        require(not taken, f"{self.name!r} is there already: give the obstacle another name")


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Table, floor, head rest and tracker stand, and how far the robot keeps from them."""

    __pydantic_config__: ClassVar = STRICT

    table: bool = switch(True, "Table", "The table below the head is an obstacle")
    table_center_mm: Triple = number(
        (630.0, 0.0, -175.0), "Table top", "mm", -FAR_MM, FAR_MM, 1.0, hint="Offset from the region"
    )
    table_size_mm: Triple = number(
        (1500.0, 600.0, 60.0), "Table size", "mm", 1.0, FAR_MM, 1.0, hint="x, y, thickness"
    )
    floor_mm: float = number(
        0.0,
        "Floor height",
        "mm",
        -FAR_MM,
        FAR_MM,
        10.0,
        hint="Height of the floor or of the pedestal",
    )
    head_below_mm: float = number(
        90.0,
        "Head depth",
        "mm",
        -500.0,
        500.0,
        5.0,
        hint="Head centre below the region, before step 4",
    )
    stand_radius_mm: float = number(
        120.0, "Tracker stand", "mm", 10.0, 1000.0, 10.0, hint="Radius of the stand of the tracker"
    )
    head_margin_mm: float = number(
        10.0, "Head clearance", "mm", 0.0, 200.0, 1.0, hint="Except for the probe"
    )
    margin_mm: float = number(
        20.0, "Obstacle clearance", "mm", 0.0, 200.0, 1.0, hint="All but the head"
    )
    self_margin_mm: float = number(
        5.0, "Self-clearance", "mm", 0.0, 50.0, 1.0, hint="Between links of the robot"
    )
    # what else stands in the room, by name
    boxes: tuple[RoomBox, ...] = limited((), maxItems=MOST_BOXES)

    def __post_init__(self) -> None:
        require_limits(self)
        names = [box.name for box in self.boxes]
        require(len(set(names)) == len(names), f"obstacles need names of their own: {names}")

    def put(self, box: RoomBox, instead_of: str | None = None) -> "Surroundings":
        """Return the surroundings with a box; it takes the place of the one of its name.

        Args:
            box: To be added.
            instead_of: Name of the one whose place it takes, where that is another one.

        Raises:
            NotFoundError: there is none of that name.
            InvalidInputError: another box has the new name already, or there are too many.
        """
        name = box.name if instead_of is None else instead_of
        if any(held.name == name for held in self.boxes):
            return replace(self, boxes=tuple(box if h.name == name else h for h in self.boxes))
        if instead_of is not None:
            raise self._not_there(name, "change")
        return replace(self, boxes=(*self.boxes, box))

    def without(self, name: str) -> "Surroundings":
        """Return the surroundings without the box of a name.

        Raises:
            NotFoundError: there is none.
        """
        left = tuple(held for held in self.boxes if held.name != name)
        if len(left) == len(self.boxes):
            raise self._not_there(name, "take away")
        return replace(self, boxes=left)

    def _not_there(self, name: str, wanted: str) -> NotFoundError:
        there = ", ".join(held.name for held in self.boxes) or "none"
        return NotFoundError(f"there is no obstacle {name[:60]!r} to {wanted}; added: {there}")


def workcell_pose(robot: RobotSettings) -> Pose:
    """Return the pose of the room in ``base``, from where the base stands now."""
    turn_rad = (0.0, 0.0, float(np.deg2rad(robot.base_turn_deg)))
    return Pose.from_rotvec(turn_rad, robot.base_shift_mm).inv()
