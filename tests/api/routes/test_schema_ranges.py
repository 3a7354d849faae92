"""The OpenAPI document and the code agree on what a body may hold: every range, length and word.

Requests are made from the document alone, to every route with a JSON body. None of those that are
valid by it is refused for what it holds, but for the rules of ``RULES``, which JSON Schema cannot
say and the descriptions of the fields do; and each value just outside is refused.
"""

import json
import re
from random import Random

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.jobs import Jobs
from rona_core.devices.limits import limits_of, meaning
from rona_core.errors import DeviceError, RonaError
from tests.helpers.schema_values import bodies, numbers, outside, valid, whole

COUNT = 1500
NUMERIC = ("number", "integer")
NAME = "a file name may have 200 bytes"  # a schema counts characters
LENGTH = "must have length 1"
# name of the route -> how it is refused, and the fields whose descriptions say so
RULES = {
    "AddReferencePoint": ("either which A-scan", ["scan", "place_base_mm"]),
    "StartProbeSweep": (
        "cells are too many",
        ["probes", "excitations", "snr_db", "thickness_mm"],
    ),
    "CorrectBoundary": ("give exactly one", ["outer_us", "inner_us", "remove"]),
    "ClearBoundaryCorrections": ("a number needs the scan", ["number"]),
    "StartHandheldScan": ("duration_s times rate_hz", ["duration_s", "rate_hz"]),
    "StartRollSearch": ("roll_to_deg must be", ["roll_to_deg"]),
    "StartBasePlacement": (
        "places are too many",
        ["half_x_mm", "half_y_mm", "step_mm", "levels_mm"],
    ),
    "StartSurfaceCapture": ("lifts must increase|nothing to lift", ["lifts"]),
    "StartSkullRegistration": (f"needs both|{LENGTH}", ["guess_wxyz", "guess_mm"]),
    "GenerateScanPattern": ("a boundary has 3", ["boundary_base_mm"]),
    "StartPathCapture": ("picks must be 2", ["picks_base_mm"]),
    "SetContact": ("(monitor_n|stop_n) must be", ["monitor_n", "stop_n"]),
    "contact": ("(monitor_n|stop_n) must be", ["monitor_n", "stop_n"]),
    "AddObstacle": ("is there already", ["name"]),
    "SetRegion": ("must lie on the skull", ["center_mesh_mm"]),
    "StartRobotMove": ("joint \\d must be", ["joints_deg"]),
    "move": ("joint \\d must be", ["joints_deg"]),
    "StartSkullImport": (NAME, ["file", "inner_file", "center_mesh_mm"]),
    "StartRecordingImport": (NAME, ["file"]),
    "StartPivotImport": (NAME, ["files", "geometry"]),
    "StartComparison": (NAME, ["file"]),
    "StartImport": (NAME, ["file"]),
    "hand-eye": (NAME, ["robot_file", "sensor_file"]),
    "picture": (NAME, ["robot_file", "sensor_file"]),
    "open": (NAME, ["file"]),
    "save": (NAME, ["file"]),
    "pose": (LENGTH, ["wxyz"]),
    "pointer": (LENGTH, ["wxyz"]),
}
# refusals for what the session does not hold
OF_SESSION = {"RemoveReferencePoint": "there (is|are) .* reference point"}


@pytest.fixture(scope="module")
def document(client):
    return client.get("/openapi.json").json()


@pytest.fixture
def send(client, session, web, monkeypatch):
    """Return a function that sends a body to a route of a new session; no job begins."""

    def refuse(*args, **kwargs):
        raise DeviceError("no job begins in this test")

    monkeypatch.setattr(Jobs, "start", refuse)
    made = []

    def send(method, path, body):
        short = path.removeprefix("/api/v1").format(session_id=session, name="pointer6d")
        answer = client.request(method, short, json=body)
        if answer.status_code == 201:
            made.append(answer.json()["id"])
        return answer

    yield send
    for one in made:
        client.delete(f"/sessions/{one}")
    for file in web.hub.files.folder.glob("*.rona"):
        file.unlink()


def test_every_number_of_a_body_has_both_limits(document):
    found = [
        (path, place)
        for _, path, schema in bodies(document)
        for place, part in numbers(schema)
        if not ("minimum" in part and "maximum" in part)
    ]
    assert found == []
    assert sum(1 for _, _, schema in bodies(document) for _ in numbers(schema)) > 200


def test_every_list_of_a_body_has_a_largest_length(document):
    for _, path, schema in bodies(document):
        for name, part in schema["properties"].items():
            for option in part.get("anyOf", [part]):
                if option.get("type") == "array":
                    assert "maxItems" in option, (path, name)


def test_the_settings_that_are_read_have_the_limits_of_those_that_are_written(document):
    schemas = document["components"]["schemas"]
    for read, written in (
        ("TrackerSettings", "SetTracker"),
        ("RobotSettings", "SetRobot"),
        ("ContactSettings", "SetContact"),
        ("ProbeSettings", "SetProbe"),
    ):
        there, here = (schemas[name]["properties"] for name in (read, written))
        for name in there.keys() & here.keys() - {"model"}:
            assert there[name] == here[name], (read, name)


