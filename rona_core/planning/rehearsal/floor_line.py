"""Line of a probe over a milled floor: from place to place in turns, clear of the bed's walls."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Ints
from rona_core.planning.rehearsal.commanded_floor import CELL_MM, CommandedFloor
from rona_core.robot.collision.collision_geometry import LINE_PROFILE

STEP_MM = 1.5  # between places
ROUGH_MM = 0.2  # of a floor that a face is pressed on: ridges are less
EDGE_MM = 0.4  # from the probe to the wall
OVER_MM = 2.0  # above the highest bone, where the probe comes from and goes to


@dataclass(frozen=True, slots=True, eq=False)
class FloorLine:
    """Places in ``bed`` that the face of a probe goes through, straight from one to the next."""

    points_bed: Floats  # (n, 3), first and last of them above the bone
    stops: Ints  # (m,) points at which it is pressed on the floor, m at least 1

    @property
    def places_bed(self) -> Floats:
        """Return the places (m, 3) of the floor."""
        return self.points_bed[self.stops]


def floor_line(floor: CommandedFloor, face_radius_mm: float, below_mm: float) -> FloorLine | None:
    """Return a line over all places of a floor where a probe can be pressed on; None: no place.

    The face stands wholly on the floor there, and the delay line, which widens upwards, is clear
    of the wall. Rows are scanned to and fro. Where the wall is between two places, the probe goes
    up over the bone; there it begins and ends too.

    Args:
        floor: What was milled so far.
        face_radius_mm: Of the probe.
        below_mm: Places of the floor lie below this height.
    """
    places = floor.flat_places(face_radius_mm + EDGE_MM, STEP_MM, ROUGH_MM)
    places = places[places[:, 2] < below_mm]
    line = _Line.of(face_radius_mm)
    free = [line.clear(floor, place[None]) for place in places]
    places = places[np.array(free, dtype=np.bool_)]
    if not len(places):
        return None
    rows = np.unique(places[:, 0], return_inverse=True)[1]
    places = places[np.lexsort((places[:, 1] * np.where(rows % 2, -1.0, 1.0), rows))]
    high = floor.top_mm.max() + OVER_MM
    above = np.column_stack((places[:, :2], np.full(len(places), high)))
    points, stops = [above[0]], []
    for row, place in enumerate(places):
        if row and not line.clear(floor, _leg(places[row - 1], place)):
            points += [above[row - 1], above[row]]
        stops.append(len(points))
        points.append(place)
    return FloorLine(np.array([*points, above[-1]]), np.array(stops))


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """The delay line as what collides of it is bounded, with the way that it keeps from a wall."""

    radii_mm: Floats  # (k,) rising
    heights_mm: Floats  # (k,) of its side over its face, at these radii

    @classmethod
    def of(cls, face_radius_mm: float) -> "_Line":
        """Return the line of a probe; with a wider face all of it is wider."""
        radii, heights = np.array(LINE_PROFILE)[::-1].T
        return cls(radii + max(face_radius_mm - radii[0], 0.0) + EDGE_MM, -heights)

    def clear(self, floor: CommandedFloor, places_bed: Floats) -> bool:
        """Return whether it meets nothing but ridges with its face at places (k, 3)."""
        cells, tops = floor.cells(), floor.top_mm.ravel()
        for place in places_bed:
            away = np.linalg.norm(cells - place[:2], axis=1)
            side = np.interp(away, self.radii_mm, self.heights_mm, right=np.inf)
            if (tops > place[2] + ROUGH_MM + side).any():
                return False
        return True


def _leg(start: Floats, end: Floats) -> Floats:
    """Return places (k, 3) of the straight way over a floor, at the height of its higher end."""
    count = int(np.ceil(np.linalg.norm(end - start) / CELL_MM)) + 1
    return np.column_stack(
        (np.linspace(start[:2], end[:2], count), np.full(count, max(start[2], end[2])))
    )
