"""Unsaved work of an earlier run, over REST; and names of files that are taken."""

import pytest

from rona_core.app.runtime.session_step import RenameSession
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session
from rona_ui.api.context import PREFIX
from tests.api.routes.test_api_routes import refused


@pytest.fixture
def lost(web):
    """The session that another program left unsaved on the server's folder."""
    hub = build_registry(web.folder, processes=False)
    bench = hub.create("left <b>behind</b>", 3)
    bench.dispatch(SetSeed(31))
    bench.dispatch(RenameSession("left & behind"))
    hub.close_all()
    yield bench.session
    for key in web.hub.lost_keys():
        web.hub.discard(key)


def listed(client):
    return client.get("/recoverable").json()["recoverable"]


def test_what_was_left_is_listed_opened_and_then_listed_no_more(client, lost):
    (told,) = listed(client)
    assert (told["name"], told["revision"], told["problem"]) == (lost.name, 2, None)
    assert told["steps_done"] == ["setup"]
    assert told["size_bytes"] > 500
    assert told["changed_utc"].startswith("20")
    assert client.get("/status").json()["recoverable"] == 1

    answer = client.post(f"/recoverable/{told['key']}/open")
    assert answer.status_code == 201
    body = answer.json()
    assert body["problem"] is None
    opened = body["session"]
    assert answer.headers["location"] == f"{PREFIX}/sessions/{opened['id']}"
    flags = {key: opened[key] for key in ("saved", "recovered", "changes", "copy", "current")}
    assert flags == {
        "saved": False, "recovered": True, "changes": True, "copy": "kept", "current": True,
    }  # fmt: skip
    assert listed(client) == []
    assert client.get("/status").json()["recoverable"] == 0
    assert refused(client.post(f"/recoverable/{told['key']}/open"), 404, "not_found")
    saved = client.post(f"/sessions/{opened['id']}/save").json()
    assert (saved["saved"], saved["recovered"], saved["changes"]) == (True, False, False)
    client.delete(f"/sessions/{opened['id']}")


def test_a_recovered_session_is_what_it_was(client, web, lost):
    opened = client.post(f"/recoverable/{listed(client)[0]['key']}/open").json()["session"]
    assert opened["id"] == lost.id
    assert digest(web.hub.get(lost.id).session) == digest(lost)
    client.delete(f"/sessions/{lost.id}")


def test_what_is_discarded_is_gone(client, lost):
    (told,) = listed(client)
    assert client.delete(f"/recoverable/{told['key']}").status_code == 204
    assert listed(client) == []
    assert refused(client.delete(f"/recoverable/{told['key']}"), 404, "not_found")


@pytest.mark.parametrize("key", ["absent", "..%2f..%2fx", "%2e%2e", "x" * 90])
def test_no_other_file_is_reached_by_a_key(client, lost, key):
    assert client.post(f"/recoverable/{key}/open").status_code in (404, 405)
    assert client.delete(f"/recoverable/{key}").status_code in (404, 405)
    assert len(listed(client)) == 1


def test_a_copy_that_cannot_be_read_says_why(client, web, lost):
    (path,) = (web.folder / ".autosave").glob(f"*/{lost.id}.journal")
    path.write_bytes(b"PK damaged")
    (told,) = listed(client)
    assert told["name"] is None
    assert "not a readable journal" in told["problem"]
    assert refused(client.post(f"/recoverable/{told['key']}/open"), 422, "session_format")
    assert path.read_bytes() == b"PK damaged"


def test_the_state_of_the_program_has_all_open_sessions(client, web, session, at):
    at("POST", "/commands/SetSeed", json={"seed": 4})
    state = client.get("/status").json()
    assert state["run"] == web.hub.run
    (own,) = (each for each in state["sessions"] if each["id"] == session)
    assert (own["changes"], own["current"]) == (True, True)


def test_a_name_that_is_taken_is_refused_unless_it_is_to_be_replaced(client, at, web):
    save_session(Session(name="precious"), web.folder / "taken.rona")
    at("POST", "/commands/RenameSession", json={"name": "newer"})
    body = refused(at("POST", "/save", json={"file": "taken"}), 409, "name_taken")
    assert "taken.rona exists already" in body["detail"]
    assert load_session(web.folder / "taken.rona").name == "precious"
    saved = at("POST", "/save", json={"file": "taken", "replace": True}).json()
    assert (saved["file"], saved["saved"]) == ("taken.rona", True)
    assert load_session(web.folder / "taken.rona").name == "newer"
    assert load_session(web.folder / "taken.rona.bak").name == "precious"

    other = client.post("/sessions", json={"name": "other"}).json()["id"]
    answer = client.post(f"/sessions/{other}/save", json={"file": "taken.rona"})
    assert "open session" in refused(answer, 409, "name_taken")["detail"]
    client.delete(f"/sessions/{other}")


def test_a_file_that_another_program_has_changed_is_refused_reloaded_or_replaced(client, at, web):
    at("POST", "/save", json={"file": "shared"})
    at("POST", "/commands/RenameSession", json={"name": "mine"})
    path = web.folder / "shared.rona"
    save_session(Session(name="theirs"), path)
    body = refused(at("POST", "/save"), 409, "file_changed")
    assert "save under another name, reload it, or say" in body["detail"]
    assert load_session(path).name == "theirs"
    state = at("GET", "").json()
    assert (state["saved"], state["changes"], state["file_state"]) == (False, True, "changed")
    saved = at("POST", "/save", json={"replace": True}).json()
    assert (saved["saved"], saved["file_state"]) == (True, "same")
    assert load_session(path).name == "mine"

    path.unlink()
    state = at("GET", "").json()
    assert (state["saved"], state["copy"], state["file_state"]) == (False, "kept", "missing")
    assert refused(at("POST", "/reload"), 404, "not_found")
    assert at("POST", "/save").json()["saved"]

    save_session(Session(name="theirs"), path)
    answer = at("POST", "/reload")
    back = answer.json()
    assert answer.status_code == 201
    assert answer.headers["location"] == f"{PREFIX}/sessions/{back['id']}"
    assert (back["name"], back["saved"], back["current"]) == ("theirs", True, True)
    client.delete(f"/sessions/{back['id']}")
