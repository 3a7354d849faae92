"""Whether the inner boundary is mapped in enough of the region, and what to do where it is not."""

from dataclasses import asdict

from rona_core.app.declarations.declarations import USABLE, Judgement, Remedy
from rona_core.app.steps.scan.inputs import usable_second
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.app.steps.scan.quick_look import probe_advice
from rona_core.app.steps.setup.messages import SetProbe
from rona_core.devices.probes import PROBE_DATA
from rona_core.mapping.boundary_map import Maps
from rona_core.session.document import Session

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
