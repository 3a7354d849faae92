"""Every command and activity has a route, every refusal is a problem, and nothing answers 5xx."""

import dataclasses
import json
import re

import pytest

from rona_core import __version__
from rona_core.app.declarations.registry import REGISTRY
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session
from rona_ui.api.problems import TITLES
from rona_ui.server import PREFIX, TAGS

PROBLEM = "application/problem+json"
JSON = {"Content-Type": "application/json"}
ROUTES = """
GET /sessions; POST /sessions; POST /sessions/open; POST /sessions/upload; POST /sessions/demo
GET /sessions/{session_id}; DELETE /sessions/{session_id}; GET /sessions/{session_id}/file
POST /sessions/{session_id}/save; POST /sessions/{session_id}/current
POST /sessions/{session_id}/reload
GET /recoverable; POST /recoverable/{key}/open; DELETE /recoverable/{key}
GET /sessions/{session_id}/captures/{ordinal}/file
POST /sessions/{session_id}/uploads; POST /sessions/{session_id}/undo
POST /sessions/{session_id}/redo; GET /sessions/{session_id}/steps
GET /sessions/{session_id}/results/{step}; GET /sessions/{session_id}/frames
GET /sessions/{session_id}/results/{step}/array
GET /sessions/{session_id}/calibration/{step}; GET /sessions/{session_id}/ascans/{scan}/{number}
POST /sessions/{session_id}/calibrations/hand-eye
POST /sessions/{session_id}/calibrations/hand-eye/picture
GET /sessions/{session_id}/quality; GET /sessions/{session_id}/report
GET /sessions/{session_id}/figures; GET /sessions/{session_id}/figures/{name}
GET /sessions/{session_id}/volume
GET /sessions/{session_id}/maps/draws; GET /sessions/{session_id}/maps/comparison
GET /sessions/{session_id}/export/{name}
GET /sessions/{session_id}/motion/verdict
GET /sessions/{session_id}/{step}/motion
PUT /sessions/{session_id}/picture
GET /files; GET /files/{file}/picture; GET /sessions/{session_id}/procedure
GET /sessions/{session_id}/next
GET /sessions/{session_id}/events
POST /sessions/{session_id}/replay; GET /jobs; GET /jobs/{job_id}; DELETE /jobs/{job_id}
GET /jobs/{job_id}/events; GET /status; GET /status/events
GET /sessions/{session_id}/tracker/settings; PUT /sessions/{session_id}/tracker/settings
PUT /sessions/{session_id}/tracker/tools/{name}/visible
PUT /sessions/{session_id}/tracker/tools/{name}/pose
DELETE /sessions/{session_id}/tracker/tools/{name}/pose
GET /sessions/{session_id}/tracker/frame; GET /sessions/{session_id}/tracker/stream
POST /sessions/{session_id}/tracker/start; POST /sessions/{session_id}/tracker/stop
GET /sessions/{session_id}/robot/state; POST /sessions/{session_id}/robot/move
GET /sessions/{session_id}/robot/settings; PUT /sessions/{session_id}/robot/settings
GET /sessions/{session_id}/robot/figures; GET /sessions/{session_id}/robot/head
GET /sessions/{session_id}/robot/contact; PUT /sessions/{session_id}/robot/contact
POST /sessions/{session_id}/robot/stop; GET /sessions/{session_id}/robot/stream
GET /sessions/{session_id}/probe/settings; PUT /sessions/{session_id}/probe/settings
POST /sessions/{session_id}/probe/acquire
GET /sessions/{session_id}/operator/pointer; PUT /sessions/{session_id}/operator/pointer
POST /sessions/{session_id}/operator/pointer/finish
"""
WRITTEN = {tuple(line.split()) for line in re.split(r"[;\n]", ROUTES) if line.strip()}
GENERATED = {
    ("POST", f"/sessions/{{session_id}}/commands/{name}") for name in REGISTRY.command_types
} | {("POST", f"/sessions/{{session_id}}/jobs/{name}") for name in REGISTRY.activity_types}


