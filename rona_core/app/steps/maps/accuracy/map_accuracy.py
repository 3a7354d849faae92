"""How sure the maps of step 9 are, cell by cell: the squares of all causes added up."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.maps.accuracy.error_terms import CellSigma, summed
from rona_core.app.steps.maps.accuracy.map_terms import SPEED, MapTerms, map_terms
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import Maps
from rona_core.session.document import Session
from rona_core.session.memo import remember


@dataclass(frozen=True, slots=True, eq=False)
class MapAccuracy:
    """How sure the three maps and the thickness between two of them are."""

    outer: CellSigma
    inner: CellSigma
    fused: CellSigma
    thickness: CellSigma


def accuracy_words(maps: Maps, accuracy: MapAccuracy) -> str:
    """Return a sentence about the errors that are to be expected: RMS over the mapped cells."""

    def rms_mm(sigma: Floats, which: Bools) -> float:
        return float(np.sqrt(np.mean(sigma[which] ** 2)))

    outer, inner, bone = accuracy.outer, accuracy.inner, accuracy.thickness
    both = maps.outer.ok & maps.inner.ok
    if not maps.outer.ok.any():
        return ""
    by_speed = sum(row.shared_mm for row in bone.budget if row.cause == SPEED)
    words = (
        f"Expected errors (1 σ): outer boundary {rms_mm(outer.total_mm(), maps.outer.ok):.2f} mm "
        f"({rms_mm(outer.same_robot_mm(), maps.outer.ok):.2f} where the same robot uses the map)"
    )
    if both.any():
        words += (
            f", inner {rms_mm(inner.total_mm(), maps.inner.ok):.2f} mm, thickness "
            f"{rms_mm(bone.total_mm(), both):.2f} mm: of it {by_speed:.2f} mm "
            "by the speed of sound, alike in the whole map"
        )
    return f"{words}."


def map_accuracy(session: Session, *, hand: bool = False) -> MapAccuracy | None:
    """Return how sure the maps are; None before there are any, or of other A-scans than these.

    Args:
        session: With its maps.
        hand: Those of the scan by hand, in place of the robot's.
    """
    terms = map_terms(session, hand=hand)
    if terms is None:
        return None
    results = session.results
    if hand:
        return None if results.sono_maps is None else _summed(results.sono_maps.value.maps, terms)
    return None if results.maps is None else _summed(results.maps.value, terms)


@remember(4)
def _summed(maps: Maps, terms: MapTerms) -> MapAccuracy:
    outer_ok, inner_ok = maps.outer.ok, maps.inner.ok & maps.outer.ok
    return MapAccuracy(
        outer=summed(terms.outer, outer_ok),
        inner=summed(terms.inner, inner_ok),
        fused=summed(terms.fused, outer_ok),
        thickness=summed(terms.thickness, inner_ok),
    )
