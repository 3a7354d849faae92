"""Further passes over the region: which are wanted, and bone that hides its inner boundary."""

from dataclasses import asdict, replace

from rona_core.app.declarations.declarations import USABLE, Judgement, Remedy
from rona_core.app.steps.maps.messages import StartTiltPlan, StartTiltScan
from rona_core.app.steps.roll.certificate_view import why_no_plan
from rona_core.app.steps.scan.inputs import Passes, usable_second
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.app.steps.scan.step import probe_advice
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.devices.probes import PROBE_DATA
from rona_core.mapping.boundary_map import Maps
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


LEAST_COVERAGE = 0.8  # of the outer map by the inner one, after all tilted passes


def judge_maps(maps: Maps, session: Session) -> Judgement:
    """Return whether the inner boundary is mapped in enough of the region.

    Before all planned tilted passes are scanned the next pass is what helps, and nothing is said.
    """
    planned, held = session.results.second, usable_second(session)
    if not held or (planned is not None and planned.value.next_pass(held) is not None):
        return USABLE
    coverage = maps.inner_share
    if coverage >= LEAST_COVERAGE:
        return USABLE
    probe = PROBE_DATA[session.setup.devices.probe.name].title
    passes = "1 tilted pass" if len(held) == 1 else f"{len(held)} tilted passes"
    words = (
        f"the bone hides its inner boundary from the {probe} probe: it is mapped in "
        f"{100 * coverage:.0f} % of the outer map after {passes}, {100 * LEAST_COVERAGE:.0f} % is "
        "the least"
    )
    return Judgement("weak" if coverage > 0.0 else "bad", words, other_scan(session))


def other_scan(session: Session) -> Remedy:
    """Return which scan may find more of the inner boundary: another probe or another region."""
    advice = probe_advice(session)
    if advice is None:
        look = "take a quick look with each probe (step 8), which says whether another one helps"
        return Remedy(look, StartQuickLook())
    if not advice.another:
        words = "choose another region (step 1): by the quick look no other probe is clearly better"
        return Remedy(words)
    chosen = SetProbe(**asdict(session.setup.devices.probe.of_probe(advice.advised)))
    title = PROBE_DATA[advice.advised].title
    return Remedy(f"choose the {title} probe (step 1) and scan again", chosen)