def refused(answer, status, code):
    assert (answer.status_code, answer.headers["content-type"]) == (status, PROBLEM), answer.text
    body = answer.json()
    assert body["code"] == code, body
    assert body["status"] == status
    assert body["detail"]
    assert "Traceback" not in answer.text
    return body


def operations(document):
    return {
        (verb.upper(), path.removeprefix(PREFIX)): operation
        for path, verbs in document["paths"].items()
        for verb, operation in verbs.items()
    }


@pytest.fixture(scope="module")
def document(client):
    return client.get("/openapi.json").json()


def test_the_routes_are_these_and_no_others(document):
    assert set(operations(document)) == WRITTEN | GENERATED


def test_every_route_is_described(document):
    tags = {tag["name"] for tag in document["tags"]}
    assert tags == set(TAGS)
    for where, operation in operations(document).items():
        assert set(operation["tags"]) <= tags, where
        assert operation["summary"].endswith((".", ":", ";")) or len(operation["summary"]) > 20
        assert "401" in operation["responses"], where


def test_every_refusal_is_in_the_document(document):
    refusals = {str(status) for status in TITLES} - {"415"}  # no route looks at the media type
    for where, operation in operations(document).items():
        assert refusals <= operation["responses"].keys(), where
        for status in refusals:
            content = operation["responses"][status]["content"]
            assert content == {PROBLEM: {"schema": {"$ref": "#/components/schemas/Problem"}}}


def test_no_json_is_described_as_text(document):
    for where, operation in operations(document).items():
        for status, answer in operation["responses"].items():
            schema = answer.get("content", {}).get("application/json", {}).get("schema", {})
            assert schema.get("type") != "string", (where, status)
    held = operations(document)["GET", "/sessions/{session_id}/calibration/{step}"]["responses"]
    assert held["200"]["content"]["application/json"]["schema"] == {"type": ["object", "null"]}


@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/robot/contact", "GET, PUT"),
        ("/operator/pointer", "GET, PUT"),
        ("", "DELETE, GET"),
        ("/undo", "POST"),
    ],
)
def test_a_wrong_method_is_told_all_the_right_ones(at, path, methods):
    answer = at("PATCH", path)
    assert (answer.status_code, answer.headers["allow"]) == (405, methods)


def test_every_reference_in_the_document_leads_somewhere(document):
    for reference in set(re.findall(r'"\$ref": "#/([^"]+)"', json.dumps(document))):
        part = document
        for key in reference.split("/"):
            part = part[key]
    assert "HTTPValidationError" not in json.dumps(document)


@pytest.mark.parametrize("name", REGISTRY.command_types | REGISTRY.activity_types)
def test_the_body_of_a_message_is_its_dataclass(document, name):
    kind = (REGISTRY.command_types | REGISTRY.activity_types)[name]
    schema = document["components"]["schemas"][name]
    assert schema["additionalProperties"] is False
    assert set(schema.get("properties", {})) == {field.name for field in dataclasses.fields(kind)}


@pytest.mark.parametrize("where", sorted(WRITTEN | GENERATED), ids=" ".join)
def test_nobody_gets_in_without_a_token(anonymous, where):
    method, path = where
    parts = {"step": "tool", "name": "toolmarker", "ordinal": 1, "scan": "first", "number": 0}
    parts["file"] = "demo.rona"
    path = path.format(session_id="current", job_id="x", key="x", **parts)
    assert refused(anonymous.request(method, PREFIX + path), 401, "unauthorized")


@pytest.mark.parametrize("name", REGISTRY.command_types)
def test_a_command_without_body_is_carried_out_or_refused_by_name(at, name):
    answer = at("POST", f"/commands/{name}")
    if answer.status_code == 200:
        assert answer.json() == {"command": name, "revision": 1}
    else:
        assert refused(answer, answer.status_code, answer.json()["code"])
        assert answer.status_code in (409, 422)
        assert at("GET", "").json()["revision"] == 0


