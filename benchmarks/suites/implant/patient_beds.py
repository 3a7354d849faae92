"""Beds on one virtual patient: drawn, and searched as step 10 does, with what the true bone leaves.

The bed comes to lie off its plan by what the registration of the burr does not know of the true
tip, with the robot turned anyhow about the burr, by a burr's seat in its chuck and by what the
robot does not repeat.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.random import Generator
from scipy.special import ndtri

from rona_core.app.runtime.handling import read_inputs
from rona_core.app.steps.implant.burr.derivation import KNOWN_BURR
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.derivation import (
    LIFT_STEP_MM,
    BedInputs,
    ImplantBed,
    mapped_bone,
    search_bed,
)
from rona_core.app.steps.implant.messages import StartBedSearch
from rona_core.app.steps.implant.view import FLOOR_MM
from rona_core.compose import new_workbench
from rona_core.devices.protocols import never, silent
from rona_core.errors import InvalidInputError
from rona_core.evaluation.map_metrics import residual_mm
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.probe_place import repeatability_mm
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import CATALOGUE, MOST_LIFT_MM, implant_named
from rona_core.planning.milling.plan_milling import milling_settings
from rona_core.planning.milling.removal import planned_bed
from rona_core.planning.placement.evaluate import (
    judge_placement,
    lowest_of_blocks,
    residuals,
    solid_points,
)
from rona_core.planning.placement.figures import PlacementFigures, chance_above
from rona_core.planning.placement.problem import Placement, PlacementLimits, PlacementProblem
from rona_core.session.document import Session
from rona_core.virtual.milling.milling_site import SEAT_MM

LEVELS = (0.05, 0.999)  # of P, even in standard normal quantiles
TRIES = 100  # of places for one bed
TILT_DEG = 3.0  # at most, as in a search
LIFTS_MM = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0)
LEAST_DEPTH_MM = 0.5
ROUNDS = 16  # of finding a limit: halves of its range
SEARCHED: tuple[str, ...] = ("BCI 602", "CI receiver", "Osia/Baha screw")


@dataclass(frozen=True, slots=True, eq=False)
class Patient:
    """A session with maps, and its true bone."""

    number: int
    session: Session
    truth: Truth


@dataclass(frozen=True, slots=True)
class Trial:
    """A bed with its predicted probability, and what the true bone leaves below it."""

    patient: int
    probability: float  # of the bed alone, without its screws
    predicted_mm: float  # least residual, by the maps
    left_mm: float  # least of the true bone
    limit_mm: float

    @property
    def kept(self) -> bool:
        """Return whether the true bone keeps the limit."""
        return self.left_mm >= self.limit_mm


@dataclass(frozen=True, slots=True)
class Search:
    """A search of step 10 with one lift; without a trial the bed can be laid nowhere."""

    patient: int
    implant: str
    accepted: bool
    best: Trial | None


def with_burr(session: Session) -> Session:
    """Return a session with its burr registered, as beds are laid; a replayed one has it."""
    if session.results.get("burr") is not None:
        return session
    bench = new_workbench(session)
    try:
        bench.run(StartBurrCapture())
        return bench.session
    finally:
        bench.close()


def drawn_beds(patient: Patient, generator: Generator, count: int) -> Iterator[Trial]:
    """Yield beds at random places, with limits that ask for drawn levels of P.

    A place where the bed is not wholly mapped, or where no limit gives that level, is drawn again.
    """
    known = read_inputs(BedInputs, patient.session)
    bone = mapped_bone(known.maps, known.terms)
    problem = PlacementProblem(bone, known.execution)
    cells = bone.places_mm()[bone.ok]
    for _ in range(count if len(cells) else 0):
        level = float(generator.uniform(*ndtri(LEVELS)))
        for _ in range(TRIES):
            bed = _bed(str(generator.choice(list(CATALOGUE))), float(generator.choice(LIFTS_MM)))
            u_mm, v_mm = generator.choice(cells).tolist()
            tilts = np.deg2rad(generator.uniform(-TILT_DEG, TILT_DEG, 2)).tolist()
            place = Placement(u_mm, v_mm, float(generator.uniform(-np.pi, np.pi)), *tilts)
            found = None if bed is None else _at_level(problem, bed, place, level)
            if bed is None or found is None:
                continue
            limit_mm, figures = found
            T_base_bed = _milled(patient, generator, bone.outer.T_base_map @ figures.T_map_bed)
            trial = _trial(patient, figures, limit_mm, T_base_bed @ _floor(bed))
            if trial is not None:
                yield trial
                break


def searched_beds(patient: Patient, generator: Generator, required: float) -> Iterator[Search]:
    """Yield what step 10 finds for each implant and lift, up to the smallest lift that is safe."""
    for name in SEARCHED:
        for lift_mm in np.arange(0.0, MOST_LIFT_MM + 1e-9, LIFT_STEP_MM).tolist():
            if _bed(name, lift_mm) is None:
                break
            message = StartBedSearch(implant=name, probability=required, lift_mm=lift_mm)
            try:
                known = read_inputs(BedInputs, patient.session)
                held = search_bed(known, message, progress=silent, cancel=never)
            except InvalidInputError:  # larger than what is mapped, so no other lift helps
                yield Search(patient.number, name, False, None)
                break
            accepted = held.refusal is None
            yield Search(patient.number, name, accepted, _best(patient, generator, held))
            if accepted or held.placed is None:
                break


def _best(patient: Patient, generator: Generator, held: ImplantBed) -> Trial | None:
    """Return the bed that a search laid, milled."""
    placed, bed = held.placed, _bed(held.implant, held.lift_mm)
    if placed is None or placed.chance is None or placed.residual_mm is None or bed is None:
        return None
    T_base_bed = _milled(patient, generator, placed.T_base_bed)
    left = residual_mm(T_base_bed @ _floor(bed), patient.truth)
    if left is None:
        return None
    chance, predicted = placed.chance.probability, placed.residual_mm
    return Trial(patient.number, chance, predicted, left, held.limit_mm)


def _milled(patient: Patient, generator: Generator, T_base_bed: Pose) -> Pose:
    """Return where a bed comes to lie that was planned at a pose."""
    burr = KNOWN_BURR.read(patient.session)
    off_tip = patient.truth.scene.world.spindle_off_tip
    off_tip = off_tip - (np.zeros(3) if burr is None else burr.offset_tip)
    turned = Pose.from_rotvec((0.0, 0.0, float(generator.uniform(-np.pi, np.pi))))
    off_bed = turned @ (off_tip * (1.0, -1.0, -1.0))  # the tip looks into the bone
    again_mm = repeatability_mm(patient.session.setup.devices.robot.model)
    chance_mm = float(np.hypot(SEAT_MM, again_mm))
    return T_base_bed @ Pose.from_translation(off_bed + generator.normal(0.0, chance_mm, 3))


def _at_level(
    problem: PlacementProblem, bed: Bed, place: Placement, level: float
) -> tuple[float, PlacementFigures] | None:
    """Return a limit that gives about this standard normal quantile of P, and the placement.

    By what is left below the places of the floor; with the limit from that, P is what step 10 says.
    """

    def at(limit_mm: float) -> PlacementFigures:
        problem.limits = PlacementLimits(limit_mm)
        return judge_placement(problem, solid_points(problem, bed), place)

    figures = at(0.0)
    if figures.chance is None:
        return None
    floor = lowest_of_blocks(bed, problem.bone.cell_mm)
    drawn, _ = residuals(problem, figures.T_map_bed, figures.T_map_bed @ floor)
    least = drawn.min(axis=0)
    if chance_above(least, 0.0).score < level:
        return None
    low, high = 0.0, 10.0
    for _ in range(ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if chance_above(least, middle).score > level else (low, middle)
    return low, at(low)


def _trial(
    patient: Patient, figures: PlacementFigures, limit_mm: float, floor_base: Floats
) -> Trial | None:
    """Return how a bed turns out; None where the true bone has no inner boundary."""
    left = residual_mm(floor_base, patient.truth)
    if left is None or figures.residual_mm is None:
        return None
    chance = figures.probability
    return Trial(patient.number, chance, figures.residual_mm, left, limit_mm)


@cache
def _bed(name: str, lift_mm: float) -> Bed | None:
    """Return the bed of an implant of the catalogue; None where that lift leaves none."""
    implant = implant_named(name)
    if implant.terraces()[-1].depth_mm - lift_mm < LEAST_DEPTH_MM:
        return None
    implant = implant.lifted(lift_mm)
    return planned_bed(implant, milling_settings(implant, None))


def _floor(bed: Bed) -> Floats:
    """Return places (n, 3) all over the lower side of a bed, in ``bed``."""
    return lowest_of_blocks(bed, FLOOR_MM)
