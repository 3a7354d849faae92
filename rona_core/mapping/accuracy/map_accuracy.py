"""How sure the maps of step 9 are, cell by cell: the squares of all causes added up."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.accuracy.error_terms import CellSigma, summed
from rona_core.mapping.accuracy.map_terms import SPEED, MapTerms
from rona_core.mapping.boundary_map import Maps


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


def accuracy_of(maps: Maps, terms: MapTerms) -> MapAccuracy:
    """Return how sure the maps are by all their causes of error."""
    outer_ok, inner_ok = maps.outer.ok, maps.inner.ok & maps.outer.ok
    return MapAccuracy(
        outer=summed(terms.outer, outer_ok),
        inner=summed(terms.inner, inner_ok),
        fused=summed(terms.fused, outer_ok),
        thickness=summed(terms.thickness, inner_ok),
    )
