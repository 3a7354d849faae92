"""Sections of the report about steps, figures, calibrations, the motion and the bed."""

from collections.abc import Iterable, Mapping

from rona_core.app.declarations.figures import percent
from rona_core.app.dependencies.judge import StepState
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.acceptance import QualityRow, judgement, quality_table
from rona_core.app.overview.bed_figures import (
    LIFT_HEAD,
    SCREW_HEAD,
    bed_rows,
    lift_rows,
    milling_rows,
    screw_rows,
)
from rona_core.app.overview.bed_risk import bed_risk
from rona_core.app.overview.frame_graph import frame_rows
from rona_core.app.report.page import Html, badge, facts, joined, note, table, tag
from rona_core.app.steps.implant.derivation import ImplantBed, PlacedBed
from rona_core.app.steps.implant.milling_plan import MillingPlan, milling_verdict
from rona_core.app.steps.implant.rehearsal import (
    Rehearsal,
    rehearsal_ok,
    rehearsal_stale,
    rehearsal_verdict,
)
from rona_core.app.steps.implant.view import milling_stale, milling_view, verdict
from rona_core.app.steps.roll.certificate_view import (
    CLEARANCE,
    DURATION,
    CertificateView,
    certificate_view,
    plan_reason,
    roll_summary,
)
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.app.steps.scan.landmarks.step import verification
from rona_core.app.steps.scan.step import mounting_words
from rona_core.app.steps.scan.view import contact_report, delay_sentence, head_report
from rona_core.app.steps.tool.calibration_view import Step, calibration_view
from rona_core.app.steps.tool.derivation import delay_words
from rona_core.session.document import Session

TITLES: tuple[tuple[Step, str], ...] = (
    ("tool", "Tool and tracker (step 2)"),
    ("pointer", "Pointer (step 3)"),
)


def procedure_section(states: Iterable[StepState], rows: tuple[QualityRow, ...]) -> Html:
    """Return the steps: how each stands, and what its figures come to."""
    lines = [
        (
            f"{step.number} {step.title}",
            badge(step.state),
            step.reason,
            badge(judgement(rows, step.name).verdict) if step.state in ("done", "partial") else "",
        )
        for step in states
    ]
    head = ("Step", "State", "Result, or what is missing", "Figures")
    return joined((tag("h2", "Procedure"), table(head, lines, ("", "v", "", "v"))))


def quality_section(rows: tuple[QualityRow, ...], with_truth: bool) -> Html:
    """Return all figures with their limits and verdicts."""
    found, parts = quality_table(rows), [tag("h2", "Quality figures")]
    if not found.predicted and not found.sections:
        return joined((*parts, note("No figures yet: each step adds its own.")))
    head = ("Value", "Limit", "Verdict")
    columns = ("", "n", "n", "n", "v")
    if found.predicted:
        lines = [
            (row.title, row.value_words, row.limit_words, badge(row.verdict))
            for row in found.predicted
        ]
        parts.append(tag("h3", "Predicted by the program, without ground truth"))
        parts.append(table(("Figure", *head), lines, ("", "n", "n", "v")))
    if found.sections and with_truth:
        words = (
            "The devices of this session are virtual: their ground truth is known. It is used for "
            "these figures alone; nothing that was planned, calibrated or detected knows it."
        )
        parts.append(tag("h3", "Versus ground truth (virtual devices)"))
        parts.append(tag("p", words, css="soft"))
    for part in found.sections:
        title = part.title if with_truth else f"{part.title} (recorded)"
        lines = [
            (
                _title(row),
                row.value_words,
                "" if expected is None else expected.value_words,
                row.limit_words,
                badge(row.verdict),
            )
            for row, expected in part.rows
        ]
        if lines:
            parts.append(table((title, "Value", "Predicted", *head[1:]), lines, columns))
        if part.left_out:
            count, why = len(part.left_out), part.left_out[0].stale_reason
            parts.append(note(f"{part.title}: {count} stale figures left out: {why}.", "warn"))
    return joined(parts)


def calibration_section(session: Session, rows: Iterable[QualityRow]) -> Html:
    """Return how good the calibrations are expected to be, and the transforms that they made."""
    parts = [tag("h2", "Calibration and registration")]
    judged = {row.key: row for row in rows}
    parts += [_calibration(session, judged, step, title) for step, title in TITLES]
    lines: list[str] = []
    tool, mounting, head = session.results.tool, mounting_words(session), head_report(session)
    if tool is not None and tool.value.delay is not None:
        lines.append("{}: {}.".format(*delay_words(tool.value.delay)))
    if mounting:
        lines.append(f"Probe mounting: {mounting}")
    if head is not None:
        lines.append(head.sentence)
    lines.append(f"Verification on landmarks: {verification(session).sentence}")
    parts += [tag("p", line) for line in lines]
    frames = [
        (
            tag("code", row.name),
            row.source,
            ", ".join(f"{v:.2f}" for v in row.pose.translation),
            ", ".join(f"{v:.5f}" for v in row.pose.wxyz()),
            "" if row.sigma_mm is None else f"{row.sigma_mm:.2f}",
            "" if row.sigma_deg is None else f"{row.sigma_deg:.3f}",
            badge("stale") if row.stale_reason is not None else "",
        )
        for row in frame_rows(session)
    ]
    names = ("Transform", "From", "Translation (mm)", "Quaternion wxyz", "σ (mm)", "σ (°)", "")
    return joined((*parts, tag("h3", "Transforms"), table(names, frames, _FRAMES)))


