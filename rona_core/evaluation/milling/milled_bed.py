"""An implant put into a bed as it was really milled: how high it stands, its gap and its rock."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from rona_core.geometry.arrays import Floats
from rona_core.planning.implants.implant import Implant
from rona_core.virtual.milling.left_bone import CELL_MM, LeftBone

STEPS = 8  # of the search for the place where it goes in deepest, to each side,
STEP_MM = 0.5 * CELL_MM  # of which two are one cell of the bone
RIM_TURNS = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)  # places that are pressed


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
    # over a grid of steps, of which every other one is below a cell of the bone
    x_mm, y_mm = (_every_step(axis) for axis in (left.x_mm, left.y_mm))
    depth = implant.depth_mm(x_mm, y_mm)
    steps = range(-STEPS, STEPS + 1)
    high, aside, i, j = min(
        (_high_mm(left, _moved(depth, i, j)), float(np.hypot(i, j)) * STEP_MM, i, j)
        for i in steps
        for j in steps
    )
    moved = _moved(depth, i, j)
    below = moved > 0.0
    lowest = moved > moved.max() - 0.05
    at = np.nonzero(lowest)
    return Seated(
        high_mm=high,
        aside_mm=aside,
        gap_mean_mm=float((high - (left.top_mm + moved)[below]).mean()),
        rock_mm=_rock_mm(
            np.column_stack((left.x_mm[at[0]], left.y_mm[at[1]])), left.top_mm[lowest]
        ),
    )


def _every_step(axis_mm: Floats) -> Floats:
    """Return places a step apart, from ``STEPS`` before the first cell to beyond the last."""
    return axis_mm[0] + STEP_MM * np.arange(-STEPS, 2 * len(axis_mm) - 1 + STEPS)


def _moved(depth_mm: Floats, i: int, j: int) -> Floats:
    """Return the depth over the cells of an implant that is moved by so many steps."""
    first, second = STEPS - i, STEPS - j
    rows = (depth_mm.shape[0] - 2 * STEPS + 1) // 2
    columns = (depth_mm.shape[1] - 2 * STEPS + 1) // 2
    return depth_mm[first : first + 2 * rows : 2, second : second + 2 * columns : 2]


def _high_mm(left: LeftBone, depth_mm: Floats) -> float:
    """Return how far bone pushes up an implant that is so deep over its cells (nx, ny)."""
    return float(np.where(depth_mm > 0.0, left.top_mm + depth_mm, -np.inf).max())


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
