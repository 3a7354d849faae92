"""Derivations of declared values: what a class of inputs reads, digests and refuses."""

from dataclasses import dataclass, replace

import pytest

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.inputs import Input, Quantity, given, input_parts, inputs
from rona_core.app.dependencies.staleness import (
    capture_input,
    input_digests,
    required,
    result_input,
    stale_reason,
)
from rona_core.app.messages.message import message, serialize_arguments
from rona_core.app.runtime.handling import derive_all, read_inputs
from rona_core.app.steps.setup.capture_parts import SCAN_SPEED
from rona_core.devices.limits import number
from rona_core.devices.protocols import Cancel, Progress
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.session.document import Derived, Session
from tests.helpers.declared_step import declared_step

SEED = Input(lambda s: s.setup.seed, "choose a seed")
NAME = Input(lambda s: s.name or None, "name it", optional=True)
HELD = Input(
    lambda s: s.id if s.id == "usable" else None,
    "",
    optional=True,
    counts=lambda s: s.id,
    title="the thing held",
)
FIRST, SECOND = result_input("first half"), result_input("second half")
TWICE = Quantity(lambda seed: 2.0 * seed, {"seed": SEED})
BOTH = Quantity(lambda twice, name: (twice, name), {"twice": TWICE, "name": NAME})


@message
class StartHalves:
    """Compute both."""

    slope: float = number(1.0, "Slope", "", 0.0, 10.0, 0.1)
    other: float = number(1.0, "Other", "", 0.0, 10.0, 0.1)


@dataclass(frozen=True, slots=True)
class Half:
    value: float


@inputs()
class FirstInputs:
    seed: int = given(SEED, "seed")


@inputs()
class OptionalInputs:
    first: Half = given(FIRST, "first")
    taken: object = given(capture_input("halves"), "capture")


@inputs(implied=("seed",))
class LastInputs:
    first: Half = given(FIRST, "first")
    second: Half | None = given(result_input("second half", optional=True), "second")
    twice: float = given(TWICE)
    speed: float = given(SCAN_SPEED, "speed")


CALLS: list[str] = []


def first_half(
    known: FirstInputs, asked: StartHalves, *, progress: Progress, cancel: Cancel
) -> Half:
    CALLS.append("first half")
    progress(1.0)
    return Half(asked.slope * known.seed)


def second_half(
    known: OptionalInputs, asked: StartHalves, *, progress: Progress, cancel: Cancel
) -> Half:
    CALLS.append("second half")
    return Half(1.0)


def last_half(known: LastInputs, asked: StartHalves, *, progress: Progress, cancel: Cancel) -> Half:
    CALLS.append("last")
    progress(1.0)
    return Half(known.first.value + known.twice + asked.other)


def reading(slope: float) -> Input[float]:
    return Input(lambda s: slope, "")


STEP = declare.Step(
    "halves",
    activities=(declare.Activity(StartHalves, lambda *_: (), "Computing"),),
    captures=(declare.Capture("halves", "record it", ()),),
    results=(
        declare.Result.of(
            "first half", StartHalves, first_half, "first", done="", settings=("slope",)
        ),
        replace(
            declare.Result.of("second half", StartHalves, second_half, "second", done=""),
            spared=True,
        ),
        declare.Result.of(
            "last", StartHalves, last_half, "last", done="", settings=("slope", "other")
        ),
    ),
)


@pytest.fixture(autouse=True)
def declared():
    CALLS.clear()
    with declared_step(STEP):
        yield


def made(session: Session, asked: StartHalves) -> Session:
    """Return the session with the results that the message makes."""
    for name, value in derive_all(session, asked).items():
        derived = None
        if value is not None:
            digests = input_digests(name, session)
            derived = Derived(value, "StartHalves", serialize_arguments(asked), digests)
        session = session.with_result(name, derived)
    return session


def test_results_are_made_in_order_and_a_spared_one_is_left_out():
    shares: list[float] = []
    values = derive_all(Session(), StartHalves(), progress=shares.append)
    assert CALLS == ["first half", "last"]
    assert values["second half"] is None
    assert values["last"] == Half(0.0 + 0.0 + 1.0)
    assert shares == [pytest.approx(1 / 3), pytest.approx(1.0)]


