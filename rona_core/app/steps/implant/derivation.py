"""Compute step 10: the bed of an implant in the maps as they may be."""

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.runtime.process_pool import release_memory
from rona_core.app.steps.implant.implant_bed import LACKS, ImplantBed, PlacedBed, TriedLift
from rona_core.app.steps.implant.inputs import BedInputs
from rona_core.app.steps.implant.messages import Corners, PlaceBed, StartBedSearch
from rona_core.app.steps.maps.accuracy import draws_of
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, InvalidInputError
from rona_core.mapping.accuracy.map_terms import MapTerms
from rona_core.mapping.boundary_map import Maps
from rona_core.path.zones import Zone
from rona_core.planning.implants.implant import MOST_LIFT_MM, implant_named
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.evaluate import judge_placement, solid_points
from rona_core.planning.placement.figures import PlacementFigures, Shortfall
from rona_core.planning.placement.problem import (
    MappedBone,
    Placement,
    PlacementLimits,
    PlacementProblem,
)
from rona_core.planning.placement.search import search_placements
from rona_core.session.memo import Memo

RESIDUAL = FIGURES["bed_residual_mm"]

DRAWS = 200  # of the maps
LIFT_STEP_MM = 1.0
SHARE_OF_DRAWS = 0.3  # of the time of a search

_BONES: Memo[MappedBone] = Memo(2)  # drawn for long, and asked at every step of a drag


def mapped_bone(maps: Maps, terms: MapTerms | None) -> MappedBone:
    """Return the maps and their draws, for the robot that made them.

    Raises:
        StaleResultError: there are no terms, as the maps are of other A-scans.
    """
    return _BONES.get((maps, terms), lambda: _drawn(maps, terms))


def _drawn(maps: Maps, terms: MapTerms | None) -> MappedBone:
    draws = draws_of(maps, terms, DRAWS, same_robot=True, grooves=True)
    return MappedBone(draws.maps, draws.outer_mm, draws.inner_mm)


def search_bed(
    known: BedInputs, message: StartBedSearch, *, progress: Progress, cancel: Cancel
) -> ImplantBed:
    """Search the best placement with the smallest lift that is safe, else with the one asked for.

    Raises:
        InvalidInputError: the bed is larger than what is mapped.
        StaleResultError: the maps are of other A-scans.
        CancelledError: ``cancel`` returned True.
    """
    release_memory()
    problem = _problem(known, message)
    progress(SHARE_OF_DRAWS)
    implant = implant_named(message.implant)
    settings = milling_settings(implant, message.burr_mm)
    deepest_mm = implant.terraces()[-1].depth_mm
    lifts = np.arange(0.0, min(MOST_LIFT_MM, deepest_mm - LIFT_STEP_MM) + 1e-9, LIFT_STEP_MM)
    wanted = lifts.tolist() if message.lift_mm is None else [message.lift_mm]
    tried: list[TriedLift] = []
    found = None
    for number, lift_mm in enumerate(wanted):
        if cancel():
            raise CancelledError("cancelled")
        progress(SHARE_OF_DRAWS + (1.0 - SHARE_OF_DRAWS) * number / len(wanted))
        bed = planned_bed(implant.lifted(lift_mm), settings)
        found = search_placements(problem, bed, implant.screws)
        best = found.best
        tried.append(TriedLift(lift_mm, 0.0 if best is None else best.probability))
        if found.refusal is None:
            break
    if found is None:
        raise InvalidInputError(f"{implant.name} needs no bed")
    return ImplantBed(
        implant=implant.name,
        lift_mm=tried[-1].lift_mm,
        limit_mm=message.limit_mm,
        required=message.probability,
        burr_mm=settings.burr.diameter_mm,
        placed=None if found.best is None else _placed(problem, found.best),
        refusal=found.refusal,
        tried=tuple(tried),
        probability=found.probability,
        lacks=found.shortfall,
        burr_sigma_mm=known.burr_sigma_mm,
    )


def lay_bed(known: BedInputs, message: PlaceBed) -> ImplantBed:
    """Return what a bed at a chosen place leaves of the bone.

    Raises:
        StaleResultError: the maps are of other A-scans.
    """
    problem = _problem(known, message)
    implant = implant_named(message.implant).lifted(message.lift_mm)
    settings = milling_settings(implant, message.burr_mm)
    solid = solid_points(problem, planned_bed(implant, settings), implant.screws)
    turns = np.deg2rad((message.angle_deg, message.tilt_x_deg, message.tilt_y_deg)).tolist()
    figures = judge_placement(problem, solid, Placement(message.u_mm, message.v_mm, *turns))
    placed = _placed(problem, figures)
    return ImplantBed(
        implant=implant.name,
        lift_mm=message.lift_mm,
        limit_mm=message.limit_mm,
        required=message.probability,
        burr_mm=settings.burr.diameter_mm,
        placed=placed,
        refusal=_refusal(placed, problem.limits),
        burr_sigma_mm=known.burr_sigma_mm,
    )


def _problem(known: BedInputs, message: StartBedSearch | PlaceBed) -> PlacementProblem:
    """Return the bone, what is asked of a bed in it, and what it keeps away from."""
    limits = PlacementLimits(message.limit_mm, message.probability)
    zones = [
        Zone(str(number), np.array(corners), _is_closed(corners), message.avoid_mm)
        for number, corners in enumerate(message.avoid, start=1)
    ]
    return PlacementProblem(mapped_bone(known.maps, known.terms), known.execution, limits, zones)


def _is_closed(corners: Corners) -> bool:
    return len(corners) > 3 and corners[0] == corners[-1]


def _placed(problem: PlacementProblem, figures: PlacementFigures) -> PlacedBed:
    T_base_map = problem.bone.outer.T_base_map
    thinnest = figures.thinnest_map
    return PlacedBed(
        placement=figures.placement,
        T_base_bed=T_base_map @ figures.T_map_bed,
        lacks=LACKS[figures.shortfall],
        chance=figures.chance,
        residual_mm=figures.residual_mm,
        thinnest_base=None if thinnest is None else T_base_map @ thinnest,
        rim_above_mm=figures.rim_above_mm,
        rim_below_mm=figures.rim_below_mm,
        unmapped_mm=figures.unmapped_mm,
        screws=figures.screws,
    )


def _refusal(placed: PlacedBed, limits: PlacementLimits) -> str | None:
    """Return why a bed that was laid by hand is not safe."""
    if placed.lacks == LACKS[Shortfall.NONE]:
        return None
    if placed.residual_mm is None:
        return "the bed does not lie wholly where both boundaries are mapped: move it"
    if placed.lacks == LACKS[Shortfall.ZONE]:
        return "the bed comes too close to what is to be avoided: move it"
    if placed.residual_mm < limits.residual_mm:
        return (
            f"the bone is too thin here: {RESIDUAL.words(placed.residual_mm)} would be left below "
            f"the bed, and {limits.residual_mm:g} mm are required"
        )
    short = [one for one in placed.screws if one.bone_mm <= one.screw.length_mm]
    if short:
        return f"a screw of {short[0].screw.length_mm:g} mm finds {short[0].bone_mm:.2f} mm of bone"
    return (
        f"the bone is thick enough, but not surely: the probability is {placed.probability:.3f}, "
        f"and {limits.probability:g} is required"
    )
