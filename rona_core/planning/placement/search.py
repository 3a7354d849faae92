"""Best placement of a bed over the whole mapped region, and how sure it is everywhere.

Every place, angle and tilt is screened with the map and its cell-wise spread, which promises too
much; draws tell by how much, at every other place. The promising ones are then judged with all
draws, best first. See docs/algorithms/implant/placement.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.planning.bed import Bed, Screw
from rona_core.planning.placement.candidates import Candidates
from rona_core.planning.placement.chance import normal_quantile
from rona_core.planning.placement.figures import PlacementFigures, Shortfall
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.settings import SearchGrid
from rona_core.planning.placement.solid_points import solid_points


@dataclass(frozen=True, slots=True, eq=False)
class PlacementSearch:
    """The best placement, and what the bed lacks where."""

    best: PlacementFigures | None  # None where the bed cannot be laid at all
    probability: Floats  # (nu, nv) with the bed's origin in that cell, at its best angle and tilt
    shortfall: Ints  # (nu, nv) of that, see ``Shortfall``
    refusal: str | None  # why no placement is safe; None where the best one is


def search_placements(
    problem: PlacementProblem,
    bed: Bed,
    screws: Sequence[Screw] = (),
    grid: SearchGrid | None = None,
) -> PlacementSearch:
    """Return the best placement of a bed over the whole mapped region.

    Args:
        problem: Bone, limits, errors of execution and zones.
        bed: The solid that the burr sweeps.
        screws: Beside it.
        grid: Angles and tilts.

    Raises:
        InvalidInputError: the bed is larger than the region, or no bed at all.
    """
    solid = solid_points(problem, bed, screws)
    _check_size(problem, bed)
    found = Candidates(problem, solid, bed, grid or SearchGrid())
    best, cells = found.best(), tuple(found.cells.T)
    probability = np.zeros(problem.bone.shape)
    shortfall = np.full(problem.bone.shape, int(Shortfall.UNMAPPED))
    if len(found.cells):
        chance = np.where(found.laid, ndtr(normal_quantile(found.safest - found.optimism)), 0.0)
        enough = found.residual_mm.max(axis=(1, 2)) >= problem.limits.residual_mm
        state = np.where(enough, Shortfall.UNSURE, Shortfall.THIN)
        state[chance >= problem.limits.probability] = Shortfall.NONE
        barred = np.where(found.covered, Shortfall.ZONE, Shortfall.UNMAPPED)
        probability[cells], shortfall[cells] = chance, np.where(found.laid, state, barred)
    refusal = _refusal(problem, best, found)
    return PlacementSearch(best, readonly(probability), readonly(shortfall), refusal)


def _check_size(problem: PlacementProblem, bed: Bed) -> None:
    area = float(bed.cut().sum()) * float(bed.x_mm[1] - bed.x_mm[0]) ** 2
    mapped = float(problem.bone.ok.sum()) * problem.bone.cell_mm**2
    require(
        area <= mapped,
        f"the bed covers {area:.0f} mm2, and both boundaries are mapped over {mapped:.0f} mm2: "
        "take a smaller implant or scan a larger region",
    )


def _refusal(
    problem: PlacementProblem, best: PlacementFigures | None, found: Candidates
) -> str | None:
    """Return why no placement is safe."""
    limits = problem.limits
    if best is None:
        if found.covered.any() and not found.laid.any():
            return "wherever the bed lies over mapped bone it comes too close to a zone to avoid"
        return "nowhere does the bed lie wholly where both boundaries are mapped: scan on"
    if best.shortfall is Shortfall.NONE:
        return None
    most = float(found.residual_mm.max())
    if most < limits.residual_mm:
        return (
            f"the bone is too thin: at best {most:.2f} mm would be left below the bed, and "
            f"{limits.residual_mm:g} mm are required: lift the implant or take a shallower one"
        )
    short = [one for one in best.screws if one.bone_mm <= one.screw.length_mm]
    if short:
        return (
            f"a screw of {short[0].screw.length_mm:g} mm finds {short[0].bone_mm:.2f} mm of bone "
            "at the best place: take shorter screws or other holes"
        )
    return (
        f"the bone is thick enough, but not surely: the probability is {best.probability:.3f} at "
        f"best, and {limits.probability:g} is required: scan again there, or lift the implant"
    )
