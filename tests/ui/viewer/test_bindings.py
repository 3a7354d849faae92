import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest

from rona_core.app.runtime.session_step import RenameSession
from rona_core.app.steps.scan.messages import StartScan
from rona_core.app.steps.setup.messages import SetRegion, SetSeed
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_ui.viewer import bindings as bindings_module
from rona_ui.viewer.bindings import DEBOUNCE_S, Bindings, error_words, escape, notify
from rona_ui.viewer.fields import Typed
from tests.helpers.ui.fake_gui import FakeClient


class FakeBench:
    def __init__(self) -> None:
        self.got: list[Any] = []
        self.stopped = threading.Event()
        self.hold = threading.Event()
        self.hold.set()
        self.moving = False

    def dispatch(self, message: Any) -> None:
        self.hold.wait(5.0)
        self.got.append(message)

    def start(self, message: Any) -> None:
        raise StepBlockedError("StartScan is blocked: first plan the motion (step 7)")

    def stop(self) -> None:
        self.stopped.set()

    def stop_if_moving(self) -> bool:
        if self.moving:
            self.stop()
        return self.moving


@pytest.fixture
def bench() -> FakeBench:
    return FakeBench()


@pytest.fixture
def refusals() -> list[tuple[str, str]]:
    return []


@pytest.fixture
def bindings(bench: FakeBench, refusals: list[tuple[str, str]]) -> Iterator[Bindings]:
    hub = SimpleNamespace(get=lambda: bench)
    made = Bindings(hub, lambda client, title, body, explained: refusals.append((title, body)))
    yield made
    made.close()


def event(client: Any) -> Any:
    return SimpleNamespace(client=client)


def drain(bindings: Bindings, client: Any) -> None:
    """Wait until everything that was put before has been done."""
    done = threading.Event()
    bindings.call(done.set, event(client))
    assert done.wait(5.0)


def test_messages_arrive_in_the_order_of_the_clicks(bindings: Bindings, bench: FakeBench) -> None:
    client = FakeClient()
    for seed in range(200):
        bindings.send(lambda seed=seed: SetSeed(seed), event(client))
    drain(bindings, client)
    assert [message.seed for message in bench.got] == list(range(200))


def test_what_we_wrote_ourselves_sends_nothing(bindings: Bindings, bench: FakeBench) -> None:
    bindings.send(lambda: SetSeed(1), event(None))
    bindings.send_debounced("seed", lambda: SetSeed(2), event(None))
    bindings.call(lambda: bench.got.append("call"), event(None))
    bindings.escape(lambda: bench.got.append("escape"), event(None))
    drain(bindings, FakeClient())
    assert bench.got == []
    assert not bench.stopped.is_set()


def test_a_field_that_is_being_dragged_sends_its_last_value_once(
    bindings: Bindings, bench: FakeBench
) -> None:
    client = FakeClient()
    for seed in range(50):
        bindings.send_debounced("seed", lambda seed=seed: SetSeed(seed), event(client))
    assert bench.got == []
    end = time.monotonic() + 60.0
    while not bench.got and time.monotonic() < end:
        time.sleep(DEBOUNCE_S / 10)
    drain(bindings, client)
    assert bench.got == [SetSeed(49)]


def test_what_was_typed_and_finished_need_not_settle(
    bindings: Bindings, bench: FakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bindings_module, "DEBOUNCE_S", 3600.0)
    bindings.send_debounced("seed", lambda: SetSeed(7), Typed(FakeClient(), None))
    end = time.monotonic() + 60.0
    while not bench.got and time.monotonic() < end:
        time.sleep(0.01)
    assert bench.got == [SetSeed(7)]


