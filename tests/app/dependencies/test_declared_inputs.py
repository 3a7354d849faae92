"""What derivations are handed: each change of it makes the result stale, and it is never stale."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import pytest

from rona_core.app.declarations.inputs import Input, input_parts, is_missing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import digest_of, input_digests, stale_reason
from rona_core.app.runtime.handling import compute_result, handle
from rona_core.app.steps.acoustics.derivation import ANY_AGAIN
from rona_core.app.steps.acoustics.messages import CalibrateDelayLine
from rona_core.app.steps.boundaries.messages import CorrectBoundary
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.path.messages import PaintRegion
from rona_core.app.steps.scan.inputs import ANY_PASSES
from rona_core.app.steps.scan.landmarks.messages import OverrideLandmarks
from rona_core.compose import new_workbench
from rona_core.session.document import Derived, Session
from tests.helpers.derived import derived
from tests.scenes import demo_parts

DECLARED = {name: REGISTRY.result(name) for name in REGISTRY.replayed}
NAMES = (*REGISTRY.replayed, *(f"capture {name}" for name in REGISTRY.captures))
Change = Callable[[Session], Session]


class StandIn:
    """Value of a result that no other is computed from, bad as its judge sees it."""

    verdict, reasons, smallest = "bad", (), None


@pytest.fixture(scope="module")
def session():
    """The demo, with A-scans on the block and by hand, and stand-ins of what takes long."""
    bench = new_workbench(demo_parts.measured_beside())
    bench.dispatch(OverrideLandmarks(reason="a test of inputs"))
    made = bench.session
    bench.close()
    for name, result in DECLARED.items():
        if made.results.get(name) is None:
            by = result.message.__name__
            held = Derived(StandIn(), by, {}, input_digests(name, made, by))
            made = made.with_result(name, held)
    return made


def of_value(name: str, **parts: object) -> Change:
    """Return what gives a result another value."""

    def change(session: Session) -> Session:
        held = session.results.get(name)
        known = {key: make(held.value) for key, make in parts.items()}
        return session.with_result(name, replace(held, value=replace(held.value, **known)))

    return change


def of_device(device: str, **settings: object) -> Change:
    def change(session: Session) -> Session:
        held = getattr(session.setup.devices, device)
        return session.with_devices(**{device: replace(held, **settings)})

    return change


def moved(capture):
    """Return a capture as if the tracker had stood elsewhere."""
    place = replace(capture.tracker_place, shift_mm=(1.0, 0.0, 0.0))
    return replace(capture, tracker_place=place)


# of every implied input by its key: a change of it, as messages make it
IMPLIED: dict[str, Change] = {
    "robot": of_device("robot", model="ur10"),
    "probe": of_device("probe", gain_db=3.0),
    "tracker": of_device("tracker", profile="vega"),
    "surface": of_value("surface", points_base=lambda v: v.points_base + 1.0),
    "registered tool": of_value("tool", registration_sigma_mm=lambda v: 2.0),
    "calibrated pointer": of_value("pointer", tip_sigma_mm=lambda v: 2.0),
    "mounting": lambda s: s.with_result("mounting", None),
    "line": lambda s: compute_result(CalibrateDelayLine(), s),
    "tool": of_value("tool", registration_sigma_mm=lambda v: 2.0),
    "place of the tracker": lambda s: s.with_capture("tool", moved(s.captures.tool)),
    "capture of the tool": lambda s: s.with_capture("tool", moved(s.captures.tool)),
    "capture of the pointer": lambda s: s.with_capture("pointer", moved(s.captures.pointer)),
    "strokes": lambda s: s.with_capture("surface", (moved(s.captures.surface[0]),)),
    "demonstration": lambda s: s.with_capture("path", moved(s.captures.path)),
    "errors of the robot": of_device("robot", errors=False),
    "field of the tracker": of_device("tracker", profile="vega"),
    "detection": of_value("detection", sound_speed_mm_per_us=lambda v: 2.5),
    "detection of further passes": of_value(
        "second_detection", sound_speed_mm_per_us=lambda v: 2.5
    ),
    "correction by hand": lambda s: replace(
        s, boundary_edits=s.boundary_edits.put(CorrectBoundary(3, remove="inner").edit())
    ),
    "speed of the maps": lambda s: s.with_result("speed", None),
    "capture": lambda s: s.with_capture(
        "scan", replace(s.captures.scan, ordinal=s.captures.scan.ordinal + 1)
    ),
    "further passes": lambda s: s.with_capture("second", s.captures.second * 2),
    "cloud of the maps": of_value("surface", points_base=lambda v: v.points_base + 1.0),
    "painted regions": lambda s: handle(
        PaintRegion("avoid", (tuple(s.results.surface.value.points_base[0].tolist()),)), s
    ),
    "head": lambda s: s.with_capture(
        "surface", (replace(s.captures.surface[0], head=None), *s.captures.surface[1:])
    ),
}
# and of every free one
FREE: dict[str, Change] = {
    "second": lambda s: s.with_capture("second", s.captures.second * 2),
    "second_detection": lambda s: s.with_result("second_detection", None),
    "further correction": lambda s: replace(
        s, boundary_edits=s.boundary_edits.put(CorrectBoundary(3, "second", remove="inner").edit())
    ),
    "use of the base marker": lambda s: s.with_setup(use_base_marker=not s.setup.use_base_marker),
    "plan": of_value("second", n_before=lambda v: v.n_before + 1),
}


def parts_of(name: str, kind: str) -> Mapping[str, Input[object]]:
    return getattr(input_parts(DECLARED[name].known), kind)


def cases(kind: str) -> list[tuple[str, str]]:
    return [(name, key) for name in DECLARED for key in parts_of(name, kind)]


def test_every_implied_and_every_free_input_has_a_change():
    assert {key for _, key in cases("implied")} <= set(IMPLIED)
    assert {key for _, key in cases("free")} <= set(FREE)


@pytest.mark.parametrize(("name", "key"), cases("implied"))
def test_a_change_of_an_implied_input_makes_the_result_stale(session, name, key):
    assert stale_reason(name, session) is None
    after, item = IMPLIED[key](session), parts_of(name, "implied")[key]
    assert digest_of(item.counted(after)) != digest_of(item.counted(session))
    assert stale_reason(name, after) is not None


@pytest.mark.parametrize(("name", "key"), cases("free"))
def test_a_change_of_a_free_input_leaves_the_result(session, name, key):
    after, item = FREE[key](session), parts_of(name, "free")[key]
    assert digest_of(item.counted(after)) != digest_of(item.counted(session))
    assert stale_reason(name, after) is None


def without(session: Session, name: str) -> Session:
    kind, _, capture = name.partition(" ")
    if kind != "capture":
        return session.with_result(name, None)
    held = session.captures.get(capture)
    return session.with_capture(capture, () if isinstance(held, tuple) else None)


def outdated(session: Session, name: str) -> Session:
    """Return the session with a result or capture that is stale by itself."""
    kind, _, capture = name.partition(" ")
    if kind != "capture":
        held = session.results.get(name)
        forged = {key: "of something else" for key in held.inputs}
        return session.with_result(name, replace(held, inputs=forged))
    held = session.captures.get(capture)
    if isinstance(held, tuple):
        other = tuple(replace(one, setup_digest="of another set-up") for one in held)
        return session.with_capture(capture, other)
    return session.with_capture(capture, replace(held, setup_digest="of another set-up"))


# Maps and speed are of the detection that is held: its inputs are among theirs.
HELD = {("detection of further passes", "second_detection"), ("speed", "second_detection")}


def handed_stale(session: Session, name: str) -> list[tuple[str, str]]:
    """Return the inputs that a result is handed though what they read is stale, and that.

    It may be handed where the result is stale with it, as one is that is computed again from a
    stale capture, and where the same message makes it anew first.
    """

    @cache
    def value(item: Input[object], of: str) -> object:
        return digest_of(item.read(without(session, of) if of else session))

    declared = DECLARED[name]
    known = input_parts(declared.known)
    first = {result.name for result in REGISTRY.results_of(declared.message.__name__)}
    behind = {item.upstream for item in known.counted.values() if item.upstream}
    found: list[tuple[str, str]] = []
    for key, item in {**known.counted, **known.implied, **known.free}.items():
        for one in NAMES:
            held = session.captures.get(one.partition(" ")[2]) or session.results.get(one)
            if not held or value(item, one) == value(item, ""):
                continue  # it does not read it
            after = outdated(session, one)
            assert stale_reason(one, after) is not None
            stale_with_it = any(stale_reason(upstream, after) for upstream in behind)
            made_first = one in first and not item.optional
            fine = is_missing(item.read(after)) or stale_with_it or made_first
            if not fine and (key, one) not in HELD:
                found.append((key, one))
    return found


@pytest.mark.parametrize("name", DECLARED)
def test_nothing_stale_is_handed(session, name):
    assert handed_stale(session, name) == []


def test_a_stale_value_that_is_handed_is_found(session, monkeypatch):
    raw = Input(lambda s: s.captures.second, "", optional=True)
    known = input_parts(DECLARED["maps"].known)
    faulty = replace(known, counted={**known.counted, "second": raw})
    monkeypatch.setattr(DECLARED["maps"].known, "__input_parts__", faulty)
    assert handed_stale(session, "maps") == [("second", "capture second")]


@pytest.mark.slow
def test_after_another_scan_the_passes_of_the_old_one_are_not_mapped(session):
    scan = session.captures.scan
    again = replace(scan, ordinal=scan.ordinal + 1, joints=replace(scan.joints))
    after = session.with_capture("scan", again)
    assert stale_reason("capture second", after) is not None
    assert ANY_PASSES.read(after) == ()
    assert ANY_AGAIN.read(after) is None
    maps = derived("maps", after, StartMapping())
    assert len(maps.inner_used) == len(after.results.detection.value)
