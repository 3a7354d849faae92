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


def expected_rms_mm(maps: Maps, accuracy: MapAccuracy) -> dict[str, float]:
    """Return the expected RMS error of outer and inner map and of the thickness, in mm.

    Over the mapped cells, those of both maps for the thickness; what has no such cell is left out.
    """
    mapped = {
        "outer": maps.outer.ok,
        "inner": maps.inner.ok,
        "thickness": maps.outer.ok & maps.inner.ok,
    }
    return {
        name: _rms_mm(getattr(accuracy, name).total_mm(), which)
        for name, which in mapped.items()
        if which.any()
    }


def accuracy_words(maps: Maps, accuracy: MapAccuracy) -> str:
    """Return a sentence about the errors that are to be expected: RMS over the mapped cells."""
    outer, bone = accuracy.outer, accuracy.thickness
    expected = expected_rms_mm(maps, accuracy)
    if "outer" not in expected:
        return ""
    by_speed = sum(row.shared_mm for row in bone.budget if row.cause == SPEED)
    words = (
        f"Expected errors (1 σ): outer boundary {expected['outer']:.2f} mm "
        f"({_rms_mm(outer.same_robot_mm(), maps.outer.ok):.2f} where the same robot uses the map)"
    )
    if "thickness" in expected:
        words += (
            f", inner {expected['inner']:.2f} mm, thickness {expected['thickness']:.2f} mm: of it "
            f"{by_speed:.2f} mm by the speed of sound, alike in the whole map"
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


def _rms_mm(sigma_mm: Floats, which: Bools) -> float:
    return float(np.sqrt(np.mean(sigma_mm[which] ** 2)))
