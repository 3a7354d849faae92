"""Work cell: table, floor, head rest, tracker stand and added obstacles, as stated at set-up.

The room is the robot base at its default place, so that moving the base does not move the table.
Table and head are told from the place of work, where the scanned region is put up before the robot.
See docs/algorithms/robot/collision.md.
"""

import re
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rona_core.devices.settings import STRICT, RobotSettings, require, require_within
from rona_core.errors import NotFoundError
from rona_core.geometry.pose import Pose

Triple = tuple[float, float, float]
FAR_MM = 5000.0  # no place of the room is farther from the robot
MOST_BOXES = 20
KNOWN = ("head", "table", "floor", "tracker", "tracker stand")  # names of what is there anyway
PLAIN_NAME = re.compile(r"\w(?:[\w .()-]{0,38}[\w.)])?")  # nodes of the scene have it


@dataclass(frozen=True, slots=True)
class RoomBox:
    """One more thing in the room, as a box that stands upright: a wall, a cupboard, a lamp."""

    __pydantic_config__: ClassVar = STRICT

    name: str
    center_mm: Triple  # its middle, in the room
    size_mm: Triple  # along its own x, y and z
    turn_deg: float = 0.0  # about the vertical

    def __post_init__(self) -> None:
        require(
            bool(PLAIN_NAME.fullmatch(self.name)),
            "an obstacle needs a name of 1 to 40 letters, digits and blanks, "
            f"not {self.name[:60]!r}",
        )
        taken = self.name.lower() in KNOWN
        require(not taken, f"{self.name!r} is there already: give the obstacle another name")
        near = all(abs(part) <= FAR_MM for part in self.center_mm)
        require(near, f"the middle of {self.name} must stay within {FAR_MM:g} mm of the robot")
        sized = all(1.0 <= part <= FAR_MM for part in self.size_mm)
        require(sized, f"the size of {self.name} must be 1 to {FAR_MM:g} mm, not {self.size_mm}")
        require_within("turn_deg", self.turn_deg, -180.0, 180.0)


@dataclass(frozen=True, slots=True)
class Surroundings:
    """Table, floor, head rest and tracker stand, and how far the robot keeps from them."""

    __pydantic_config__: ClassVar = STRICT

    table: bool = True
    table_center_mm: Triple = (630.0, 0.0, -175.0)  # middle of the top, from the place of work
    table_size_mm: Triple = (1500.0, 600.0, 60.0)  # along x, along y, thickness
    floor_mm: float = 0.0  # height of the floor, or of the pedestal the robot stands on
    head_below_mm: float = 90.0  # middle of the head below the place of work, until it is touched
    stand_radius_mm: float = 120.0  # of the pole of the tracker with what hangs on it
    head_margin_mm: float = 10.0  # of everything but the probe from the head
    margin_mm: float = 20.0  # from everything else
    self_margin_mm: float = 5.0  # between parts of the robot
    boxes: tuple[RoomBox, ...] = ()  # what else stands in the room, by name

    def __post_init__(self) -> None:
        near = all(abs(part) <= FAR_MM for part in self.table_center_mm)
        require(near, f"table_center_mm must stay within {FAR_MM:g}, not {self.table_center_mm}")
        sized = all(1.0 <= part <= FAR_MM for part in self.table_size_mm)
        require(sized, f"table_size_mm must be 1 to {FAR_MM:g} mm, not {self.table_size_mm}")
        require_within("floor_mm", self.floor_mm, -FAR_MM, FAR_MM)
        require_within("head_below_mm", self.head_below_mm, -500.0, 500.0)
        require_within("stand_radius_mm", self.stand_radius_mm, 10.0, 1000.0)
        require_within("head_margin_mm", self.head_margin_mm, 0.0, 200.0)
        require_within("margin_mm", self.margin_mm, 0.0, 200.0)
        require_within("self_margin_mm", self.self_margin_mm, 0.0, 50.0)
        require(len(self.boxes) <= MOST_BOXES, f"at most {MOST_BOXES} obstacles, please")
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
