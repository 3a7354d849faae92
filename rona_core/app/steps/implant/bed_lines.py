"""Further scan lines for the bed of step 10: where to scan, and how much that can tell."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.dependencies.inputs import require_result
from rona_core.app.steps.implant.derivation import execution_error, milling_settings
from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.messages import StartBedLines
from rona_core.app.steps.implant.view import WANTED
from rona_core.app.steps.maps.accuracy import drawn_maps
from rona_core.app.steps.maps.messages import Row
from rona_core.app.steps.path.painting import allowed_in_patch
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, StepBlockedError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.mapping.accuracy.map_draws import MapDraws
from rona_core.planning.further_lines.best_lines import Hearing, best_lines
from rona_core.planning.implants.catalogue import implant_named
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.mapped_bone import MappedBone
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.residuals import margins
from rona_core.planning.placement.settings import PlacementLimits
from rona_core.planning.placement.solid_points import solid_points
from rona_core.session.document import Session

DRAWS = 600  # of the maps: half of them choose the lines, half tell what they are worth
LEAST_PERCENT = 1.0  # less is not worth a scan
AROUND_MM = 2.0  # of bed and screws, where a line may go, too


@dataclass(frozen=True, slots=True, eq=False)
class BedLines:
    """Lines that tell most of the bone below the bed of step 10."""

    rows: tuple[Row, ...]  # in the plane of the maps, each from where the last one ended
    length_mm: float
    explained_share: float  # of the variance of the least bone, that they can tell


def derive_bed_lines(
    session: Session, message: StartBedLines, *, progress: Progress, cancel: Cancel
) -> BedLines:
    """Return the chain of lines that is most informative of the least bone below the bed.

    Raises:
        StepBlockedError: there is no bed, or it does not lie wholly in the maps.
        CancelledError: ``cancel`` returned True.
    """
    held: ImplantBed = require_result(session.results.get("bed"), WANTED).value
    draws = drawn_maps(session, DRAWS, same_robot=True, grooves=True)
    progress(0.5)
    if cancel():
        raise CancelledError("cancelled")
    hearing = bed_hearing(session, held, draws)
    found = best_lines(hearing, message.length_mm)
    if not len(found.rows_mm):
        raise StepBlockedError("StartBedLines is blocked: no line over the bed lies in the maps")
    progress(0.95)
    lengths_mm = np.linalg.norm(found.rows_mm[:, 1] - found.rows_mm[:, 0], axis=1)
    return BedLines(
        rows=tuple(_row(ends) for ends in found.rows_mm.round(2)),
        length_mm=float(lengths_mm.sum()),
        explained_share=1.0 - found.left_share,
    )


def bed_hearing(session: Session, held: ImplantBed, draws: MapDraws) -> Hearing:
    """Return what a further scan would hear around a bed, in draws of the maps.

    What counts is the least bone over the limit below the bed or beyond a screw.

    Raises:
        StepBlockedError: the bed does not lie wholly in the maps.
    """
    placed = require_result(held.placed, WANTED)
    if placed.residual_mm is None:
        raise StepBlockedError(f"there is no bed to make certain: {held.refusal}")
    maps = draws.maps
    limits = PlacementLimits(held.limit_mm, held.required)
    bone = MappedBone(maps, draws.outer_mm, draws.inner_mm)
    problem = PlacementProblem(bone, execution_error(session), limits)
    implant = implant_named(held.implant).lifted(held.lift_mm)
    bed = planned_bed(implant, milling_settings(implant, held.burr_mm))
    solid = solid_points(problem, bed, implant.screws)
    T_map_bed = maps.outer.T_base_map.inv() @ placed.T_base_bed
    screws = np.array([(one.x_mm, one.y_mm, 0.0) for one in implant.screws]).reshape(-1, 3)
    beneath = np.vstack((T_map_bed @ solid.floor, T_map_bed @ screws))[:, :2]
    places = bone.places_mm()
    away = KDTree(beneath).query(places)[0]
    around = maps.outer.ok & (away <= AROUND_MM)
    if (allowed := allowed_in_patch(session.painted, maps.outer.T_base_map)) is not None:
        around[around] = allowed(places[around])
    found = require_result(session.results.detection, "detect the boundaries (step 9)").value
    own_mm = found.thickness_sigma_mm[found.inner_ok]
    return Hearing(
        places_mm=readonly(places[around]),
        thickness_mm=readonly(draws.reread_mm[:, around].T),
        least_mm=readonly(margins(problem, T_map_bed, solid)),
        sigma_mm=float(np.sqrt(np.mean(own_mm**2))),
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
