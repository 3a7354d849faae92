"""Figures of a rehearsed milling, and how the implant sits in the bed."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import ConvexHull

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.implant.milling import MillingView, burr_way_of, raised_view
from rona_core.app.steps.implant.rehearsal import Rehearsal
from rona_core.app.steps.implant.view import milling_model, milling_view, require_certified
from rona_core.evaluation.truth import Figures, Truth
from rona_core.geometry.arrays import Floats
from rona_core.planning.implants.implant import Implant
from rona_core.planning.rehearsal.site import BurrWay
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.session.memo import Memo
from rona_core.virtual.milling.left_bone import CELL_MM, LeftBone
from rona_core.virtual.milling.milling_site import VirtualMillingSite
from rona_core.virtual.scene import VirtualScene

if TYPE_CHECKING:
    from rona_core.session.document import Session


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


_FIGURES: Memo[Figures] = Memo(2)


def rehearsal_figures(session: "Session", truth: Truth) -> Figures:
    """Return what a rehearsal thinks that it left, and what it really left."""
    held = session.results.get("rehearsal")
    if held is None or stale_reason("rehearsal", session) is not None:
        return {}
    return _FIGURES.get((held, truth.scene), lambda: _figures(session, held.value, truth.scene))


def _figures(session: "Session", found: Rehearsal, scene: VirtualScene) -> Figures:
    raised = _raised_motion(found)
    figures: Figures = {
        "rehearsal_residual_mm": found.residual_mm,
        "rehearsal_raised_mm": found.raised_mm,
        "rehearsal_raised_s": None if raised is None else raised.duration_s,
    }
    site = milled_again(session, found, scene)
    if site is None:
        return figures
    figures["rehearsal_residual_true_mm"] = min(site.least_mm)
    if not found.stopped:
        seat = seated(milling_view(session).implant, site.left_bone())
        figures["rehearsal_implant_high_mm"] = seat.high_mm
        figures["rehearsal_rock_mm"] = seat.rock_mm
    return figures


def milled_again(
    session: "Session", found: Rehearsal, scene: VirtualScene
) -> VirtualMillingSite | None:
    """Return the site as a rehearsal left it: the burr goes the same way once more.

    None where nothing was milled, or where the way is not known: files of earlier versions do not
    hold the motion of raised layers.
    """
    _, motion = require_certified(session)
    view = milling_view(session)
    way = burr_way_of(view, motion)
    rows, pause = np.arange(len(way)), int(np.searchsorted(way.layers, found.pause, side="right"))
    first, rest = way.part(rows < pause), way.part(rows >= pause)
    if found.ceiling_mm is not None:
        rest = _raised(view, found, rest).after(first)
    if not 0 < found.steps <= len(first) + len(rest):
        return None
    site = VirtualMillingSite(scene, milling_model(session, view), found.number)
    left = found.steps
    for part in (first, rest):
        driven = part.part(np.arange(len(part)) < left)
        left -= len(driven)
        if len(driven):
            site.follow(driven)
            site.drive()
    return site


def _raised_motion(found: Rehearsal) -> Trajectory | None:
    return None if found.raised_plan is None else found.raised_plan.certified_motion


def _raised(view: MillingView, found: Rehearsal, planned: BurrWay) -> BurrWay:
    """Return the way along the raised layers, without a place where they were not milled."""
    motion, ceiling = _raised_motion(found), found.ceiling_mm
    left = None if ceiling is None else raised_view(view, found.pause, ceiling)
    if left is None or motion is None:
        return planned.part(np.zeros(len(planned), dtype=np.bool_))
    return burr_way_of(left, motion)
