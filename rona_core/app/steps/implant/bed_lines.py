"""Further scan lines for the bed of step 10: where to scan, and how much that can tell."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.steps.implant.derivation import LinesInputs
from rona_core.app.steps.implant.messages import StartBedLines
from rona_core.app.steps.maps.inputs import draws_of
from rona_core.app.steps.maps.messages import Row
from rona_core.app.steps.path.inputs import allowed_in_patch
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, StepBlockedError
from rona_core.geometry.arrays import Floats
from rona_core.mapping.accuracy.map_draws import MapDraws
from rona_core.planning.further_lines import Hearing, bed_hearing, best_lines
from rona_core.planning.implants.implant import implant_named
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.problem import MappedBone, PlacementLimits, PlacementProblem

DRAWS = 600  # of the maps: half of them choose the lines, half tell what they are worth
LEAST_PERCENT = 1.0  # less is not worth a scan


@dataclass(frozen=True, slots=True, eq=False)
class BedLines:
    """Lines that tell most of the bone below the bed of step 10."""

    rows: tuple[Row, ...]  # in the plane of the maps, each from where the last one ended
    length_mm: float
    explained_share: float  # of the variance of the least bone, that they can tell


def find_bed_lines(
    known: LinesInputs, message: StartBedLines, *, progress: Progress, cancel: Cancel
) -> BedLines:
    """Return the chain of lines that is most informative of the least bone below the bed.

    Raises:
        StepBlockedError: the bed does not lie wholly in the maps.
        StaleResultError: the maps are of other A-scans.
        CancelledError: ``cancel`` returned True.
    """
    draws = draws_of(known.maps, known.terms, DRAWS, same_robot=True, grooves=True)
    progress(0.5)
    if cancel():
        raise CancelledError("cancelled")
    found = best_lines(hearing_around(known, draws), message.length_mm)
    if not len(found.rows_mm):
        raise StepBlockedError("no line over the bed lies in the maps")
    progress(0.95)
    lengths_mm = np.linalg.norm(found.rows_mm[:, 1] - found.rows_mm[:, 0], axis=1)
    return BedLines(
        rows=tuple(_row(ends) for ends in found.rows_mm.round(2)),
        length_mm=float(lengths_mm.sum()),
        explained_share=1.0 - found.left_share,
    )


def hearing_around(known: LinesInputs, draws: MapDraws) -> Hearing:
    """Return what a further scan would hear around the bed, in draws of the maps.

    Raises:
        StepBlockedError: the bed does not lie wholly in the maps.
    """
    held, placed = known.bed, known.bed.placed
    if placed is None or placed.residual_mm is None:
        raise StepBlockedError(f"there is no bed to make certain: {held.refusal}")
    limits = PlacementLimits(held.limit_mm, held.required)
    bone = MappedBone(draws.maps, draws.outer_mm, draws.inner_mm)
    implant = implant_named(held.implant).lifted(held.lift_mm)
    T_base_map, painted = draws.maps.outer.T_base_map, known.painted
    own_mm = known.detection.thickness_sigma_mm[known.detection.inner_ok]
    return bed_hearing(
        draws,
        PlacementProblem(bone, known.execution, limits),
        implant,
        planned_bed(implant, milling_settings(implant, held.burr_mm)),
        placed.T_base_bed,
        None if painted is None else allowed_in_patch(painted, T_base_map),
        float(np.sqrt(np.mean(own_mm**2))),
    )


def lines_verdict(found: BedLines) -> str:
    """Return in one sentence how much the lines can tell of the bed."""
    share = 100.0 * found.explained_share
    rest = "how well it is milled and the speed of sound, which no further line measures"
    if share < LEAST_PERCENT:
        return f"Further lines tell next to nothing of this bed: what is left open is {rest}."
    return (
        f"{found.length_mm:.0f} mm of lines tell up to {share:.0f} % of what is open about the "
        "least bone of this bed, if it echoes all along; silent places add doubt. "
        f"The rest is {rest}."
    )


def _row(ends: Floats) -> Row:
    (u, v), (to_u, to_v) = ends.tolist()
    return (u, v), (to_u, to_v)
