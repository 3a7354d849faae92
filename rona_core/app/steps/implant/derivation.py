"""Step 10: what the bed of an implant and lines over it are computed from, and both."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.staleness import result_input
from rona_core.app.runtime.process_pool import release_memory
from rona_core.app.steps.acoustics.derivation import DETECTION
from rona_core.app.steps.implant.burr.derivation import KNOWN_BURR, BurrRegistration
from rona_core.app.steps.implant.messages import Corners, PlaceBed, StartBedLines, StartBedSearch
from rona_core.app.steps.implant.milling_plan import MillingPlan
from rona_core.app.steps.maps.inputs import MAPS, OF_MAPS, TERMS, draws_of
from rona_core.app.steps.maps.messages import Row
from rona_core.app.steps.path.inputs import PAINTED, allowed_in_patch
from rona_core.app.steps.setup.capture_parts import MODEL, OBSTACLES
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import CancelledError, InvalidInputError, StepBlockedError
from rona_core.geometry.arrays import Floats, Ints, Vector3
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.map_draws import MapDraws
from rona_core.mapping.accuracy.map_terms import MapTerms
from rona_core.mapping.boundary_map import Maps
from rona_core.path.zones import PaintedRegions, Zone
from rona_core.planning.further_lines import Hearing, bed_hearing, best_lines
from rona_core.planning.implants.implant import MOST_LIFT_MM, implant_named
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.evaluate import judge_placement, solid_points
from rona_core.planning.placement.figures import Chance, PlacementFigures, ScrewFigures, Shortfall
from rona_core.planning.placement.problem import (
    ExecutionError,
    MappedBone,
    Placement,
    PlacementLimits,
    PlacementProblem,
    execution_error,
)
from rona_core.planning.placement.search import search_placements
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.session.codec import OMIT_EMPTY
from rona_core.session.memo import Memo
from rona_core.ultrasound.detection.detect import Detection

Lacks = Literal["nothing", "maps", "distance", "bone", "certainty"]
LACKS: tuple[Lacks, ...] = ("nothing", "maps", "distance", "bone", "certainty")  # by `Shortfall`


@dataclass(frozen=True, slots=True)
class TriedLift:
    """One lift of a search, and the probability of its best placement."""

    lift_mm: float
    probability: float


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBed:
    """A bed laid on the bone. What is None is not known, since not all of the bed is mapped."""

    placement: Placement
    T_base_bed: Pose
    lacks: Lacks
    chance: Chance | None  # that the limit holds everywhere below the bed
    residual_mm: float | None  # least bone below it, by the maps
    thinnest_base: Vector3 | None  # (3,) lowest place of the bed there
    rim_above_mm: float  # by which bone stands above the seat at the rim, at most
    rim_below_mm: float  # by which the seat stands out of the bone there, at most
    unmapped_mm: float  # to the next cell that is not mapped
    screws: tuple[ScrewFigures, ...]

    @property
    def probability(self) -> float:
        """Least probability of the bed and of each screw; 0 where it is not known."""
        if self.chance is None:
            return 0.0
        return min(self.chance.probability, *(s.chance.probability for s in self.screws), 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class ImplantBed:
    """Step 10: an implant, what was asked of its bed, and where that lies."""

    implant: str
    lift_mm: float
    limit_mm: float
    required: float  # probability
    burr_mm: float
    placed: PlacedBed | None  # None: nowhere is it wholly mapped
    refusal: str | None  # why it is not safe; None where it is
    tried: tuple[TriedLift, ...] = ()  # of a search
    probability: Floats | None = None  # (nu, nv) with its middle in each cell, best turned; search
    lacks: Ints | None = None  # (nu, nv) of these, rows of ``LACKS``
    # 3D standard deviation of the registered tip of the burr; None: it was not registered
    burr_sigma_mm: float | None = field(default=None, metadata=OMIT_EMPTY)


WANTED = "place the implant bed (step 10)"
BED: Input[ImplantBed] = result_input("bed")
MILLING: Input[MillingPlan] = result_input("milling")


def _execution_error(burr: BurrRegistration | None, robot: str) -> ExecutionError:
    return execution_error(robot, None if burr is None else burr.tip_sigma_mm)


EXECUTION: Quantity[ExecutionError] = Quantity(
    _execution_error, {"burr": KNOWN_BURR, "robot": MODEL}
)


@inputs(implied=OF_MAPS)
class BedInputs:
    """What a bed is laid in."""

    maps: Maps = given(MAPS, "maps")
    tool: ToolRegistration = given(TOOL, "tool")
    burr: BurrRegistration | None = given(KNOWN_BURR, "burr")
    execution: ExecutionError = given(EXECUTION)
    terms: MapTerms | None = given(TERMS)

    @property
    def burr_sigma_mm(self) -> float | None:
        """3D standard deviation of the registered tip of the burr; None: it was not registered."""
        return None if self.burr is None else self.burr.tip_sigma_mm


@inputs(implied=(*OF_MAPS, "painted regions"))
class LinesInputs:
    """What lines for a bed are found with."""

    bed: ImplantBed = given(BED, "bed")
    maps: Maps = given(MAPS, "maps")
    tool: ToolRegistration = given(TOOL, "tool")
    execution: ExecutionError = given(EXECUTION)
    terms: MapTerms | None = given(TERMS)
    detection: Detection = given(DETECTION, "detection")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")


@inputs()
class MillingInputs:
    """What the milling of a bed is planned with."""

    bed: ImplantBed = given(BED, "bed")
    maps: Maps = given(MAPS, "maps")
    tool: ToolRegistration = given(TOOL, "tool")
    burr: BurrRegistration | None = given(KNOWN_BURR, "burr")
    robot: str = given(MODEL, "robot")
    obstacles: Obstacles = given(OBSTACLES, "obstacles")


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


LINE_DRAWS = 600  # of the maps: half of them choose the lines, half tell what they are worth
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
    draws = draws_of(known.maps, known.terms, LINE_DRAWS, same_robot=True, grooves=True)
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
