"""A rehearsal of the milling, as a session holds it, and what to say of it."""

from dataclasses import dataclass, field

import numpy as np

from rona_core.app.declarations.figures import FIGURES, percent
from rona_core.app.dependencies.judge import judge_part
from rona_core.app.runtime.process_pool import release_memory
from rona_core.app.steps.implant.messages import RehearseMilling
from rona_core.app.steps.implant.milling_motion import require_certified
from rona_core.app.steps.implant.milling_plan import MillingPlan, why_no_milling
from rona_core.app.steps.implant.rehearsal_task import (
    FloorScan,
    RaisedMilling,
    floor_detector,
    milling_task,
)
from rona_core.app.steps.roll.certificate_view import why_no_plan
from rona_core.devices.protocols import Cancel, Progress
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.planning.rehearsal.rehearse import rehearse
from rona_core.planning.rehearsal.site import MillingSite
from rona_core.robot.planning.plan import RobotPlan
from rona_core.session.codec import OMIT_EMPTY
from rona_core.session.document import Session
from rona_core.session.memo import remember

LEFT, RAISED = FIGURES["rehearsal_residual_mm"], FIGURES["rehearsal_raised_mm"]


@dataclass(frozen=True, slots=True, eq=False)
class Rehearsal:
    """Outcome of a rehearsal, from force and A-scans; nothing of it is the truth."""

    number: int
    limit_mm: float  # of bone, that was asked for
    required: float  # probability of that
    pause: int  # last layer before the floor was scanned again; -1: it was not
    ceiling_mm: float | None  # height in ``bed`` that was not to be passed after that
    steps: int  # done of the corrected way
    stopped: bool  # by the force
    asked: int  # places of the floor that were scanned
    scans: Ints  # (m,) those of them that counted
    places_bed: Floats  # (m, 3)
    measured_mm: Floats  # (m,) bone below them, by the probe
    mapped_mm: Floats  # (m,) and by the maps
    raised_mm: float  # by which the floor is higher than planned
    residual_mm: float  # least bone that is thought to be left
    probability: float  # that it is as much as was asked for
    duration_s: float  # of cutting
    most_n: float  # cutting force
    # the layers that were left, planned anew at their corrected depth; None: as planned before,
    # nothing was left, or a file of a version that did not plan them
    raised_plan: MillingPlan | None = field(default=None, metadata=OMIT_EMPTY)
    # how the probe scans the floor; None: no place for it, or a file of a version that did not plan
    floor_plan: RobotPlan | None = field(default=None, metadata=OMIT_EMPTY)


def derive_rehearsal(
    session: Session,
    message: RehearseMilling,
    site: MillingSite,
    *,
    progress: Progress,
    cancel: Cancel,
) -> Rehearsal:
    """Rehearse the planned milling at a site.

    Raises:
        StepBlockedError: there is no certified motion.
        StaleResultError: it is of another bed, robot or surroundings.
        CancelledError: ``cancel`` returned True.
    """
    release_memory()
    planned, _ = require_certified(session)
    raised = RaisedMilling(session, planned.verdicts[planned.chosen].roll_deg, cancel)
    floor_scan = FloorScan(session, cancel)
    task = milling_task(session, raised, floor_scan)
    detector = floor_detector(session, task.way.T_base_bed)
    outcome = rehearse(task, site, detector, progress=progress, cancel=cancel)
    measured = outcome.measured
    return Rehearsal(
        number=message.number,
        limit_mm=task.limit_mm,
        required=task.probability,
        pause=outcome.pause,
        ceiling_mm=None if np.isneginf(outcome.ceiling_mm) else outcome.ceiling_mm,
        steps=outcome.steps,
        stopped=outcome.stopped,
        asked=outcome.asked,
        scans=readonly(np.zeros(0, dtype=np.int64) if measured is None else measured.scans),
        places_bed=readonly(np.zeros((0, 3)) if measured is None else measured.places_bed),
        measured_mm=readonly(np.zeros(0) if measured is None else measured.residual_mm),
        mapped_mm=readonly(np.zeros(0) if measured is None else measured.mapped_mm),
        raised_mm=outcome.raised_mm,
        residual_mm=outcome.residual_mm,
        probability=outcome.probability,
        duration_s=outcome.duration_s,
        most_n=outcome.most_n,
        raised_plan=raised.plan,
        floor_plan=floor_scan.plan,
    )


@remember(4)  # sessions never change
def rehearsal_stale(session: Session) -> str | None:
    """Return why the rehearsal counts no more, None while it does."""
    found = judge_part("rehearsal", session)
    return found.reason if found.state == "stale" else None


def rehearsal_verdict(found: Rehearsal) -> str:
    """Return in one sentence how a rehearsal went."""
    if found.stopped:
        return (
            "Rehearsed: by force and maps the burr may have been through, and the milling was "
            f"stopped with {LEFT.words(found.residual_mm)} of bone thought to be left."
        )
    return (
        f"Rehearsed: {_floor(found)}; {_depth(found)}, and {found.limit_mm:g} mm of bone stay with "
        f"{percent(found.probability)}."
    )


def _floor(found: Rehearsal) -> str:
    """Return what the re-scan of the floor measured, or why there was none."""
    plan = found.floor_plan
    if not found.asked:
        why = None if plan is None else why_no_plan(plan)
        because = f", as no motion of the probe over it is certified: {why}" if why else ""
        return f"the floor could not be scanned again{because}"
    certified = ""
    if plan is not None and plan.trajectory is not None:
        certified = f" in a certified motion of {plan.trajectory.duration_s:.0f} s"
    return (
        f"the floor, scanned again at {found.asked} places{certified}, was measured at "
        f"{len(found.scans)}"
    )


def _depth(found: Rehearsal) -> str:
    """Return how deep was milled, and what became of the plan of the raised layers."""
    if found.ceiling_mm is None:
        return "the bed was milled as deep as planned"
    higher, plan = f"{RAISED.words(found.raised_mm)} higher than planned", found.raised_plan
    ended = f"milling ended with the last finished layer, {higher}"
    if not found.steps:
        ended = "nothing was milled"
    if plan is None:
        return ended
    motion = plan.certified_motion
    if motion is None:
        return (
            "the last layers had to end higher, but the robot cannot mill them so: "
            f"{why_no_milling(plan)}; {ended}"
        )
    minutes, seconds = divmod(round(motion.duration_s), 60)
    return (
        f"the last layers, planned anew and certified ({minutes} min {seconds:02d} s), ended "
        f"{higher}"
    )


def rehearsal_ok(found: Rehearsal) -> bool:
    """Return whether all went as planned, as surely as was asked."""
    return not found.stopped and bool(len(found.scans)) and found.ceiling_mm is None
