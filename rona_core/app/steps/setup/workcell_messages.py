"""Commands about what stands around the robot: facts of the room, in mm from where the base began.

The room is the robot base at its default place, x forward, z up; moving the base moves no room.
"""

from dataclasses import dataclass, fields
from typing import Any, ClassVar

from rona_core.app.messages.session_messages import Point
from rona_core.devices.settings import STRICT
from rona_core.devices.workcell import RoomBox, Surroundings

STANDARD = Surroundings()


@dataclass(frozen=True, slots=True)
class SetWorkcell:
    """Say where table and floor are and how far the robot keeps from what; boxes stay as they are.

    Table and head are told from the place of work, where the scanned region is put up. A plan that
    was made among other things becomes stale.
    """

    __pydantic_config__: ClassVar = STRICT
    table: bool = STANDARD.table
    table_center_mm: Point = STANDARD.table_center_mm  # middle of the top
    table_size_mm: Point = STANDARD.table_size_mm  # along x, along y, thickness
    floor_mm: float = STANDARD.floor_mm
    head_below_mm: float = STANDARD.head_below_mm
    stand_radius_mm: float = STANDARD.stand_radius_mm
    head_margin_mm: float = STANDARD.head_margin_mm
    margin_mm: float = STANDARD.margin_mm
    self_margin_mm: float = STANDARD.self_margin_mm

    def __post_init__(self) -> None:
        Surroundings(**self.chosen())  # refuses what is out of range

    def chosen(self) -> dict[str, Any]:
        """Return what is said, by the names that the surroundings have."""
        return {part.name: getattr(self, part.name) for part in fields(self)}


@dataclass(frozen=True, slots=True)
class AddObstacle:
    """Add a box that the robot keeps away from, or change the one of this name.

    ``center_mm`` is its middle in the room, ``size_mm`` along its own x, y and z, ``turn_deg``
    about the vertical. ``instead_of`` is the name of the one that it takes the place of, where that
    is to be called otherwise from now on.
    """

    __pydantic_config__: ClassVar = STRICT
    name: str
    center_mm: Point
    size_mm: Point
    turn_deg: float = 0.0
    instead_of: str | None = None

    def __post_init__(self) -> None:
        self.box()  # refuses what is no box

    def box(self) -> RoomBox:
        """Return the box."""
        return RoomBox(self.name.strip(), self.center_mm, self.size_mm, self.turn_deg)


@dataclass(frozen=True, slots=True)
class RemoveObstacle:
    """Take a box away again, by its name."""

    __pydantic_config__: ClassVar = STRICT
    name: str
