"""Figures of step 10: the bone that a bed would leave of the true skull."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.implant.view import floor_base
from rona_core.evaluation.figures import Figures
from rona_core.evaluation.maps.map_metrics import inner_errors_mm
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Floats

if TYPE_CHECKING:
    from rona_core.session.document import Session


def bed_figures(session: "Session", truth: Truth) -> Figures:
    """Return what is predicted of the bed, and the least bone that it would really leave."""
    held = session.results.get("bed")
    if held is None or held.value.placed is None or stale_reason("bed", session) is not None:
        return {}
    placed = held.value.placed
    return {
        "bed_probability": placed.probability,
        "bed_residual_mm": placed.residual_mm,
        "bed_residual_true_mm": residual_mm(floor_base(held.value), truth),
    }


def residual_mm(floor_base: Floats, truth: Truth) -> float | None:
    """Return the least true bone below places (n, 3) where the robot that made the maps arrives.

    Negative where the bed breaks through; None where the true bone has no inner boundary.
    """
    left = inner_errors_mm(floor_base, truth, True)  # how far a place is outside that boundary
    known = left[np.isfinite(left)]
    return float(known.min()) if len(known) else None
