"""An implant put into a bed as it was really milled: how high it stands, its gap and its rock."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from rona_core.geometry.arrays import Bools, Floats
from rona_core.planning.implants.implant import Implant
from rona_core.virtual.milling.left_bone import LeftBone

REACH_MM, STEP_MM = 0.8, 0.1  # of the search for the place where it goes in deepest
RIM_TURNS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)  # places where somebody presses


@dataclass(frozen=True, slots=True)
class Seated:
    """How an implant sits in the bone, upright."""

    high_mm: float  # over the seat that was planned; negative: deeper
    aside_mm: float  # from its planned place, where it goes in deepest
    gap_mean_mm: float  # below it
    rock_mm: float  # by which its lower side dips at its edge, where it is pressed


def seated(implant: Implant, left: LeftBone) -> Seated:
    """Return how an implant sits in what is left of the bone.

    It may give way sideways as far as the bed lets it, as a bed that the robot has milled beside
    its place is still a bed.
    """
    steps = np.arange(-REACH_MM, REACH_MM + 1e-9, STEP_MM)
    high, aside, x, y = min(
        (float(_room(implant, left, x, y)[1].max()), float(np.hypot(x, y)), x, y)
        for x in steps.tolist()
        for y in steps.tolist()
    )
    needed, room = _room(implant, left, x, y)
    lowest: Bools = needed > needed.max() - 0.05
    return Seated(
        high_mm=high,
        aside_mm=aside,
        gap_mean_mm=float((high - room).mean()),
        rock_mm=_rock_mm(*_floor(implant, left, x, y, lowest)),
    )


def _room(implant: Implant, left: LeftBone, x: float, y: float) -> tuple[Floats, Floats]:
    """Return the depth of the implant over the cells below it, and how far bone pushes it up."""
    depth = implant.depth_mm(left.x_mm - x, left.y_mm - y)
    below = depth > 0.0
    return depth[below], (left.top_mm + depth)[below]


def _floor(
    implant: Implant, left: LeftBone, x: float, y: float, lowest: Bools
) -> tuple[Floats, Floats]:
    """Return the cells (n, 2) below the lowest part of an implant, and the floor there (n,)."""
    depth = implant.depth_mm(left.x_mm - x, left.y_mm - y)
    i, j = (axis[lowest] for axis in np.nonzero(depth > 0.0))
    return np.column_stack((left.x_mm[i], left.y_mm[j])), left.top_mm[i, j]


def _rock_mm(places: Floats, heights: Floats) -> float:
    """Return by how much a flat plate on a floor dips at its edge, where it is pressed.

    It rests on a facet of the hull of the floor, the one below its middle; pressed at its edge it
    tips onto others, until it rests on the hull there.
    """
    middle = places.mean(axis=0)
    below = (*middle, heights.min() - 1.0)  # or a floor that is flat has no hull
    hull = ConvexHull(np.vstack((np.column_stack((places, heights)), below)))
    upper = hull.equations[hull.equations[:, 2] > 1e-9]
    planes = -upper[:, [0, 1, 3]] / upper[:, 2:3]  # height = a x + b y + c
    rest = planes[np.argmin(planes[:, :2] @ middle + planes[:, 2])]
    away = places - middle
    edge = [int(np.argmax(away @ (np.cos(t), np.sin(t)))) for t in RIM_TURNS]
    on_edge = places[edge]
    hull_mm = (on_edge @ planes[:, :2].T + planes[:, 2]).min(axis=1)
    return float((on_edge @ rest[:2] + rest[2] - hull_mm).max())
