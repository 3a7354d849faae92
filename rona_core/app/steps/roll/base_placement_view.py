"""The map of places for the robot's base as it is drawn: in ``base``, where the base stands now."""

from dataclasses import dataclass

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.roll.base_placement import moves
from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.robot.base_placement.candidates import BasePlace, BasePlacement, base_pose
from rona_core.session.document import Session

__all__ = ["BasePlace", "BasePlacement", "PlacementView", "fresh_placement", "placement_view"]


@dataclass(frozen=True, slots=True, eq=False)
class PlacementView:
    """Cells of the map, and the two places that were planned in full."""

    room: Pose  # pose in ``base`` of the base at its default place
    x_mm: Floats  # (nx,) middles of the cells, along x of the room
    y_mm: Floats  # (ny,)
    margins: Floats  # (nx, ny) 0 and more seems to work
    blocked: Bools  # (nx, ny)
    best: Pose | None  # pose of the base there; None where there is none, or no move
    smallest: Pose | None


def fresh_placement(session: Session) -> BasePlacement | None:
    """Return the places that were found, while they hold for the robot and path of now."""
    found = session.results.placement
    return None if found is None or stale_reason("placement", session) else found.value


def placement_view(session: Session) -> PlacementView | None:
    """Return what to draw; None while no search holds."""
    found = fresh_placement(session)
    if found is None:
        return None
    robot = session.setup.devices.robot
    room = base_pose(robot.base_shift_mm, robot.base_turn_deg).inv()

    def pose(place: BasePlace | None) -> Pose | None:
        if place is None or not moves(place):
            return None
        return room @ base_pose(place.shift_mm, place.turn_deg)

    return PlacementView(
        room=room,
        x_mm=found.x_mm,
        y_mm=found.y_mm,
        margins=found.margins.astype(float),
        blocked=found.blocked,
        best=pose(found.best),
        smallest=pose(found.smallest),
    )
