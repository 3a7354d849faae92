"""Figures of step 10: the bone that a bed would leave of the true skull."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.judge import fresh
from rona_core.app.steps.implant.view import floor_base
from rona_core.evaluation.figures import Figures
from rona_core.evaluation.maps.map_metrics import arrived_base
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.virtual.milling.left_bone import LeftBone

if TYPE_CHECKING:
    from rona_core.session.document import Session

AROUND_MM = 2.0  # of the floor: where it leans, the nearest place of the boundary is beside it


def bed_figures(session: "Session", truth: Truth) -> Figures:
    """Return what is predicted of the bed, and the least bone that it would really leave."""
    held = fresh("bed", session)
    if held is None or held.placed is None:
        return {}
    placed = held.placed
    return {
        "bed_probability": placed.probability,
        "bed_residual_mm": placed.residual_mm,
        "bed_residual_true_mm": residual_mm(floor_base(held), truth),
    }


def residual_mm(floor_base: Floats, truth: Truth) -> float | None:
    """Return the shortest distance from any of places (n, 3) to the true inner boundary.

    The places are where the robot that made the maps arrives. Negative where the bed breaks
    through; None where the true bone has no inner boundary.
    """
    arrived = arrived_base(floor_base, truth)
    up = truth.foot(arrived)[1].mean(axis=0)
    up /= np.linalg.norm(up)
    x = np.linalg.svd(up[None])[2][1]
    rotation = np.column_stack((x, np.cross(up, x), up))
    T_base_bed = Pose(rotation, arrived.mean(axis=0))
    places = T_base_bed.inv() @ arrived
    reach_mm = float(np.abs(places[:, :2]).max()) + AROUND_MM
    T_skull_bed = truth.T_base_skull.inv() @ T_base_bed
    bone = LeftBone(truth.scene.specimen, T_skull_bed, reach_mm)
    least = float(bone.distances_to_inner_mm(places, np.zeros(len(places))).min())
    return least if np.isfinite(least) else None