@pytest.mark.parametrize("value", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
def test_numbers_that_are_none_are_refused(at, value):
    body = f'{{"profile": "ideal", "rate_hz": {value}}}'
    answer = at("POST", "/commands/SetTracker", content=body, headers=JSON)
    problem = refused(answer, 422, "invalid_input")
    assert [error["pointer"] for error in problem["errors"]] == ["/rate_hz"]
    assert at("GET", "").json()["revision"] == 0


def test_not_a_number_deep_inside_a_body_is_named(at):
    body = '{"joints_deg": [0, 0, NaN, 0, 0, Infinity]}'
    problem = refused(at("POST", "/robot/move", content=body, headers=JSON), 422, "invalid_input")
    assert [e["pointer"] for e in problem["errors"]] == ["/joints_deg/2", "/joints_deg/5"]


@pytest.mark.parametrize(
    ("body", "pointer"),
    [
        ({"seed": 1, "nonsense": 2}, "/nonsense"),
        ({"seed": "many"}, "/seed"),
        ({"seed": 1.5}, "/seed"),
        ({"seed": -1}, ""),
        ({}, "/seed"),
        ([], ""),
        ({"seed": 1, "a/b~c": 2}, "/a~1b~0c"),
    ],
)
def test_what_does_not_fit_is_named(at, body, pointer):
    problem = refused(at("POST", "/commands/SetSeed", json=body), 422, "invalid_input")
    assert problem["errors"][0]["pointer"] == pointer


@pytest.mark.parametrize("text", [b"{", b"\xff\xfe", b"[" * 60_000, b'{"seed": 1' + b"0" * 5000])
def test_a_body_that_is_not_json_is_a_problem(at, text):
    answer = at("POST", "/commands/SetSeed", content=text, headers=JSON)
    assert answer.status_code in (400, 422)
    assert answer.headers["content-type"] == PROBLEM


def test_half_a_character_is_refused(at):
    body = '{"name": "\\ud800"}'
    assert refused(
        at("POST", "/commands/RenameSession", content=body, headers=JSON), 422, "invalid_input"
    )
    assert refused(
        at("POST", "/save", content='{"file": "\\udfff"}', headers=JSON), 422, "invalid_input"
    )


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("GET", "/sessions/unknown"),
        ("POST", "/sessions/unknown/commands/Undo"),
        ("POST", "/sessions/unknown/robot/stop"),
        ("GET", "/sessions/unknown/events"),
        ("GET", "/jobs/unknown"),
        ("DELETE", "/jobs/unknown"),
        ("GET", "/jobs/unknown/events"),
        ("GET", "/nothing"),
        ("POST", "/sessions/unknown/commands/StoreResult"),
    ],
)
def test_what_is_not_there_is_a_problem(client, method, path):
    assert refused(client.request(method, path), 404, "not_found")


def test_an_outcome_cannot_be_posted(at):
    assert refused(at("POST", "/commands/StoreCapture", json={}), 404, "not_found")


def test_a_wrong_method_is_a_problem(at):
    assert refused(at("PATCH", "/steps"), 405, "method_not_allowed")


def test_a_body_that_is_too_large_is_refused(at):
    body = json.dumps({"name": "x" * 2_000_000})
    assert refused(
        at("POST", "/commands/RenameSession", content=body, headers=JSON), 413, "too_large"
    )


def test_undo_and_redo(at):
    assert refused(at("POST", "/undo"), 422, "invalid_input")
    at("POST", "/commands/SetSeed", json={"seed": 9})
    assert at("POST", "/undo").json() == {"command": "Undo", "revision": 2}
    assert at("GET", "").json()["seed"] == 3
    assert at("POST", "/redo").json() == {"command": "Redo", "revision": 3}
    assert at("GET", "").json()["seed"] == 9


def test_a_blocked_job_does_not_start(at, client):
    for name in ("StartScan", "StartMapping", "StartRollSearch", "StartSurfaceCapture"):
        problem = refused(at("POST", f"/jobs/{name}"), 409, "step_blocked")
        assert "first" in problem["detail"]


# -- sessions and files ----------------------------------------------------------------------------


