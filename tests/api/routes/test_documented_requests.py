"""Every request in the documents is one that the server answers, and every result has a route.

They are taken from the pages (code spans and lines of curl) and sent to a running server with the
demo session, each as it stands there.
"""

import re
from urllib.parse import quote

import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.session.files import session_bytes
from tests.api.cli.test_cli_hand_eye import table
from tests.core.calibration.hand_eye.test_recorded_hand_eye import made
from tests.helpers.cut_captures import captures_held, with_cut_capture
from tests.helpers.documented_requests import documented
from tests.scenes import demo_parts

STREAMS = ("/stream", "/events")
RF = "/captures/scan/value/scans/rf"
POSES = b"\n".join(b"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" for _ in range(8))
BODIES = {  # of requests whose pages leave them out, by the end of the path
    "/visible": {"visible": True},
    "/pose": {"wxyz": [1, 0, 0, 0], "translation_mm": [0, 0, -1500]},
    "/operator/pointer": {"wxyz": [1, 0, 0, 0]},
    "/sessions/open": {"file": "documented.rona"},
    "/save": {"file": "documented", "replace": True},
    "/settings": {},
    "/robot/contact": {},
    "/jobs/StartComparison": {"file": "bone.stl"},
}
ELSEWHERE = (".script", ".mcap")  # for arms of another maker, and by an extra
FILES = ("documented.rona", "reloaded.rona")
NOT_NOW = {  # what the pages say is refused in a state like this one
    ("POST", "/recoverable/{key}/open"): (404, "not_found"),
    ("DELETE", "/recoverable/{key}"): (404, "not_found"),
    ("DELETE", "/jobs/{id}"): (409, "job_finished"),
    ("PUT", "…/operator/pointer"): (409, "device_error"),
    ("POST", "…/operator/pointer/finish"): (409, "device_error"),
}
REQUESTS = documented()
pytestmark = pytest.mark.slow
READING = [one for one in REQUESTS if one.method == "GET"]
CHANGING = [one for one in REQUESTS if one.method != "GET"]


def name_of(request):
    return f"{request.method} {request.path}"


@pytest.fixture(scope="module")
def demo(client):
    """The id of a copy of the demo session."""
    made = client.post("/sessions/demo")
    assert made.status_code == 201, made.text
    session = made.json()["id"]
    motion = client.get(f"/sessions/{session}/roll/motion").content
    client.post(f"/sessions/{session}/uploads", params={"name": "scan.csv"}, content=motion)
    yield session
    client.delete(f"/sessions/{made.json()['id']}")


@pytest.fixture(scope="module")
def copy(client, web):
    """The id of a copy of the demo session that is changed; a file of it is there."""
    made = client.post("/sessions/demo").json()["id"]
    saved = client.post(f"/sessions/{made}/save", json={"file": "documented", "replace": True})
    assert saved.status_code == 200, saved.text
    yield made
    for one in client.get("/sessions").json()["sessions"]:
        if one["name"] in ("first", "untitled") or one["file"] in FILES:
            client.delete(f"/sessions/{one['id']}")
    client.delete(f"/sessions/{made}")
    for name in FILES:
        for file in web.hub.files.folder.glob(f"{name}*"):
            file.unlink()


def job_of(client, session):
    """Return the id of a job of a session that has ended."""
    started = client.post(f"/sessions/{session}/jobs/StartPivotImport", json={"files": ["no"]})
    job = started.json()["id"]
    while not client.get(f"/jobs/{job}").json()["finished"]:
        pass
    return job


def addresses(request, session, job):
    """Return the addresses that the path of a request stands for."""
    path = request.path.replace("…", f"/sessions/{session}", 1)
    path = path.replace("since=N", "since=0").replace("NAME", "{name}")
    path = path.replace("/jobs/{id}", f"/jobs/{job}").replace("/jobs/ID", f"/jobs/{job}")
    path = path.replace("/{kind}/{name}", "/commands/{Name}")
    path = path.replace("/commands/{Name}", "/commands/Undo")
    path = path.replace("/jobs/{Name}", "/jobs/StartReplay")
    path = path.replace("/{first, second or hand}/{number}", "/first/0")
    path = path.replace("/captures/{n}", "/captures/1").replace("{key}", "none")
    path = path.replace("/tools/{name}", "/tools/pointer6d")
    path = path.replace("{step}/array?at=POINTER", f"scan/array?at={quote(RF)}")
    if "{step}" in path:
        return [path.replace("{step}", f"{step}?max_points=2") for step in REGISTRY.listed]
    if "{name}" in path:
        here = [name for name in REGISTRY.exports if not name.endswith(ELSEWHERE)]
        return [path.replace("{name}", quote(name)) for name in here]
    assert not re.search(r"[{}…]", path), f"{request.page}: what does {request.path} stand for?"
    return [path]


