"""Accepted beds of one virtual patient, rehearsed: where did the force stop the burr?

Of each implant the bed that step 10 finds, and others wherever it accepts that implant with that
lift: at these less bone is to spare. How the robot mills is planned for the first bed; the others
are milled with the roll of that plan.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from benchmarks.suites.implant.rehearsed_beds import GUARDS, laid, planned, task_with_roll
from rona_core.app.steps.implant.derivation import ImplantBed
from rona_core.app.steps.implant.messages import StartBedSearch
from rona_core.app.steps.implant.rehearsal import FloorScan, RaisedMilling, floor_detector
from rona_core.app.steps.implant.view import milling_plan_of
from rona_core.compose import milling_site, new_workbench
from rona_core.errors import InvalidInputError, RonaError
from rona_core.geometry.arrays import Floats
from rona_core.planning.rehearsal.rehearse import MillingTask, rehearse
from rona_core.robot.redundancy.result import RollVerdict
from rona_core.session.document import Session

APART_MM = 3.0  # between beds of one implant
TRIES = 20  # of places for a further bed
STOPPING = ("all guards", "force alone")


@dataclass(frozen=True, slots=True)
class Guarded:
    """How a bed was milled with some of the guards."""

    stopped: bool  # by the force
    here_mm: float  # true bone below the burr at its last step
    least_mm: float  # least true bone below any step
    raised_mm: float  # by which the floor is higher than planned
    most_through: float  # probability that the burr is through, the largest of all steps


@dataclass(frozen=True, slots=True)
class AcceptedBed:
    """A bed that step 10 accepts: milled as planned with no guard, and with some."""

    patient: int
    implant: str
    searched: bool  # the one that the search finds, else a further one
    limit_mm: float
    predicted_mm: float  # least bone left, by the maps
    probability: float
    left_mm: float  # least true bone left as planned: no guard stops or raises the burr
    guarded: dict[str, Guarded]

    @property
    def kept(self) -> bool:
        """Return whether the true bone keeps the limit as planned."""
        return self.left_mm >= self.limit_mm


def rehearsed_beds(
    number: int, session: Session, beds: Mapping[str, int], generator: Generator
) -> Iterator[AcceptedBed]:
    """Yield rehearsals of the accepted beds of a patient.

    Args:
        number: Of the patient.
        session: With maps, and the burr registered.
        beds: How many of each implant at most, the one that the search finds among them.
        generator: Draws the places of the others.
    """
    verdict: RollVerdict | None = None
    count = 0
    for aimed, searched in accepted(session, beds, generator):
        if verdict is None:
            plan = milling_plan_of(planned(aimed))
            if plan is None or not plan.may_move:
                continue  # the robot cannot mill this one
            verdict = plan.verdicts[plan.chosen]
        raised, scan = RaisedMilling(aimed, verdict.roll_deg), FloorScan(aimed)
        try:
            task = task_with_roll(aimed, verdict, raised, scan)
        except RonaError:
            continue  # no posture there
        count += 1
        yield _rehearsed(number, aimed, task, count, searched)


def accepted(
    session: Session, beds: Mapping[str, int], generator: Generator
) -> Iterator[tuple[Session, bool]]:
    """Yield the session with each accepted bed, and whether that is the one of the search."""
    for name, most in beds.items():
        aimed = _searched(session, name)
        if aimed is None:
            continue
        held = _bed_of(aimed)
        if held.refusal is not None:
            continue
        yield aimed, True
        for other in _further(session, held, name, most - 1, generator):
            yield other, False


def _searched(session: Session, name: str) -> Session | None:
    """Return the session with the bed that step 10 finds; None: it is larger than the maps."""
    bench = new_workbench(session)
    try:
        bench.run(StartBedSearch(implant=name))
        return bench.session
    except InvalidInputError:
        return None
    finally:
        bench.close()


def _further(
    session: Session, held: ImplantBed, name: str, count: int, generator: Generator
) -> Iterator[Session]:
    """Yield the session with beds where the search would accept them as well, drawn."""
    if held.placed is None or held.probability is None or session.results.maps is None:
        return
    outer = session.results.maps.value.outer
    i, j = np.nonzero(held.probability >= held.required)
    places = np.column_stack((outer.u_mm[i], outer.v_mm[j]))
    first = held.placed.placement
    taken: list[Floats] = [np.array((first.u_mm, first.v_mm))]
    for row in generator.permutation(len(places))[:TRIES].tolist():
        if len(taken) > count:
            return
        if np.linalg.norm(np.array(taken) - places[row], axis=1).min() < APART_MM:
            continue
        u_mm, v_mm = places[row].tolist()
        found = laid(session, held, replace(first, u_mm=u_mm, v_mm=v_mm), name, held.lift_mm)
        if found is not None and _bed_of(found[0]).refusal is None:
            taken.append(places[row])
            yield found[0]


def _rehearsed(
    number: int, session: Session, task: MillingTask, count: int, searched: bool
) -> AcceptedBed:
    held = _bed_of(session)
    placed: Any = held.placed
    free = milling_site(session, count)
    free.follow(task.way)
    free.drive()
    guarded: dict[str, Guarded] = {}
    for name in STOPPING:
        site = milling_site(session, count)
        detector = floor_detector(session, task.way.T_base_bed)
        outcome = rehearse(task, site, detector, GUARDS[name])
        guarded[name] = Guarded(
            stopped=outcome.stopped,
            here_mm=site.least_mm[-1],
            least_mm=min(site.least_mm),
            raised_mm=outcome.raised_mm,
            most_through=float(outcome.through.max()),
        )
    return AcceptedBed(
        patient=number,
        implant=held.implant,
        searched=searched,
        limit_mm=held.limit_mm,
        predicted_mm=placed.residual_mm,
        probability=placed.probability,
        left_mm=min(free.least_mm),
        guarded=guarded,
    )


def _bed_of(session: Session) -> ImplantBed:
    found: Any = session.results.more["bed"].value
    return found