def test_a_click_comes_after_the_fields_that_were_changed_before_it(
    bindings: Bindings, bench: FakeBench
) -> None:
    client = FakeClient()
    bindings.send_debounced("seed", lambda: SetSeed(5), event(client))
    bindings.send_debounced("radius", lambda: SetRegion(radius_mm=30.0), event(client))
    bindings.send(lambda: RenameSession("after"), event(client))
    drain(bindings, client)
    assert bench.got == [SetSeed(5), SetRegion(radius_mm=30.0), RenameSession("after")]


def test_escape_stops_what_moves_and_leaves_the_mode_only_at_rest(
    bindings: Bindings, bench: FakeBench
) -> None:
    left = threading.Event()
    bench.moving = True
    bindings.escape(left.set, event(FakeClient()))
    assert bench.stopped.wait(2.0)
    assert not left.wait(0.2)
    bench.moving = False
    bench.stopped.clear()
    bindings.escape(left.set, event(FakeClient()))
    assert left.wait(2.0)
    assert not bench.stopped.is_set()


def test_a_refusal_beside_the_queue_is_told_and_kept_like_any_other(
    bindings: Bindings, refusals: list[tuple[str, str]]
) -> None:
    client = FakeClient()
    bindings.refuse(InvalidInputError("expected a, got b: do c"), event(client))
    assert refusals == [("Invalid value", "expected a, got b: do c")]


def test_a_refusal_is_told_with_cause_and_remedy_and_the_queue_goes_on(
    bindings: Bindings, bench: FakeBench, refusals: list[tuple[str, str]]
) -> None:
    client = FakeClient()
    bindings.send(StartScan, event(client))
    bindings.send(lambda: SetSeed(-1), event(client))
    bindings.send(lambda: SetSeed(3), event(client))
    drain(bindings, client)
    (blocked, why), (value, range_) = refusals
    assert blocked == "Step blocked"
    assert "first plan the motion (step 7)" in why
    assert value == "Invalid value"
    assert "seed must be 0 to" in range_
    assert bench.got == [SetSeed(3)]
    assert client.notices == [], "the page shows them, and the log"


def test_a_defect_is_told_without_its_inside(
    bindings: Bindings, refusals: list[tuple[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    client = FakeClient()

    def broken() -> None:
        raise ZeroDivisionError("secret detail")

    bindings.call(broken, event(client))
    drain(bindings, client)
    ((title, body),) = refusals
    assert title == "Internal error"
    assert "secret detail" not in body
    assert "Traceback" not in body
    assert "secret detail" in capsys.readouterr().err


def test_stop_overtakes_what_waits_in_the_queue(bindings: Bindings, bench: FakeBench) -> None:
    client = FakeClient()
    bench.hold.clear()
    bindings.send(lambda: RenameSession("slow"), event(client))
    bench.moving = True
    bindings.escape(lambda: None, event(client))
    assert bench.stopped.wait(2.0)
    assert bench.got == []
    bench.hold.set()


def test_markup_is_escaped() -> None:
    assert escape("<img src=x onerror='a'>\"&") == (
        "&lt;img src=x onerror=&#x27;a&#x27;&gt;&quot;&amp;"
    )


def test_the_title_names_the_kind_of_error() -> None:
    assert error_words(InvalidInputError("expected a, got b: do c")) == (
        "Invalid value",
        "expected a, got b: do c",
    )


def test_a_refusal_calls_a_parameter_what_its_field_is_called() -> None:
    for told, shown in (
        ("travel_mm must be 1 to 10, not 453", "Max. correction (mm) must be 1 to 10, not 453"),
        ("travel_mm_per_year of my_file.nrrd is 3", "travel_mm_per_year of my_file.nrrd is 3"),
    ):
        assert error_words(InvalidInputError(told))[1] == shown


def test_a_browser_that_has_gone_is_no_reason_to_stop(
    capsys: pytest.CaptureFixture[str],
) -> None:
    class Gone:
        def add_notification(self, title: str, body: str, **options: Any) -> None:
            raise RuntimeError("connection closed")

    notify(Gone(), "Saved", "a.rona")
    assert "connection closed" in capsys.readouterr().err