def test_current_is_the_session_shown_last(client, session):
    assert client.get("/sessions/current").json()["id"] == session
    other = client.post("/sessions").json()
    assert other["current"]
    assert client.get("/sessions/current").json()["id"] == other["id"]
    assert client.post(f"/sessions/{session}/current").json()["current"]
    listed = {s["id"]: s["current"] for s in client.get("/sessions").json()["sessions"]}
    assert listed[session]
    assert not listed[other["id"]]
    assert client.delete(f"/sessions/{other['id']}").status_code == 204
    assert refused(client.get(f"/sessions/{other['id']}"), 404, "not_found")


@pytest.mark.parametrize("body", [{"name": ""}, {"name": "x" * 81}, {"seed": -1}, {"sead": 1}])
def test_a_session_cannot_be_made_of_nonsense(client, body):
    assert refused(client.post("/sessions", json=body), 422, "invalid_input")


def test_saving_downloading_and_opening_again(at, client, web):
    at("POST", "/commands/SetSeed", json={"seed": 77})
    assert not at("GET", "").json()["saved"]
    saved = at("POST", "/save", json={"file": "kept"}).json()
    assert (saved["saved"], saved["file"]) == (True, "kept.rona")
    assert at("GET", "/file").content == (web.folder / "kept.rona").read_bytes()
    assert "kept.rona" in client.get("/sessions").json()["files"]
    stored = load_session(web.folder / "kept.rona")
    copies = [
        client.post("/sessions/open", json={"file": "kept.rona"}),
        client.post("/sessions/upload?name=up.rona", content=at("GET", "/file").content),
    ]
    for copy in copies:
        assert copy.status_code == 201
        assert copy.headers["location"] == f"{PREFIX}/sessions/{copy.json()['id']}"
        opened = web.hub.get(copy.json()["id"]).session
        assert digest(dataclasses.replace(opened, id=stored.id)) == digest(stored)
        client.delete(f"/sessions/{opened.id}")
    at("POST", "/commands/SetSeed", json={"seed": 78})
    assert not at("GET", "").json()["saved"]


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        ({"file": "absent.rona"}, 404, "not_found"),
        ({"file": "../kept.rona"}, 422, "invalid_input"),
        ({"file": ".hidden"}, 422, "invalid_input"),
        ({"file": "a\0b"}, 422, "invalid_input"),
        ({"file": "x" * 500}, 422, "invalid_input"),
        ({}, 422, "invalid_input"),
    ],
)
def test_a_file_that_cannot_be_opened(client, body, status, code):
    assert refused(client.post("/sessions/open", json=body), status, code)


def test_the_last_good_copy_of_a_damaged_file_is_named_and_can_be_opened(client, web):
    path = web.folder / "hurt.rona"
    save_session(Session(name="older"), path)
    save_session(Session(name="newer"), path)
    path.write_bytes(path.read_bytes()[:-100])
    body = refused(client.post("/sessions/open", json={"file": "hurt.rona"}), 422, "session_format")
    assert body["detail"].startswith("hurt.rona: the file is damaged: its end is missing")
    assert body["backup"] == "hurt.rona.bak"
    answer = client.post("/sessions/open", json={"file": "hurt.rona", "backup": True})
    assert answer.status_code == 201
    opened = answer.json()
    assert (opened["name"], opened["saved"], opened["file"]) == ("older", False, None)
    assert client.delete(f"/sessions/{opened['id']}").status_code == 204
    (web.folder / "hurt.rona.bak").unlink()
    body = refused(client.post("/sessions/open", json={"file": "hurt.rona"}), 422, "session_format")
    assert "backup" not in body
    wanted = {"file": "hurt.rona", "backup": True}
    assert refused(client.post("/sessions/open", json=wanted), 404, "not_found")


def test_a_damaged_upload_is_refused_and_nothing_opens(client, at):
    before = len(client.get("/sessions").json()["sessions"])
    content = at("GET", "/file").content
    assert refused(client.post("/sessions/upload", content=b""), 422, "invalid_input")
    for damaged in (b"PK", content[:-50], content[:100] + b"x" + content[101:]):
        answer = client.post("/sessions/upload", content=damaged)
        assert refused(answer, 422, "session_format")
    assert len(client.get("/sessions").json()["sessions"]) == before