_FRAMES = ("name", "name", "n own", "n own", "n own", "n own", "v")


def _calibration(
    session: Session, judged: Mapping[str, QualityRow], step: Step, title: str
) -> Html:
    found, reason = calibration_view(session, step), stale_reason(step, session)
    head = tag("h3", title)
    if found is None:
        return joined((head, note("Not calibrated yet.", "warn")))
    if reason is not None:
        return joined((head, note(f"Stale, left out: {reason}.", "warn")))
    rows = [
        (row.title, row.value_words, row.limit_words, badge(row.verdict))
        for row in (judged[part.key] for part in found.expected)
    ]
    words = (
        f"{found.n_used} of {len(found.marks)} poses used, residual {found.rmse_mm:.2f} mm (RMS). "
    )
    return joined(
        (
            head,
            table(("Error (3D, 1 σ)", "Value", "Limit", "Verdict"), rows, _EXPECTED),
            tag("p", words, "Verdict: ", badge(found.verdict), *map(_sentence, found.reasons)),
        )
    )


_EXPECTED = ("", "n", "n", "v")


def _sentence(reason: str) -> str:
    return f". {reason[:1].upper()}{reason[1:]}"


def certified(session: Session) -> CertificateView | None:
    """Return the certificate of the planned motion unless it is stale."""
    return None if stale_reason("roll", session) is not None else certificate_view(session)


def motion_section(session: Session) -> Html:
    """Return what the verifier says of the motion, check by check, and how the scan went."""
    title, plan = tag("h2", "Motion and its certificate"), session.results.roll
    if plan is None:
        return joined((title, note("No motion planned yet (step 7).", "warn")))
    reason, found = stale_reason("roll", session), certified(session)
    if reason is not None:
        return joined((title, note(f"Stale, left out: {reason}.", "warn")))
    if found is None:
        why = plan_reason(session) or roll_summary(session)
        return joined((title, note(f"No motion: {why}.", "warn")))
    clear = "" if found.min_clearance_mm is None else f". {CLEARANCE.named(found.min_clearance_mm)}"
    words = (
        f"An independent verifier, with forward kinematics of its own, "
        f"{'certifies' if found.certified else 'refuses'} the motion of "
        f"{DURATION.words(found.duration_s)}"
        f"{clear}. {roll_summary(session)}."
    )
    rows = [
        (
            row.check.name,
            row.value_words,
            row.limit_words,
            row.place,
            badge("pass" if row.check.holds else "fail"),
        )
        for row in found.rows
    ]
    parts = [title, note(words, "good" if found.certified else "warn")]
    parts.append(table(("Check", "Worst", "Limit", "Where", "Verdict"), rows, _CHECKS))
    digest = plan.value.certificate.digest if plan.value.certificate is not None else ""
    parts.append(tag("p", "Digest of the certified motion: ", tag("code", digest), css="soft"))
    second = session.results.second
    if second is not None and stale_reason("second", session) is None:
        planned = second.value.passes
        count = sum(one.plan.may_move for one in planned)
        said = f"{count} of {len(planned)} motions are certified in the same way"
        parts.append(tag("p", f"Tilted passes: {said}."))
    passes = usable_second(session)
    if len(passes) > 1:
        n_scans = sum(len(one.scans) for one in passes)
        parts.append(tag("p", f"{len(passes)} further passes add up, with {n_scans} A-scans."))
    contact = contact_report(session)
    if contact is not None and stale_reason("capture scan", session) is None:
        parts += [tag("h3", "Scan"), tag("p", contact.sentence)]
        parts += [] if contact.mass is None else [note(f"{contact.mass}.", "warn")]
        parts += [] if contact.delay is None else [tag("p", delay_sentence(contact.delay))]
    return joined(parts)


_CHECKS = ("", "n", "n", "", "v")


def _title(row: QualityRow) -> Html:
    reason = joined((Html("<br>"), tag("small", row.reason))) if row.reason else ""
    return joined((row.title, reason))


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
    if (risk := bed_risk(session)) is not None:
        parts.append(tag("p", risk.words))
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