@pytest.mark.parametrize("request_", READING, ids=name_of)
def test_what_the_pages_read_is_there(client, anonymous, web, demo, request_):
    for path in addresses(request_, demo, job_of(client, demo) if "jobs" in request_.path else ""):
        if path.startswith("/api"):
            headers = {"Authorization": f"Bearer {web.token}"}
            assert anonymous.get(path, headers=headers).status_code == 200, path
            continue
        with client.stream("GET", path) as answer:
            if not path.partition("?")[0].endswith(STREAMS):
                answer.read()
            assert answer.status_code == 200, (request_.page, path)


@pytest.mark.parametrize("name", captures_held(demo_parts.demo()))
def test_every_read_is_answered_beside_a_capture_that_was_stopped(client, name):
    """What rests on the whole capture may be refused in words; no read is a fault."""
    file = session_bytes(with_cut_capture(demo_parts.demo(), name))
    session = client.post("/sessions/upload", content=file).json()["id"]
    here = [one for one in READING if "…" in one.path and "jobs" not in one.path]
    for path in (path for one in here for path in addresses(one, session, "")):
        with client.stream("GET", path) as answer:
            if not path.partition("?")[0].endswith(STREAMS):
                answer.read()
            assert answer.status_code < 500, path
    client.delete(f"/sessions/{session}")


@pytest.mark.parametrize("request_", CHANGING, ids=name_of)
def test_what_the_pages_change_is_taken(client, web, copy, request_):
    bare = request_.path.partition("?")[0]
    if bare == "…/reload":  # the session that comes back has another id
        copy = client.post("/sessions/demo").json()["id"]
        client.post(f"/sessions/{copy}/save", json={"file": "reloaded", "replace": True})
    job = job_of(client, copy) if "jobs" in bare else ""
    (path,) = addresses(request_, copy, job)
    if bare in ("…/undo", "…/redo", "…/commands/{Name}", "…/{kind}/{name}"):
        client.post(f"/sessions/{copy}/commands/RenameSession", json={"name": "renamed"})
    if bare == "…/redo":
        client.post(f"/sessions/{copy}/undo")
    rest = body_for(client, copy, request_, bare)
    answer = client.request(request_.method, path, **rest)
    status, code = NOT_NOW.get((request_.method, bare), (None, None))
    if status is None:
        assert answer.is_success, (request_.page, path, answer.text)
    else:
        assert (answer.status_code, answer.json()["code"]) == (status, code)
    if bare == "…/reload":
        copy = answer.json()["id"]
    bench = web.hub.get(copy)
    for started in bench.jobs.all():
        bench.jobs.cancel(started.id)
        bench.jobs.wait(started.id, 60)
    while client.get(f"/sessions/{copy}").json()["can_undo"]:
        client.post(f"/sessions/{copy}/undo")


def body_for(client, session, request, bare):
    """Return what a request sends: as its page has it, else what such a route takes."""
    if bare.endswith("/uploads"):
        return {"content": POSES}
    if bare.endswith("/sessions/upload"):
        return {"content": client.get(f"/sessions/{session}/file").content}
    if "/calibrations/" in bare:
        for name, poses in zip(("robot.csv", "board.csv"), made(30), strict=True):
            address = f"/sessions/{session}/uploads?name={name}"
            assert client.post(address, content=table(poses).encode()).is_success
    if bare.endswith("/robot/move"):
        return {
            "json": {
                "joints_deg": client.get(f"/sessions/{session}/robot/state").json()["joints_deg"]
            }
        }
    if request.body and "…" not in request.body:
        headers = {"Content-Type": "application/json"}
        return {"content": request.body.encode(), "headers": headers}
    return {"json": next((v for k, v in BODIES.items() if bare.endswith(k)), None)}


def test_the_pages_speak_of_requests():
    assert len(READING) > 40
    assert len(CHANGING) > 25
