"""Judgements: whatever is not usable says why, and what mends it."""

from dataclasses import replace

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import blocked, judge_part
from rona_core.app.dependencies.staleness import CAPTURE
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.implant.messages import PlanMilling, StartBedSearch
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.path.messages import GenerateScanPattern
from rona_core.app.steps.roll.messages import StartBasePlacement, StartRollSearch
from rona_core.app.steps.scan.landmarks.messages import OverrideLandmarks
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import MoveTracker, SetProbe, SetRobot, SetSeed, SetTracker
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.geometry.arrays import readonly
from rona_core.session.document import Derived, Session

RESULTS = tuple(dict.fromkeys(result.name for step in REGISTRY.steps for result in step.results))
PARTS = (*RESULTS, *(f"{CAPTURE}{name}" for name in REGISTRY.captures))
BAD = tuple(
    name
    for name in RESULTS
    if name not in ("override", "registration", "placement", "sono", "line")
    and REGISTRY.result(name).judged is not None
)


def without(session: Session, name: str) -> Session:
    """Return the session without a result or capture."""
    if not name.startswith(CAPTURE):
        return session.with_result(name, None)
    kind = name.removeprefix(CAPTURE)
    empty = () if isinstance(session.captures.get(kind), tuple) else None
    return session.with_capture(kind, empty)


def spoilt(session: Session, name: str) -> Session:
    """Return the session with a result that is there and fresh, and of no use."""
    held = session.results.get(name)
    value = held.value
    if name == "roll":
        value = replace(value, search=replace(value.search, mode="none"), trajectory=None)
    elif name == "second":
        search = replace(value.plan.search, mode="none")
        value = replace(value, plan=replace(value.plan, search=search, trajectory=None))
    elif name == "milling":
        value = replace(value, trajectory=None, certificate=None)
    elif name == "maps":
        nowhere = readonly(value.inner.ok & False)
        value = replace(value, inner=replace(value.inner, ok=nowhere))
    elif name == "bed":
        value = replace(value, refusal="too little bone is left")
    elif name == "landmarks":
        value = replace(value, pointer_base=value.pointer_base + 20.0)
    else:
        value = replace(value, verdict="bad", reasons=("it slipped",))
    return session.with_result(name, replace(held, value=value))


def says_what_mends(name: str, session: Session) -> None:
    found = judge_part(name, session)
    if found.state == "usable":
        assert (found.reason, found.remedy) == ("", None), name
        return
    assert found.reason, name
    assert found.remedy is not None, name
    assert found.remedy.words, name
    if found.remedy.message is not None:
        assert blocked(type(found.remedy.message), session) is None, f"{name}: {found}"


CHANGES = {
    "nothing": None,
    "seed": SetSeed(5),
    "scan speed": SetRobot(scan_speed_mm_per_s=30.0),
    "robot": SetRobot(model="ur10"),
    "probe": SetProbe(name="1MHz"),
    "tracker": SetTracker("white035"),
    "place of the tracker": MoveTracker(shift_mm=(80.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("change", CHANGES)
def test_whatever_is_not_usable_has_a_remedy_that_can_be_sent(demo, change):
    for session in (Session(), demo):
        changed = session if CHANGES[change] is None else handle(CHANGES[change], session)
        for name in PARTS:
            says_what_mends(name, changed)


@pytest.mark.parametrize("gone", PARTS)
def test_with_any_part_gone_all_others_have_remedies(demo, gone):
    lacking = without(demo, gone)
    assert judge_part(gone, lacking).state in ("missing", "blocked")
    for name in PARTS:
        says_what_mends(name, lacking)


@pytest.mark.parametrize("name", BAD)
def test_a_bad_result_names_a_remedy_of_its_own_and_all_behind_it_do_so_too(demo, name):
    session = spoilt(demo, name)
    weak = name in ("tool", "pointer")  # used with their large errors all the same
    assert judge_part(name, session).state == ("weak" if weak else "bad")
    for part in PARTS:
        says_what_mends(part, session)


def test_what_is_computed_is_not_to_be_computed_again_when_it_is_bad(demo):
    for name in ("roll", "second", "milling"):
        remedy = judge_part(name, spoilt(demo, name)).remedy
        assert type(remedy.message) is not REGISTRY.result(name).message, name
    other = judge_part("bed", spoilt(demo, "bed")).remedy.message
    assert other.implant != demo.results.get("bed").value.implant
    assert judge_part("roll", spoilt(demo, "roll")).remedy.message == StartBasePlacement()
    assert judge_part("landmarks", spoilt(demo, "landmarks")).remedy.message == StartToolCapture()


def test_a_bad_result_blocks_what_needs_it_and_an_optional_one_does_not(demo):
    assert "roll" in blocked(StartScan, spoilt(demo, "roll")).reason
    assert "safe" in blocked(PlanMilling, spoilt(demo, "bed")).reason
    assert blocked(StartMapping, spoilt(demo, "mounting")) is None
    assert blocked(StartBedSearch, spoilt(demo, "burr")) is None


def test_an_overridden_verification_is_weak_and_blocks_nothing(demo):
    failed = spoilt(demo, "landmarks")
    assert "verification on landmarks failed" in blocked(StartScan, failed).reason
    overridden = handle(OverrideLandmarks("seen by eye"), failed)
    assert judge_part("landmarks", overridden).state == "weak"
    assert blocked(StartScan, overridden) is None


def test_the_earliest_step_comes_first_and_not_the_first_need(demo):
    bare = demo
    for name in ("path", "surface", f"{CAPTURE}path", f"{CAPTURE}surface"):
        bare = without(bare, name)
    remedy = judge_part("maps", bare).remedy
    assert remedy.message == StartSurfaceCapture()  # although smoothing needs the path first


def test_what_is_stale_is_made_again_as_it_was_made(demo):
    held = demo.results.roll
    asked = Derived(held.value, held.message, {**held.arguments, "n_rolls": 24}, held.inputs)
    faster = handle(SetRobot(scan_speed_mm_per_s=30.0), demo.with_result("roll", asked))
    assert judge_part("maps", faster).remedy.message == StartRollSearch(n_rolls=24)
    pattern = GenerateScanPattern(spacing_mm=4.0)
    drawn = handle(pattern, demo)
    resampled = drawn.with_result("surface", replace(drawn.results.surface, inputs={}))
    assert judge_part("surface", resampled).state == "stale"
    fresh = resampled.with_result("surface", demo.results.surface)
    changed = fresh.with_result("path", replace(drawn.results.path, inputs={}))
    assert judge_part("path", changed).remedy.message == pattern