@pytest.mark.parametrize(
    ("change", "asked", "calls"),
    [
        (lambda s: s, StartHalves(), ["first half", "last"]),  # all stand: all are made anew
        (lambda s: s, StartHalves(other=2.0), ["last"]),
        (lambda s: s, StartHalves(slope=2.0), ["first half", "last"]),
        (lambda s: s.with_result("last", None), StartHalves(), ["last"]),
        (lambda s: s.with_setup(seed=3), StartHalves(), ["first half", "last"]),
    ],
)
def test_what_stands_is_kept_where_something_else_does_not(change, asked, calls):
    before = made(Session(), StartHalves())
    CALLS.clear()
    after = change(before)
    values = derive_all(after, asked)
    assert calls == CALLS
    for name in {"first half", "last"} - set(calls):
        assert values[name] is before.results.get(name).value


def test_implied_inputs_are_handed_and_not_digested():
    assert set(input_parts(LastInputs).counted) == {"first", "second", "speed"}
    session = made(Session().with_setup(seed=4), StartHalves())
    known = read_inputs(LastInputs, session)
    assert (known.twice, known.second) == (8.0, None)


def test_a_missing_input_is_named_by_what_to_do():
    with pytest.raises(StepBlockedError, match="first first"):
        read_inputs(OptionalInputs, Session())
    with pytest.raises(StepBlockedError, match="first record it"):
        read_inputs(OptionalInputs, made(Session(), StartHalves()))


def test_a_quantity_is_missing_with_an_input_that_it_needs():
    wanting = Quantity(lambda first, name: name, {"first": FIRST, "name": NAME})
    assert wanting.read(Session()) is None
    assert BOTH.read(Session().with_setup(seed=2)) == (4.0, "untitled")
    assert set(BOTH.inputs()) == {"seed", "name"}
    with pytest.raises(StepBlockedError, match="first first"):
        required(wanting, Session())


def test_what_is_held_counts_though_it_is_not_usable():
    @inputs()
    class Known:
        held: str | None = given(HELD, "held")

    def derive(known: Known, asked: StartHalves, *, progress: Progress, cancel: Cancel) -> Half:
        return Half(0.0 if known.held is None else 1.0)

    declared = declare.Result.of("held", StartHalves, derive, "held", done="")
    with declared_step(declare.Step("holding", results=(declared,))):
        session = replace(Session(), id="bad")
        held = Derived(Half(0.0), "StartHalves", {}, input_digests("held", session))
        session = session.with_result("held", held)
        assert read_inputs(Known, session).held is None
        assert stale_reason("held", session) is None
        assert "the thing held was changed" in (
            stale_reason("held", replace(session, id="usable")) or ""
        )


def test_a_class_of_inputs_that_contradicts_itself_is_refused():
    seed, other = SEED, reading(2.0)

    with pytest.raises(InvalidInputError, match="under the key 'seed'"):

        @inputs()
        class TwoUnderOne:
            first: float = given(seed, "seed")
            second: float = given(other, "seed")

    with pytest.raises(InvalidInputError, match="or one under"):

        @inputs()
        class OneUnderTwo:
            first: float = given(seed, "first")
            twice: float = given(TWICE)

    @inputs()
    class Renamed:
        first: float = given(seed, "first")
        twice: float = given(TWICE, renamed={"seed": "first"})

    assert set(input_parts(Renamed).counted) == {"first"}
    with pytest.raises(InvalidInputError, match="no inputs"):

        @inputs(implied=("other",))
        class Unknown:
            first: float = given(seed, "first")

    with pytest.raises(InvalidInputError, match="without a key"):

        @inputs()
        class WithoutKey:
            first: float = given(seed)

    with pytest.raises(InvalidInputError, match="its type says not"):

        @inputs()
        class NotOptional:
            name: str = given(NAME, "name")

    def derive(session: Session, asked: StartHalves) -> Half:
        return Half(1.0)

    with pytest.raises(InvalidInputError, match="takes a class of inputs"):
        declare.Result.of("of a session", StartHalves, derive, "", done="")