LONG = "\U0001d538" * 100  # 400 bytes
NOT_PLAIN = ["../x", "a/b", ".x", "\\x", "a\nb", "a\0b", "a\u202eb", "..", LONG]


@pytest.mark.parametrize("file", NOT_PLAIN)
def test_what_is_no_plain_file_name_is_refused_everywhere(at, client, web, file):
    before = sorted(web.folder.rglob("*"))
    assert refused(at("POST", "/save", json={"file": file}), 422, "invalid_input")
    assert refused(client.post("/sessions/open", json={"file": file}), 422, "invalid_input")
    assert refused(
        at("POST", "/uploads", params={"name": file}, content=b"x"), 422, "invalid_input"
    )
    assert refused(at("POST", "/jobs/StartSkullImport", json={"file": file}), 422, "invalid_input")
    both = {"file": "a.stl", "inner_file": file}
    assert refused(at("POST", "/jobs/StartSkullImport", json=both), 422, "invalid_input")
    assert sorted(web.folder.rglob("*")) == before


def test_a_session_is_saved_whatever_its_name(at, web):
    for name in ("x" * 80, "\U0001d538" * 80, "../../x", "."):
        assert at("POST", "/commands/RenameSession", json={"name": name}).status_code == 200
        free = web.hub.files.free_path(name)
        assert free.parent == web.folder
        saved = at("POST", "/save", json={"file": free.stem})
        assert saved.status_code == 200
        assert (web.folder / saved.json()["file"]).is_file()


def test_nothing_is_written_over_a_folder(at, web):
    (web.folder / "folder.rona").mkdir()
    assert refused(at("POST", "/save", json={"file": "folder"}), 422, "invalid_input")
    (web.hub.files.uploads / "folder.stl").mkdir(parents=True)
    upload = at("POST", "/uploads", params={"name": "folder.stl"}, content=b"x")
    assert refused(upload, 422, "invalid_input")


def test_a_specimen_is_uploaded_as_raw_bytes(at, web):
    data = bytes(range(256)) * 8000  # more than other bodies may have
    answer = at("POST", "/uploads", params={"name": "bone.stl"}, content=data)
    assert answer.status_code == 201
    assert answer.json() == {"file": "bone.stl", "size_bytes": len(data)}
    assert (web.hub.files.uploads / "bone.stl").read_bytes() == data
    for name in ("../bone.stl", "", ".bone"):
        assert refused(
            at("POST", "/uploads", params={"name": name}, content=b"x"), 422, "invalid_input"
        )


def test_an_import_of_rubbish_fails_by_name(at, web, client):
    at("POST", "/uploads", params={"name": "rubbish.stl"}, content=b"not a mesh")
    job = at("POST", "/jobs/StartSkullImport", json={"file": "rubbish.stl"}).json()
    ended = web.hub.get(job["session"]).jobs.wait(job["id"], 60)
    assert (ended.state, ended.error_code) == ("failed", "invalid_input")
    assert client.get(f"/jobs/{job['id']}").json()["error"]


def test_there_is_a_demo_session_or_a_reason(client):
    answer = client.post("/sessions/demo")
    if answer.status_code == 201:
        client.delete(f"/sessions/{answer.json()['id']}")
    else:
        assert refused(answer, 404, "not_found")


# -- queries ---------------------------------------------------------------------------------------


def test_a_new_session_has_ten_steps_and_nothing_in_them(at):
    steps = at("GET", "/steps").json()
    assert [step["number"] for step in steps] == list(range(1, 11))
    assert [step["state"] for step in steps[:4]] == ["done", "ready", "ready", "blocked"]
    for step in steps:
        held = at("GET", f"/results/{step['name']}").json()
        assert held["step"] == step["name"]
        for part in (*held["captures"].values(), *held["results"].values()):
            assert part == {"value": None, "stale_reason": None}
    assert refused(at("GET", "/results/lunch"), 404, "not_found")
    assert refused(at("GET", "/results/tool", params={"max_points": 1}), 422, "invalid_input")


