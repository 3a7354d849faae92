"""A step declared in one folder is everywhere: in REST, the step list, staleness and replay."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from fastapi.testclient import TestClient

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import blocked, step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.runtime.session_step import replay
from rona_core.app.steps.setup.messages import SetRobot
from rona_core.compose import build_registry, new_workbench
from rona_core.errors import InvalidInputError, SessionFormatError
from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session
from rona_core.session.files import session_bytes
from rona_ui.labels import doing, place_of
from rona_ui.server import bare_app
from tests.app.toy_step.messages import FitToyLine, StartToyCapture
from tests.app.toy_step.step import STEP, ToyLine
from tests.helpers.declared_step import declared_step
from tests.helpers.session_file import reopened

API = "/api/v1/sessions/current"


@dataclass(frozen=True, slots=True)
class LoadedFromElsewhere:
    value: float


@pytest.fixture(autouse=True)
def declared():
    with declared_step(STEP):
        yield


@pytest.fixture
def bench(declared):
    made = new_workbench(Session(name="toy"))
    yield made
    made.close()


def toy_state(session):
    return next(state for state in step_states(session) if state.name == "toy")


def test_it_is_in_rest_with_routes_of_its_own(tmp_path):
    registry = build_registry(tmp_path, processes=False)
    try:
        client = TestClient(bare_app(registry, None))
        client.post("/api/v1/sessions", json={})
        blocked = client.post(f"{API}/commands/FitToyLine", json={})
        assert blocked.status_code == 409
        assert "read the toy" in blocked.json()["detail"]
        started = client.post(f"{API}/jobs/StartToyCapture", json={"n": 4})
        assert started.status_code == 202
        registry.get("current").jobs.wait(started.json()["id"], 20.0)
        found = client.get(f"{API}/results/toy").json()
        assert found["captures"]["toy"]["value"]["readings"] == [0.0, 1.0, 2.0, 3.0]
        assert found["results"]["toy line"]["value"]["fitted"] == [0.0, 20.0, 40.0, 60.0]
        assert client.post(f"{API}/commands/FitToyLine", json={"slope": 2.0}).status_code == 200
        assert client.post(f"{API}/commands/FitToyLine", json={"slope": "x"}).status_code == 422
        steps = client.get(f"{API}/steps").json()
        assert (steps[-1]["title"], steps[-1]["state"]) == ("Toy", "done")
    finally:
        registry.close_all()


def test_it_is_in_the_list_of_steps_and_has_words(bench):
    states = step_states(bench.session)
    assert [state.name for state in states][-1] == "toy"
    assert toy_state(bench.session).state == "ready"
    assert blocked(FitToyLine, bench.session).reason == "first read the toy"
    bench.run(StartToyCapture())
    assert (toy_state(bench.session).state, toy_state(bench.session).reason) == ("done", "a line")
    assert doing("StartToyCapture") == "Reading the toy"
    assert place_of(None, "StartToyCapture") == f"{len(states)} Toy, Reading the toy"


def test_it_becomes_stale_with_what_it_depends_on(bench):
    bench.run(StartToyCapture())
    assert stale_reason("toy line", bench.session) is None
    bench.dispatch(SetRobot(scan_speed_mm_per_s=10.0))
    assert stale_reason("capture toy", bench.session) is None
    assert stale_reason("toy line", bench.session) == (
        "the scan speed (step 1) was changed since the toy line was fitted"
    )
    assert toy_state(bench.session).state == "stale"
    bench.dispatch(FitToyLine())
    assert toy_state(bench.session).state == "done"
    bench.dispatch(SetRobot(scan_speed_mm_per_s=10.0, base_shift_mm=(10.0, 0.0, 0.0)))
    assert stale_reason("capture toy", bench.session) is not None


def test_it_is_replayed_from_its_capture(bench):
    bench.run(StartToyCapture())
    session = bench.session
    (row,) = replay(session)
    assert (row.result, row.same) == ("toy line", True)
    held = session.results.get("toy line")
    forged = replace(held, value=ToyLine(held.value.fitted + 1.0))
    (row,) = replay(replace(session, results=session.results.with_("toy line", forged)))
    assert not row.same


def test_it_is_saved_loaded_and_undone(bench):
    empty = digest(bench.session.results)
    bench.run(StartToyCapture())
    loaded = reopened(bench.session)
    assert digest(loaded) == digest(bench.session)
    assert isinstance(loaded.results.get("toy line").value, ToyLine)
    np.testing.assert_array_equal(loaded.archive[0].readings, [0.0, 1.0, 2.0])
    assert [entry.message for entry in loaded.log] == ["StoreCapture", "FitToyLine"]
    without = bench.session.results.with_("toy line", None)
    assert without.get("toy line") is None
    assert digest(without) == empty


def test_a_session_without_declared_names_is_written_as_before():
    assert b'"more"' not in session_bytes(Session())


def test_what_nobody_declared_is_refused(bench):
    with pytest.raises(InvalidInputError, match="declared twice"):
        REGISTRY.declare([STEP])
    held = Derived(LoadedFromElsewhere(1.0), "FitToyLine", {}, {})
    forged = replace(bench.session, results=bench.session.results.with_("other", held))
    with pytest.raises(SessionFormatError, match="a type that a step declares"):
        reopened(forged)
