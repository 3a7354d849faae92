"""Step 10: the bed of an implant, searched or laid by hand, and how the robot mills it."""

from dataclasses import replace

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import (
    USABLE,
    ActivityContext,
    Judgement,
    Message,
    Remedy,
)
from rona_core.app.declarations.figures import FIGURES
from rona_core.app.declarations.inputs import Input
from rona_core.app.dependencies.judge import fresh, judge_part
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.handling import compute, compute_result, computed, strip_for_worker
from rona_core.app.steps.acoustics.derivation import DETECTION
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.implant.burr.derivation import KNOWN_BURR
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.derivation import (
    BED,
    MILLING,
    WANTED,
    ImplantBed,
    find_bed_lines,
    lay_bed,
    search_bed,
)
from rona_core.app.steps.implant.export import EXPORTS
from rona_core.app.steps.implant.messages import (
    PlaceBed,
    PlanMilling,
    RehearseMilling,
    StartBedLines,
    StartBedSearch,
)
from rona_core.app.steps.implant.milling import plan_bed_milling
from rona_core.app.steps.implant.milling_plan import (
    MillingPlan,
    milling_summary,
    why_no_milling,
)
from rona_core.app.steps.implant.rehearsal import Rehearsal
from rona_core.app.steps.maps.inputs import MAPS
from rona_core.app.steps.maps.messages import StartTiltPlan, StartTiltScan
from rona_core.app.steps.scan.messages import StartProbeMountingCapture
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.errors import StepBlockedError
from rona_core.session.document import Session

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
        raise StepBlockedError("there is no virtual bone to mill")
    found = context.run(context.rehearse, strip_for_worker(session), activity)
    return computed(activity, {"rehearsal": found}, session)


# What maps more of the bone or makes it more certain, and so more beds safe: part, its remedy
FURTHER = {
    "second": Remedy("plan the tilted passes (step 9)", StartTiltPlan()),
    "capture second": Remedy("scan with the probe tilted (step 9)", StartTiltScan()),
    "burr": Remedy("register the burr (step 10)", StartBurrCapture()),
    "mounting": Remedy("record on the gauge plate (step 8)", StartProbeMountingCapture()),
    "speed": Remedy("measure reference points (step 9)", StartCaliperMeasurements()),
}

# implant, and one that conducts sound through the bone as well and needs less of it
LESS_BONE = {"BCI 601": "BCI 602", "BCI 602": "Osia/Baha screw"}


def judge_bed(bed: ImplantBed, session: Session) -> Judgement:
    """Return whether a bed is safe; else what was not done yet and would make more beds so.

    One that was laid by hand is searched for first.
    """
    if bed.refusal is None:
        return USABLE
    words = f"first lay a bed that is safe (step 10): {bed.refusal}"
    if not bed.tried:
        search = StartBedSearch(implant=bed.implant)
        return Judgement("bad", words, Remedy("search the bed (step 10)", search))
    for name, remedy in FURTHER.items():
        if judge_part(name, session).state == "missing":
            return Judgement("bad", words, remedy)
    return Judgement("bad", words, other_bed(bed, session))


def other_bed(bed: ImplantBed, session: Session) -> Remedy:
    """Return what may give a bed where all measurements are done: a scan, a lift, or an implant."""
    maps = judge_part("maps", session)
    if maps.remedy is not None:
        return maps.remedy
    held = session.results.get("bed")
    asked = StartBedSearch() if held is None else message_from(held.message, held.arguments)
    if asked.lift_mm is not None:
        search = replace(asked, lift_mm=None)
        return Remedy("allow every lift and search the bed again (step 10)", search)
    if bed.implant in LESS_BONE:
        other = LESS_BONE[bed.implant]
        search = replace(asked, implant=other, burr_mm=None)
        return Remedy(f"search the bed of the {other}, which needs less bone (step 10)", search)
    return Remedy("choose another implant (step 10) or another region (step 1)")


def judge_milling(plan: MillingPlan, session: Session) -> Judgement:
    """Return whether the robot can mill the bed."""
    reason = why_no_milling(plan)
    if reason is None:
        return USABLE
    return Judgement("bad", reason, Remedy("lay the bed elsewhere (step 10) or move the base"))


def _mapped_bed(session: Session) -> object:
    """Return the bed where both boundaries are mapped below it, safe or not."""
    held = session.results.get("bed")
    placed = None if held is None else held.value.placed
    return None if placed is None or placed.residual_mm is None else held


def _summary(session: Session) -> str:
    held = session.results.get("bed")
    if held is None:
        return ""
    bed: ImplantBed = held.value
    if bed.refusal is not None or bed.placed is None:
        return f"{bed.implant} does not fit safely"  # the verdict says why
    lift = f", lift {bed.lift_mm:g} mm" if bed.lift_mm > 0.0 else ""
    sure = FIGURES["bed_probability"].words(bed.placed.probability)
    return f"{bed.implant}{lift}, safe with {sure}{_milled(session)}"


def _milled(session: Session) -> str:
    """Return what became of the plan to mill the bed, as long as it is of this bed."""
    plan = fresh("milling", session)
    return "" if plan is None else f"; {milling_summary(plan)}"


MAPPED_BED = Input(
    _mapped_bed, "lay the bed where both boundaries are mapped (step 10)", "bed", takes_bad=True
)
STEP = declare.Step(
    "implant",
    commands=(declare.Command(PlaceBed, compute_result, needs=(MAPS, TOOL)),),
    activities=(
        declare.Activity(StartBedSearch, compute, "Searching the implant bed", needs=(MAPS, TOOL)),
        declare.Activity(
            StartBedLines,
            compute,
            "Finding lines for the bed",
            needs=(MAPPED_BED, MAPS, TOOL, DETECTION),
        ),
        declare.Activity(
            PlanMilling,
            compute,
            "Planning the milling",
            needs=(BED, MAPS, TOOL),
        ),
        declare.Activity(
            RehearseMilling,
            rehearse_milling,
            "Rehearsing the milling",
            needs=(MILLING, BED, MAPS),
        ),
    ),
    exports=EXPORTS,
    results=(
        declare.Result.of(
            "bed",
            StartBedSearch,
            search_bed,
            WANTED,
            judged=judge_bed,
            done="the implant bed was placed",
        ),
        declare.Result.of(
            "bed", PlaceBed, lay_bed, WANTED, judged=judge_bed, done="the implant bed was placed"
        ),
        declare.Result.of(
            "lines",
            StartBedLines,
            find_bed_lines,
            "find lines for the bed (step 10)",
            done="the lines for the bed were found",
        ),
        declare.Result.of(
            "milling",
            PlanMilling,
            plan_bed_milling,
            "plan the milling (step 10)",
            judged=judge_milling,
            done="the milling was planned",
        ),
        declare.Result(
            "rehearsal",
            RehearseMilling,
            REHEARSED,
            "rehearse the milling (step 10)",
            types=(Rehearsal,),
            done="the milling was rehearsed",
        ),
    ),
    line=declare.StepLine("Implant bed", _summary, StartBedSearch, leaves=lambda session: (BED,)),
)
