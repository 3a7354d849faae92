"""Whatever a session stores can be read over REST: each field of the document has an address."""

import dataclasses

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.calibration.hand_eye.hand_eye import FLOOR_MM
from rona_core.geometry.pose import Pose, Poses
from rona_core.session.document import Captures, Results, Session
from tests.api.routes.test_api_routes import refused
from tests.scenes import demo_parts

# field of a session -> address below it, and where in the answer; captures and results: see below
READ_AT = {
    "id": ("", "id"),
    "name": ("", "name"),
    "created_utc": ("", "created_utc"),
    "setup": ("/results/setup", "setup"),
    "painted": ("/results/path", "painted"),
    "path_edits": ("/results/smoothing", "path_edits"),
    "boundary_edits": ("/results/maps", "boundary_edits"),
}
# each of these is in several answers, and has tests of its own
ELSEWHERE = {"captures", "results", "archive", "log"}


@pytest.fixture(scope="module")
def demo(client):
    made = client.post("/sessions/demo").json()["id"]
    yield made
    client.delete(f"/sessions/{made}")


@pytest.fixture(scope="module")
def stored():
    return demo_parts.demo()


@pytest.fixture(scope="module")
def shown(client, demo):
    """Captures and results as all steps show them: name -> what is held."""
    found = {"captures": {}, "results": {}}
    for step in REGISTRY.listed:
        answer = client.get(f"/sessions/{demo}/results/{step}", params={"max_points": 2})
        assert answer.status_code == 200, step
        for kind, held in found.items():
            held.update(answer.json()[kind])
    return found


def names(document):
    return {field.name for field in dataclasses.fields(document)} - {"more"}


def test_every_field_of_a_session_has_an_address(client, demo, stored):
    assert names(Session) == READ_AT.keys() | ELSEWHERE
    for name, (address, part) in READ_AT.items():
        held = client.get(f"/sessions/{demo}{address}").json()
        assert part in held, name
        require_all(getattr(stored, name), held[part], name)


@pytest.mark.parametrize(("kind", "document"), [("captures", Captures), ("results", Results)])
def test_every_capture_and_every_result_has_a_route(shown, stored, kind, document):
    declared = REGISTRY.captures if kind == "captures" else REGISTRY.result_names
    assert names(document) <= shown[kind].keys()
    assert shown[kind].keys() == set(declared)
    assert getattr(stored, kind).more.keys() <= shown[kind].keys()
    for name, held in shown[kind].items():
        value = getattr(stored, kind).get(name)
        assert (held["value"] is None) == (value in (None, ()))
        if value is not None:
            require_all(value.value if kind == "results" else value, held["value"], name)


def require_all(value, answer, where):
    """Each field of a value, and of what it consists of, is in an answer."""
    if isinstance(value, Pose | Poses | np.ndarray) or not dataclasses.is_dataclass(value):
        return
    for field in dataclasses.fields(value):
        assert field.name in answer, f"{where} lacks {field.name}"
        require_all(getattr(value, field.name), answer[field.name], f"{where}/{field.name}")


def test_the_error_that_a_calibration_expects_is_among_its_results(shown, stored):
    for name in ("tool", "pointer"):
        expected = getattr(stored.results, name).value.tip_sigma_mm
        assert shown["results"][name]["value"]["tip_sigma_mm"] == expected > 0.0


def sigmas(answer, where=""):
    """Each number in an answer whose name says that it is a standard deviation in mm or degrees."""
    if isinstance(answer, dict):
        for name, part in answer.items():
            yield from sigmas(part, f"{where}/{name}")
    elif isinstance(answer, float) and where.endswith(("sigma_mm", "sigma_deg")):
        yield where, answer


def test_no_deviation_is_shown_that_is_a_bound_of_the_arithmetic(shown, stored):
    found = dict(sigmas(shown["results"]))
    assert len(found) >= 8
    assert {where for where, value in found.items() if 0.0 < value < 1e-4} == set()
    assert stored.results.tool.value.marker_sigma_mm == FLOOR_MM
    assert shown["results"]["tool"]["value"]["marker_sigma_mm"] is None
    resolved = stored.results.pointer.value.marker_sigma_mm
    assert shown["results"]["pointer"]["value"]["marker_sigma_mm"] == resolved


def test_who_takes_a_result_for_a_step_is_sent_there(client, demo):
    for step in REGISTRY.listed:
        captures, results = REGISTRY.parts_of(step)
        for name in {*captures, *results} - set(REGISTRY.listed):
            answer = client.get(f"/sessions/{demo}/results/{name}")
            assert f"in the results of step '{step}'" in refused(answer, 404, "not_found")["detail"]
