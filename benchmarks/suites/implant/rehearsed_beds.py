"""Beds rehearsed on one virtual patient: as searched, and too deep on purpose."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.random import Generator

from rona_core.app.runtime.handling import compute_result
from rona_core.app.steps.implant.derivation import ImplantBed, PlacedBed
from rona_core.app.steps.implant.messages import PlaceBed, PlanMilling
from rona_core.app.steps.implant.milling import robot_path_of
from rona_core.app.steps.implant.rehearsal import (
    FloorScan,
    RaisedMilling,
    floor_detector,
    milling_task,
    task_along,
)
from rona_core.app.steps.implant.view import milling_model, milling_plan_of, milling_view
from rona_core.compose import milling_site, new_workbench
from rona_core.errors import RonaError
from rona_core.evaluation.milling_metrics import Seated, seated
from rona_core.geometry.arrays import Floats
from rona_core.planning.implants.implant import MOST_LIFT_MM
from rona_core.planning.placement.problem import Placement
from rona_core.planning.rehearsal.rehearse import Guards, MillingTask, burr_way, rehearse
from rona_core.robot.redundancy.margins import joint_path
from rona_core.robot.redundancy.result import RollVerdict
from rona_core.robot.trajectory.cutting_timing import path5d_at
from rona_core.session.document import Session

POSTURE_MM = 3.0  # of way, between postures for a bed that is not planned through the robot
IMPLANTS: tuple[str, ...] = ("BCI 602", "BCI 601")  # the second is twice as deep
TOO_DEEP_MM = (-0.8, 0.4)  # least residual by the maps
GUARDS = {
    "all guards": Guards(),
    "force alone": Guards(rescan=False),
    "no guard": Guards(rescan=False, stop_on_force=False),
}


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsed:
    """How one rehearsal went, and what it did to the true bone."""

    patient: int
    deep: bool  # on purpose
    guards: str
    limit_mm: float
    mapped_mm: float  # least residual of the planned bed, by the maps
    left_mm: Floats  # (n,) true residual at every step; negative: through
    stopped: bool
    raised_mm: float
    asked: int  # places of the floor that were scanned again
    measured_off_mm: Floats  # (m,) residual by the re-scan less that of the true bone
    mapped_off_mm: Floats  # (m,) and by the maps, at the same places
    most_n: float
    through: Floats  # (n,) probability at every step that the burr was through
    seated: Seated | None  # the implant in the bone; None where the milling was stopped
    certified: bool | None = None  # the motion of raised layers; None where there are none
    scan_certified: bool | None = None  # and that of the re-scan; None where no place is for it

    @property
    def least_mm(self) -> float:
        """Return the least true bone that was left."""
        return float(self.left_mm.min())


def rehearsed(
    number: int, session: Session, generator: Generator, deep_beds: int
) -> Iterator[Rehearsed]:
    """Yield rehearsals of the searched bed and of deeper ones at its place, with every guard."""
    held = session.results.get("bed")
    if held is None or held.value.placed is None or held.value.refusal is not None:
        return
    with_plan = planned(session)
    plan = milling_plan_of(with_plan)
    if plan is None or not plan.may_move:
        return
    for bed in range(1 + deep_beds):
        aimed: Session | None = with_plan
        if bed:
            aimed = _too_deep(session, held.value, held.value.placed, generator)
        if aimed is None:
            continue
        verdict = plan.verdicts[plan.chosen]
        raised, scan = RaisedMilling(aimed, verdict.roll_deg), FloorScan(aimed)
        try:
            task = (
                task_with_roll(aimed, verdict, raised, scan)
                if bed
                else milling_task(aimed, raised, scan)
            )
        except RonaError:
            continue  # the deeper bed has no path, or no posture there
        for name in GUARDS:
            one = _rehearsed(number, aimed, task, name, bed)
            anew, again = (raised.plan, scan.plan) if GUARDS[name].rescan else (None, None)
            yield replace(
                one,
                certified=None if anew is None else anew.may_move,
                scan_certified=None if again is None else again.may_move,
            )


def planned(session: Session) -> Session:
    """Return the session with the milling of its bed planned."""
    bench = new_workbench(session)
    bench.run(PlanMilling())
    with_plan = bench.session
    bench.close()
    return with_plan


def _rehearsed(number: int, session: Session, task: MillingTask, name: str, bed: int) -> Rehearsed:
    site = milling_site(session, bed)
    detector = floor_detector(session, task.way.T_base_bed)
    outcome = rehearse(task, site, detector, GUARDS[name])
    off = mapped_off = np.zeros(0)
    if outcome.measured is not None and site.scanned_mm is not None:
        true = site.scanned_mm[outcome.measured.scans]
        off, mapped_off = outcome.measured.residual_mm - true, outcome.measured.mapped_mm - true
    return Rehearsed(
        patient=number,
        deep=bed > 0,
        guards=name,
        limit_mm=task.limit_mm,
        mapped_mm=float(task.mapped(task.way.bottoms_bed)[0].min()),
        left_mm=np.array(site.least_mm),
        stopped=outcome.stopped,
        raised_mm=outcome.raised_mm,
        asked=outcome.asked,
        measured_off_mm=off,
        mapped_off_mm=mapped_off,
        most_n=outcome.most_n,
        through=outcome.through,
        seated=None if outcome.stopped else seated(milling_view(session).implant, site.left_bone()),
    )


def _too_deep(
    session: Session, held: ImplantBed, placed: PlacedBed, generator: Generator
) -> Session | None:
    """Return the session with a bed there that leaves a drawn residual; None: no lift does."""
    wanted = float(generator.uniform(*TOO_DEEP_MM))
    for name in IMPLANTS:
        deepest = laid(session, held, placed.placement, name, 0.0)
        if deepest is None:
            continue
        lift_mm = wanted - deepest[1]
        if 0.0 <= lift_mm <= MOST_LIFT_MM:
            found = laid(session, held, placed.placement, name, lift_mm)
            return None if found is None else found[0]
    return None


def laid(
    session: Session, held: ImplantBed, place: Placement, name: str, lift_mm: float
) -> tuple[Session, float] | None:
    """Return the session with a bed at a place, and what it leaves by the maps; None: not known."""
    angle, tilt_x, tilt_y = np.rad2deg((place.angle_rad, place.tilt_x_rad, place.tilt_y_rad))
    message = PlaceBed(
        place.u_mm,
        place.v_mm,
        float((angle + 180.0) % 360.0 - 180.0),
        float(tilt_x),
        float(tilt_y),
        implant=name,
        limit_mm=held.limit_mm,
        probability=held.required,
        lift_mm=lift_mm,
    )
    aimed = compute_result(message, session)
    bed: Any = aimed.results.more["bed"].value
    left = None if bed.placed is None else bed.placed.residual_mm
    return None if left is None else (aimed, float(left))


def task_with_roll(
    session: Session, verdict: RollVerdict, raised: RaisedMilling, scan: FloorScan
) -> MillingTask:
    """Return a rehearsal with a roll that does for another bed at the same place."""
    view = milling_view(session)
    cutting = robot_path_of(view).cutting
    total_mm = float(cutting.way_mm()[-1])
    ways = np.linspace(0.0, total_mm, int(np.ceil(total_mm / POSTURE_MM)) + 1)
    model = milling_model(session, view)
    roll_rad = float(np.deg2rad(verdict.roll_deg))
    qs = joint_path(path5d_at(cutting, ways), model, roll_rad, verdict.branch)
    feeds = cutting.feeds_mm_per_s[cutting.moves_at(ways)]
    times_s = np.cumsum(np.diff(ways, prepend=0.0) / feeds)
    way = burr_way(robot_path_of(view), view.path.layers, ways, qs, times_s)
    return task_along(session, way, raised, scan)
