"""Step 10: the bed of an implant, searched or laid by hand, and how the robot mills it."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message
from rona_core.app.dependencies.inputs import result_input
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.handling import compute_one, compute_result, computed, strip_for_worker
from rona_core.app.steps.implant.bed_lines import BedLines, derive_bed_lines
from rona_core.app.steps.implant.burr.derivation import KNOWN_BURR
from rona_core.app.steps.implant.derivation import derive_placed, derive_search
from rona_core.app.steps.implant.export import EXPORTS
from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.messages import (
    PlaceBed,
    PlanMilling,
    RehearseMilling,
    StartBedLines,
    StartBedSearch,
)
from rona_core.app.steps.implant.milling_derivation import derive_milling
from rona_core.app.steps.implant.milling_motion import milling_plan_of
from rona_core.app.steps.implant.milling_plan import (
    MillingPlan,
    milling_summary,
    why_no_milling,
)
from rona_core.app.steps.implant.rehearsal import Rehearsal
from rona_core.app.steps.implant.view import WANTED, percent
from rona_core.app.steps.setup.inputs import MODEL, OBSTACLES
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session

MAPS, TOOL, BED = result_input("maps"), result_input("tool"), result_input("bed")
INPUTS = {"maps": MAPS, "tool": TOOL, "burr": KNOWN_BURR}
MILLING, DETECTION = result_input("milling"), result_input("detection")
MILLED = {"bed": BED, **INPUTS, "robot": MODEL, "obstacles": OBSTACLES}

REHEARSED = {
    "milling": MILLING,
    "bed": BED,
    "maps": MAPS,
    "detection": DETECTION,
    "burr": KNOWN_BURR,
}


def rehearse_milling(
    activity: RehearseMilling, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Carry out `RehearseMilling`."""
    if context.rehearse is None:
        raise StepBlockedError("RehearseMilling is blocked: there is no virtual bone to mill")
    found = context.run(context.rehearse, strip_for_worker(session), activity)
    return computed(activity, {"rehearsal": found}, session)


def _refused(session: Session) -> str | None:
    held = session.results.get("bed")
    return None if held is None else held.value.refusal


def _summary(session: Session) -> str:
    held = session.results.get("bed")
    if held is None:
        return ""
    bed: ImplantBed = held.value
    if bed.refusal is not None or bed.placed is None:
        return f"{bed.implant} does not fit safely"  # the verdict tells why
    lift = f", lift {bed.lift_mm:g} mm" if bed.lift_mm > 0.0 else ""
    return f"{bed.implant}{lift}, safe with {percent(bed.placed.probability)}{_milled(session)}"


def _milled(session: Session) -> str:
    """Return what became of the plan to mill the bed, as long as it is of this bed."""
    held = session.results.get("milling")
    if held is None or stale_reason("milling", session) is not None:
        return ""
    return f"; {milling_summary(held.value)}"


def _nowhere_laid(session: Session) -> str | None:
    """Return why no line makes a bed that is there and fresh more certain."""
    held = session.results.get("bed")
    if held is None or stale_reason("bed", session) is not None:
        return None
    placed = held.value.placed
    if placed is not None and placed.residual_mm is not None:
        return None
    return f"first lay the bed where both boundaries are mapped (step 10): {held.value.refusal}"


def _not_to_be_milled(session: Session) -> str | None:
    """Return why a bed that is there and fresh is not to be milled."""
    refusal = None if stale_reason("bed", session) else _refused(session)
    return None if refusal is None else f"first lay a bed that is safe (step 10): {refusal}"


def _not_to_be_rehearsed(session: Session) -> str | None:
    """Return why a plan that is there and fresh is not to be rehearsed."""
    plan = None if stale_reason("milling", session) else milling_plan_of(session)
    return None if plan is None else why_no_milling(plan)


STEP = declare.Step(
    "implant",
    commands=(declare.Command(PlaceBed, compute_result, needs=(MAPS, TOOL)),),
    activities=(
        declare.Activity(
            StartBedSearch, compute_one, "Searching the implant bed", needs=(MAPS, TOOL)
        ),
        declare.Activity(
            StartBedLines,
            compute_one,
            "Finding lines for the bed",
            needs=(BED, MAPS, TOOL, DETECTION),
            blocked=_nowhere_laid,
        ),
        declare.Activity(
            PlanMilling,
            compute_one,
            "Planning the milling",
            needs=(BED, MAPS, TOOL),
            blocked=_not_to_be_milled,
        ),
        declare.Activity(
            RehearseMilling,
            rehearse_milling,
            "Rehearsing the milling",
            needs=(MILLING, BED, MAPS),
            blocked=_not_to_be_rehearsed,
        ),
    ),
    exports=EXPORTS,
    results=(
        declare.Result("bed", StartBedSearch, derive_search, INPUTS, WANTED, types=(ImplantBed,)),
        declare.Result("bed", PlaceBed, derive_placed, INPUTS, WANTED),
        declare.Result(
            "lines",
            StartBedLines,
            derive_bed_lines,
            {"bed": BED, **INPUTS},
            "find lines for the bed (step 10)",
            types=(BedLines,),
        ),
        declare.Result(
            "milling",
            PlanMilling,
            derive_milling,
            MILLED,
            "plan the milling (step 10)",
            types=(MillingPlan,),
        ),
        declare.Result(
            "rehearsal",
            RehearseMilling,
            None,
            REHEARSED,
            "rehearse the milling (step 10)",
            types=(Rehearsal,),
        ),
    ),
    line=declare.StepLine(
        "Implant bed", _summary, StartBedSearch, leaves=lambda session: (BED,), unusable=_refused
    ),
)
