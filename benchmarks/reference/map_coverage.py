"""Coverage of stated map accuracies: errors of the cells beside the bands they are given."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.maps.accuracy.map_accuracy import MapAccuracy, map_accuracy
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.maps.map_errors import cell_errors_mm
from rona_core.evaluation.truth import truth_of
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session

BAND = 1.96  # standard deviations: 95 % of a normal error


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Errors (n,) of the cells of one map in mm, and what the program states."""

    errors_mm: Floats
    total_mm: Floats  # (n,)
    own_mm: Floats  # (n,) what each cell has of its own
    shared_mm: float  # RMS over the cells of what all share


def bands(session: Session) -> Iterator[tuple[str, Band]]:
    """Yield every map of a session with virtual devices, absolute and for the same robot."""
    made, accuracy = session.results.maps, map_accuracy(session)
    if made is None or accuracy is None:
        return
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    for name, errors in cell_errors_mm(made.value, truth).items():
        total, own, shared = _stated(accuracy, name)
        known = np.isfinite(errors)
        if known.any():
            rms = float(np.sqrt(np.mean(shared[known] ** 2)))
            yield name, Band(errors[known], total[known], own[known], rms)


def _stated(accuracy: MapAccuracy, name: str) -> tuple[Floats, Floats, Floats]:
    """Return the standard deviations (nu, nv): all parts, each cell's own, what all share."""
    same = name.endswith("_same_robot")
    part = getattr(accuracy, name.removesuffix("_same_robot"))
    total = part.same_robot_mm() if same else part.total_mm()
    if same:
        return total, part.own_mm, part.shared_mm
    own = np.hypot(part.own_mm, part.robot_own_mm)
    return total, own, np.hypot(part.shared_mm, part.robot_shared_mm)


def within(errors: Floats, sigma: Floats) -> float:
    """Return the share of errors (n,) that lie in their bands."""
    return float(np.mean(np.abs(errors) <= BAND * sigma))
