"""Step 10: the bed of an implant, searched or laid by hand."""

from rona_core.app.declarations import declarations as declare
from rona_core.app.dependencies.inputs import result_input
from rona_core.app.runtime.handling import compute_one, compute_result
from rona_core.app.steps.implant.derivation import derive_placed, derive_search
from rona_core.app.steps.implant.implant_bed import ImplantBed
from rona_core.app.steps.implant.messages import PlaceBed, StartBedSearch
from rona_core.app.steps.implant.view import percent
from rona_core.session.document import Session

MAPS, TOOL, BED = result_input("maps"), result_input("tool"), result_input("bed")
INPUTS = {"maps": MAPS, "tool": TOOL}
WANTED = "place the implant bed (step 10)"


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
    return f"{bed.implant}{lift}, safe with {percent(bed.placed.probability)}"


STEP = declare.Step(
    "implant",
    commands=(declare.Command(PlaceBed, compute_result, needs=(MAPS, TOOL)),),
    activities=(
        declare.Activity(
            StartBedSearch, compute_one, "Searching the implant bed", needs=(MAPS, TOOL)
        ),
    ),
    results=(
        declare.Result("bed", StartBedSearch, derive_search, INPUTS, WANTED, types=(ImplantBed,)),
        declare.Result("bed", PlaceBed, derive_placed, INPUTS, WANTED),
    ),
    line=declare.StepLine(
        "Implant bed", _summary, StartBedSearch, leaves=lambda session: (BED,), unusable=_refused
    ),
)