def test_every_declared_number_has_its_range_label_and_unit_in_the_document(document):
    schemas, count = document["components"]["schemas"], 0
    for name, kind in REGISTRY.messages.items():
        for field, words in limits_of(kind).items():
            part = schemas[name]["properties"][field]
            if "minimum" in words:
                found = [(number["minimum"], number["maximum"]) for _, number in numbers(part)]
                assert set(found) == {(words["minimum"], words["maximum"])}, (name, field)
                count += 1
            if "label" in words:
                assert part["title"] == words["label"], (name, field)
                unit = f"In {words['unit']}" if words.get("unit") else ""
                said = part.get("description", "")
                assert said == ". ".join(filter(None, (unit, meaning(words)))), (name, field)
    assert count > 120


@pytest.mark.parametrize("name", REGISTRY.messages)
def test_every_number_is_taken_at_both_ends_of_its_range_and_refused_just_outside(document, name):
    kind = REGISTRY.messages[name]
    schema = whole(document["components"]["schemas"][name], document)
    limits, needed = limits_of(kind), schema.get("required", ())
    needed = {field: valid(schema["properties"][field], Random(1)) for field in needed}
    for field, body in outside(schema, Random(1)):
        if "minimum" in limits[field]:
            with pytest.raises(RonaError, match=field):
                message_from(name, body)
    if any("rule" in words and "pattern" not in words for words in limits.values()):
        return  # several fields go together: the slow test sends such bodies
    tied = {words["above"][0] for words in limits.values() if "above" in words}
    for field, words in limits.items():
        if schema["properties"][field].get("type") in NUMERIC and not (
            field in tied or "above" in words
        ):
            for end in (words["minimum"], words["maximum"]):
                assert getattr(message_from(name, {**needed, field: end}), field) == end


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_valid_by_the_document_is_not_refused_for_what_it_holds(document, send, seed):
    draw, routes, refused = Random(seed), list(bodies(document)), []
    for number in range(COUNT):
        method, path, schema = routes[number % len(routes)]
        if path.endswith("/sessions") and number >= len(routes):
            continue
        name, body = path.rpartition("/")[2], valid(schema, draw)
        answer = send(method, path, body)
        expected = RULES.get(name, ("(?!)",))[0], OF_SESSION.get(name, "(?!)")
        if answer.status_code not in (200, 201, 202, 404, 409) and not (
            answer.status_code == 422
            and any(re.search(words, answer.json()["detail"]) for words in expected)
        ):
            refused.append((name, answer.text[:300], json.dumps(body)[:300]))
    assert refused == []


@pytest.mark.slow
def test_what_is_just_outside_is_refused_and_its_field_named(document, send, client, session):
    before, draw, count = client.get(f"/sessions/{session}").json(), Random(3), 0
    for method, path, schema in bodies(document):
        for name, body in outside(schema, draw):
            answer = send(method, path, body)
            assert answer.status_code == 422, (path, name, body)
            told = answer.json()
            assert name in told["detail"] or f"/{name}" in str(told["errors"]), (path, name, told)
            count += 1
    assert count > 600
    assert client.get(f"/sessions/{session}").json() == before


def test_the_rules_that_a_schema_cannot_say_are_these_and_described(document):
    said = {}
    for _, path, schema in bodies(document):
        fields = [
            name
            for name, part in schema["properties"].items()
            if re.sub(r"^In \S+(\. )?", "", part.get("description", ""))
        ]
        said[path.rpartition("/")[2]] = fields
    for name, (_, fields) in RULES.items():
        assert set(fields) <= set(said[name]), name
    beyond = {
        (name, field)
        for name, kind in REGISTRY.messages.items()
        for field, words in limits_of(kind).items()
        if ("rule" in words and "pattern" not in words) or "above" in words
    }
    assert beyond == {
        (name, field)
        for name, (_, fields) in RULES.items()
        for field in fields
        if name in REGISTRY.messages and "pattern" not in limits_of(REGISTRY.messages[name])[field]
    }


@pytest.mark.parametrize("angle", [1e308, 361.0, -361.0, 200.0])
def test_a_move_beyond_the_limits_of_the_joints_is_refused_at_once(at, angle):
    for path in ("/jobs/StartRobotMove", "/robot/move"):
        answer = at("POST", path, json={"joints_deg": [angle, 0, 0, 0, 0, 0]})
        assert answer.status_code == 422, answer.text
        assert "must be -" in answer.json()["detail"]


@pytest.mark.parametrize("center", [[0, 0, 0], [9e4, 0, 0], [1e308, 0, 0]])
def test_a_region_off_the_skull_is_refused_at_once(at, client, center):
    assert at("POST", "/commands/SetRegion", json={"radius_mm": 20}).status_code == 200
    answer = at("POST", "/commands/SetRegion", json={"center_mesh_mm": center})
    assert answer.status_code == 422, answer.text
    assert "center" in answer.json()["detail"] or "must lie on the skull" in answer.json()["detail"]
    on_bone = {"center_mesh_mm": [-67.8, -35.0, 45.0]}
    assert at("POST", "/commands/SetRegion", json=on_bone).status_code == 200
    assert at("POST", "/commands/SetSeed", json={"seed": 8}).status_code == 200
