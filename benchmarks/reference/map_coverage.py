"""Coverage of stated map accuracies: errors of the cells beside the bands they are given."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.maps.inputs import TERMS, map_accuracy
from rona_core.compose import build_virtual_rig
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.truth import truth_of
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.accuracy.error_terms import ErrorTerm
from rona_core.mapping.accuracy.map_accuracy import MapAccuracy
from rona_core.mapping.accuracy.map_terms import MapTerms
from rona_core.session.document import Session

BAND = 1.96  # standard deviations: 95 % of a normal error


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Errors (n,) of the cells of one map in mm, and what the program states."""

    errors_mm: Floats
    total_mm: Floats  # (n,)
    own_mm: Floats  # (n,) what each cell has of its own, against the mean over the cells
    shared_mm: float  # of the mean over the cells: by what all share


def bands(session: Session) -> Iterator[tuple[str, Band]]:
    """Yield every map of a session with virtual devices, absolute and for the same robot."""
    made, accuracy, terms = session.results.maps, map_accuracy(session), TERMS.read(session)
    if made is None or accuracy is None or terms is None:
        return
    truth = truth_of(session, build_virtual_rig(session.setup).scene)
    for name, errors in cell_errors_mm(made.value, truth).items():
        known = np.isfinite(errors)
        if known.any():
            total = _total_mm(accuracy, name)[known]
            yield name, Band(errors[known], total, *parts(terms_of(terms, name), known))


def _total_mm(accuracy: MapAccuracy, name: str) -> Floats:
    """Return the standard deviations (nu, nv) of all parts."""
    part = getattr(accuracy, name.removesuffix("_same_robot"))
    return part.same_robot_mm() if name.endswith("_same_robot") else part.total_mm()


def terms_of(terms: MapTerms, name: str) -> list[ErrorTerm]:
    """Return the causes of one map; the robot's fall out where it uses the map itself."""
    causes: tuple[ErrorTerm, ...] = getattr(terms, name.removesuffix("_same_robot"))
    return [term for term in causes if not (name.endswith("_same_robot") and term.of_robot)]


def parts(terms: Sequence[ErrorTerm], known: Bools) -> tuple[Floats, float]:
    """Return the standard deviations of cells against their mean (n,), and of that mean.

    What a cause does to all cells is one number, but not equally much in all of them (bone is not
    equally thick): the mean over the cells feels the mean of it, and a cell what is left.
    """
    own, mean = np.zeros(int(known.sum())), 0.0
    for term in terms:
        shared = np.broadcast_to(term.shared_mm, known.shape)[known]
        own += np.broadcast_to(term.own_mm, known.shape)[known] ** 2
        own += (shared - shared.mean()) ** 2
        mean += float(shared.mean()) ** 2
    return np.sqrt(own), mean**0.5


def within(errors: Floats, sigma: Floats) -> float:
    """Return the share of errors (n,) that lie in their bands."""
    return float(np.mean(np.abs(errors) <= BAND * sigma))