def test_figures_without_results_have_no_value_and_no_verdict(at):
    rows = at("GET", "/quality").json()
    assert {row["key"] for row in rows} >= {"tool_tip_error_mm", "surface_rms_mm", "outer_rms_mm"}
    figures = [row for row in rows if row["section"] != "The run as a whole"]
    assert {(row["value"], row["verdict"]) for row in figures} == {(None, "none")}
    assert all(row["says"] for row in rows)


def test_replay_of_nothing_is_the_same(session, replayed):
    found = replayed(session)
    assert found == {"same": True, "version": __version__, "by_version": [], "results": []}


def test_the_program_says_how_it_is(client, session):
    state = client.get("/status").json()
    assert state["session"]["id"] == session
    assert state["origin"] == "VIRTUAL"
    assert state["notice"] == "research software, not a medical device"


# -- pages -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "path", ["/", "/session", "/api/v1/docs", "/static/page/main.js", "/static/icon.svg"]
)
def test_pages_are_served_and_need_nothing_from_outside(anonymous, web, path):
    headers = {"Authorization": f"Bearer {web.token}"}
    answer = anonymous.get(path, headers=headers)
    assert answer.status_code == 200
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert not re.search(r"(src|href|url\()=?.?https?://", answer.text)
    assert anonymous.get(path).status_code == 401


def test_fastapis_own_pages_are_switched_off(anonymous, web):
    headers = {"Authorization": f"Bearer {web.token}"}
    for path in ("/docs", "/redoc", "/openapi.json"):
        assert refused(anonymous.get(path, headers=headers), 404, "not_found")


# -- A-scans ---------------------------------------------------------------------------------------


def test_an_a_scan_tells_what_was_found_and_what_was_corrected(client, at):
    opened = client.post("/sessions/demo").json()["id"]
    place, route = f"/sessions/{opened}", f"/sessions/{opened}/ascans/second/7"
    found = client.get(route).json()
    assert not found["by_hand"]
    assert len(found["rf"]) == len(found["time_us"]) == len(found["compressed"]) > 500
    body = {"number": 7, "scan": "second", "remove": "inner"}
    assert client.post(f"{place}/commands/CorrectBoundary", json=body).status_code == 200
    corrected = client.get(route).json()
    assert corrected["by_hand"]
    assert corrected["inner_us"] is None
    assert "taken away by hand" in corrected["remark"]
    maps = client.get(f"{place}/results/maps?max_points=10").json()
    assert len(maps["boundary_edits"]["changes"]) == 1
    assert "by hand" in maps["results"]["maps"]["stale_reason"]
    assert "sigma_mm" not in maps["results"]["maps"]["value"]["outer"]
    height = maps["results"]["maps"]["value"]["outer"]["height_mm"]
    for name in ("outer", "inner", "fused", "thickness"):
        part = maps["accuracy"][name]
        assert len(part["own_mm"]) == len(part["shared_mm"]) == len(height) == 10
        causes = [row["cause"] for row in part["budget"]]
        assert "interpolation" in causes
        assert ("links of the robot" in causes) == (name != "thickness")
    assert maps["sono_accuracy"] is None
    body = {"number": 7, "scan": "second", "outer_us": 18.0}
    assert client.post(f"{place}/commands/CorrectBoundary", json=body).status_code == 422
    assert client.get(f"{place}/ascans/second/99999").status_code == 404
    assert at("GET", "/ascans/first/0").status_code == 404
    assert at("GET", "/ascans/hand/0").status_code == 404
    assert at("GET", "/ascans/third/0").status_code == 422
    client.delete(place)


def test_the_current_session_is_found_while_the_one_before_is_closed(web, client, monkeypatch):
    stays, closing = (client.post("/sessions").json()["id"] for _ in range(2))
    whole = web.hub.file

    def file(session_id):  # closed just when somebody has begun to look at it
        monkeypatch.setattr(web.hub, "file", whole)
        web.hub.close(closing)
        return whole(session_id)

    monkeypatch.setattr(web.hub, "file", file)
    answer = client.get("/sessions/current")
    assert (answer.status_code, answer.json()["id"]) == (200, stays), answer.text
    assert refused(client.get(f"/sessions/{closing}"), 404, "not_found")
    client.delete(f"/sessions/{stays}")
