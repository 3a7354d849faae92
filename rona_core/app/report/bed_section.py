"""Section of the report about the implant bed: does it fit, what it leaves, how it is milled."""

from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.bed_figures import (
    LIFT_HEAD,
    SCREW_HEAD,
    bed_rows,
    lift_rows,
    milling_rows,
    screw_rows,
)
from rona_core.app.report.page import Html, badge, facts, joined, note, table, tag
from rona_core.app.steps.implant.implant_bed import ImplantBed, PlacedBed
from rona_core.app.steps.implant.milling_motion import milling_stale
from rona_core.app.steps.implant.milling_plan import MillingPlan, milling_verdict
from rona_core.app.steps.implant.rehearsal import (
    Rehearsal,
    rehearsal_ok,
    rehearsal_stale,
    rehearsal_verdict,
)
from rona_core.app.steps.implant.view import milling_view, percent, verdict
from rona_core.session.document import Session

NO_ROBOT = "No robot has been asked whether it can mill it."
NOT_REHEARSED = "The milling has not been rehearsed."
_SCREWS = ("", "n", "n", "n")
_LIFTS = ("n", "n", "v")


def bed_section(session: Session) -> Html:
    """Return the implant bed of step 10, unless it is missing or stale."""
    title, held = tag("h2", "Implant bed"), session.results.get("bed")
    if held is None:
        return joined((title, note("No implant bed placed yet (step 10).", "warn")))
    reason = stale_reason("bed", session)
    if reason is not None:
        return joined((title, note(f"Stale, left out: {reason}.", "warn")))
    bed: ImplantBed = held.value
    parts = [title, note(verdict(bed), "good" if bed.refusal is None else "warn")]
    if bed.placed is not None:
        parts.append(facts(_figures(bed, bed.placed)))
        if bed.placed.screws:
            parts.append(table(SCREW_HEAD, screw_rows(bed.placed), _SCREWS))
    if bed.tried:
        rows = [(*cells, badge(kept)) for *cells, kept in lift_rows(bed)]
        parts.append(table(LIFT_HEAD, rows, _LIFTS))
    if bed.placed is not None and bed.placed.residual_mm is not None:
        parts.append(tag("h3", "Milling path"))
        parts.append(facts(milling_rows(milling_view(session))))
        parts += [_by_robot(session), _rehearsed(session)]
    return joined(parts)


def _by_robot(session: Session) -> Html:
    held = session.results.get("milling")
    if held is None:
        return tag("p", NO_ROBOT, css="soft")
    plan: MillingPlan = held.value
    return _note(milling_stale(session), "motion", milling_verdict(plan), plan.may_move)


def _rehearsed(session: Session) -> Html:
    held = session.results.get("rehearsal")
    if held is None:
        return tag("p", NOT_REHEARSED, css="soft")
    found: Rehearsal = held.value
    return _note(
        rehearsal_stale(session), "rehearsal", rehearsal_verdict(found), rehearsal_ok(found)
    )


def _note(stale: str | None, what: str, words: str, good: bool) -> Html:
    if stale is not None:
        return note(f"The {what} is stale, left out: {stale}.", "warn")
    return note(words, "good" if good else "warn")


def _figures(bed: ImplantBed, placed: PlacedBed) -> tuple[tuple[str, object], ...]:
    """Return what was asked of the bed, and what it leaves of the bone."""
    at = placed.placement
    return (
        ("Implant", bed.implant),
        ("Lift", f"{bed.lift_mm:g} mm"),
        ("Asked", f"{bed.limit_mm:g} mm with {percent(bed.required)}"),
        ("Place u, v", f"{at.u_mm:.1f}, {at.v_mm:.1f} mm"),
        *bed_rows(bed, placed),
    )
