"""Further passes of step 9: they add up, and their A-scans count one pass after the other."""

from dataclasses import replace

from rona_core.app.declarations.declarations import USABLE, Judgement, Remedy
from rona_core.app.steps.maps.messages import StartTiltPlan, StartTiltScan
from rona_core.app.steps.roll.certificate_view import why_no_plan
from rona_core.app.steps.scan.inputs import Passes, usable_second
from rona_core.session.captures import ScanCapture
from rona_core.session.document import SecondPass, Session


def with_pass(session: Session, capture: ScanCapture, append: bool) -> object:
    """Return the further passes with one more; it replaces those of another scan or set-up.

    Each adds to what is there: that message knows no ``append``. It takes the place of a last one
    that was stopped early.
    """
    held = usable_second(session)
    return (*(held[:-1] if held and held[-1].partial else held), capture)


def judge_plan(planned: SecondPass, session: Session) -> Judgement:
    """Return whether the robot can follow all planned further passes."""
    for number, one in enumerate(planned.passes):
        if (reason := why_no_plan(one.plan)) is not None:
            why = f"tilted pass {number + 1} of {len(planned.passes)}: {reason}"
            return Judgement("bad", why, Remedy("plan the tilted passes with less tilt (step 9)"))
    return USABLE


def judge_passes(held: Passes, session: Session) -> Judgement:
    """Return whether all planned passes are scanned."""
    planned = session.results.second
    if planned is None or planned.value.next_pass(held) is None:
        return USABLE
    done, count = planned.value.scanned(held), len(planned.value.passes)
    again = Remedy(f"scan tilted pass {done + 1} of {count} (step 9)", StartTiltScan())
    return Judgement("missing", f"{done} of {count} tilted passes are scanned", again)


def all_scanned(session: Session) -> Judgement | None:
    """Return why no further pass can be scanned: each that is planned was; None: one can."""
    planned, held = session.results.second, usable_second(session)
    if planned is None or planned.value.next_pass(held) is not None:
        return None
    remedy = Remedy("plan further passes (step 9)", StartTiltPlan())
    return Judgement("blocked", "all planned passes are scanned: plan further ones", remedy)


def forget_corrections(before: Session, after: Session) -> Session:
    """Return ``after`` without corrections of boundaries in passes that were replaced.

    Corrections name A-scans by their numbers, which a pass that adds to others leaves as they were.
    """
    if len(after.captures.second) > len(before.captures.second):
        return after
    return replace(after, boundary_edits=before.boundary_edits.without("second"))
