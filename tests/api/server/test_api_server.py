"""The server as a whole: starting, the first session, ending; and REST against Python."""

import dataclasses
import threading

import httpx2
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import serialize_arguments
from rona_core.app.procedure import PROCEDURE
from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.acoustics.messages import StartCaliperMeasurements
from rona_core.app.steps.implant.burr.messages import StartBurrCapture
from rona_core.app.steps.implant.messages import PlanMilling, RehearseMilling, StartBedSearch
from rona_core.app.steps.maps.messages import StartMapping, StartTiltPlan, StartTiltScan
from rona_core.app.steps.path.messages import StartPathCapture
from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.messages import StartProbeMountingCapture, StartScan
from rona_core.app.steps.setup.messages import SetPointer, SetRegion, SetSeed, SetTracker
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.messages import StartSurfaceCapture
from rona_core.app.steps.tool.messages import StartToolCapture
from rona_core.compose import build_registry
from rona_core.errors import InvalidInputError, SessionFormatError
from rona_core.session.codec import digest
from rona_core.session.document import Session, Setup
from rona_core.session.files import save_session
from rona_ui.server import ServerSettings, address, serve
from tests.helpers.api_server import TOKEN, start


def content(session):
    """Everything that must agree: all but id, name and times."""
    log = [(entry.number, entry.message, entry.arguments) for entry in session.log]
    parts = (session.setup, session.captures, session.results)
    return [digest(part) for part in parts], [digest(c) for c in session.archive], log


def through_rest(client, messages, name="rest", seed=3):
    session = client.post("/sessions", json={"name": name, "seed": seed}).json()["id"]
    for message in messages:
        kind = type(message).__name__
        body = serialize_arguments(message)
        if kind in REGISTRY.command_types:
            answer = client.post(f"/sessions/{session}/commands/{kind}", json=body)
            assert answer.status_code == 200, answer.text
            continue
        job = client.post(f"/sessions/{session}/jobs/{kind}", json=body).json()
        with client.stream("GET", f"/jobs/{job['id']}/events") as stream:
            last = [line for line in stream.iter_lines() if line.startswith("data")][-1]
        assert '"state":"done"' in last, last
    return session


def in_python(folder, messages, seed=3):
    hub = build_registry(folder, processes=False)
    bench = hub.create("python", seed)
    for message in messages:
        if type(message).__name__ in REGISTRY.command_types:
            bench.dispatch(message)
        else:
            bench.run(message)
    session = bench.session
    hub.close_all()
    return session


def test_rest_and_python_give_the_same_session(client, web, replayed, tmp_path):
    messages = [
        SetSeed(11),
        SetTracker("white035", 30.0),
        SetPointer("pointer5d"),
        StartPointerCapture(cone_deg=20.0, duration_s=3.0),
        CalibratePointer("sphere"),
        Undo(),
        StartPointerCapture(duration_s=2.0),
    ]
    session = through_rest(client, messages)
    assert content(web.hub.get(session).session) == content(in_python(tmp_path, messages))
    assert replayed(session)["same"]
    client.delete(f"/sessions/{session}")


# what the procedure does not make: no loaded skull, a base that stands well, no scan by hand, no
# further lines for the bed, and landmarks that agree
NOT_MADE = {"registration", "placement", "sono", "sono_detection", "sono_maps"}
NOT_MADE |= {"sono_pivot", "sono_spin", "sono_scan", "lines", "override"}
NOT_MADE |= {"looks", "quick_look", "cloud", "path_points", "robot_motion"}  # of other devices


@pytest.mark.slow
def test_the_whole_procedure_through_rest(client, web, tmp_path):
    messages = [  # all ten steps, over a small region
        SetRegion(radius_mm=14.0),
        StartToolCapture(n_pivot=12, n_translate=4),
        StartPointerCapture(duration_s=6.0),
        StartSurfaceCapture(duration_s=25.0),
        StartPathCapture(duration_s=15.0, spacing_mm=5.0),
        SmoothScanPath(),
        StartRollSearch(n_rolls=24),
        StartProbeMountingCapture(),
        StartScan(),
        StartMapping(),
        StartTiltPlan(),
        StartTiltScan(),
        StartCaliperMeasurements(),
        StartMapping(),
        StartBurrCapture(),
        StartBedSearch(implant="Osia/Baha screw"),
        PlanMilling(),
        RehearseMilling(),
    ]
    assert {type(stage.message) for stage in PROCEDURE} < {type(m) for m in messages}
    session = through_rest(client, messages)
    states = {s["name"]: s["state"] for s in client.get(f"/sessions/{session}/steps").json()}
    assert set(states.values()) == {"done"}
    rows = {row["key"]: row for row in client.get(f"/sessions/{session}/quality").json()}
    assert rows["surface_rms_mm"]["verdict"] == "pass"
    assert rows["thickness_rms_mm"]["value"] is not None
    assert rows["path_deviation_max_mm"]["limit"] == 1.0
    missing = set()
    for step in states:
        held = client.get(f"/sessions/{session}/results/{step}", params={"max_points": 20}).json()
        parts = held["captures"] | held["results"]
        missing |= {name for name, part in parts.items() if part["value"] is None}
        assert not any(part["stale_reason"] for part in parts.values())
    assert missing == NOT_MADE
    gain = client.get(f"/sessions/{session}/results/maps").json()["reference_gain"]
    assert len(gain["scans"]) == 3
    assert 0.0 < gain["then_mm"] < gain["now_mm"]  # even beside the points there are
    file = client.get(f"/sessions/{session}/file").content
    copy = client.post("/sessions/upload", content=file).json()["id"]
    there, back = (web.hub.get(key).session for key in (session, copy))
    assert digest(there) == digest(dataclasses.replace(back, id=there.id))
    assert content(there) == content(in_python(tmp_path, messages))
    for key in (session, copy):
        client.delete(f"/sessions/{key}")


# -- starting and ending ---------------------------------------------------------------------------


def test_a_server_ends_while_streams_are_open(tmp_path):
    hub = build_registry(tmp_path, processes=False)
    hub.create()
    settings = ServerSettings(port=0, sessions=tmp_path, token=TOKEN)
    server, thread, port = start(hub, None, settings)
    headers = {"Authorization": f"Bearer {TOKEN}"}
    url = f"http://127.0.0.1:{port}/api/v1"
    with (
        httpx2.Client(headers=headers, timeout=30) as client,
        client.stream("GET", f"{url}/status/events") as program,
        client.stream("GET", f"{url}/sessions/current/events?since=0") as session,
        client.stream("GET", f"{url}/sessions/current/robot/stream") as robot,
    ):
        lines = program.iter_lines()
        next(lines)
        server.should_exit = True
        for stream in (session, robot):
            list(stream.iter_lines())  # ends by itself
        list(lines)
    thread.join(30)
    assert not thread.is_alive()
    hub.close_all()


def test_a_file_is_opened_first_of_another_folder_a_copy(tmp_path):
    elsewhere, folder = tmp_path / "else.rona", tmp_path / "sessions"
    hub = build_registry(folder, processes=False)
    for path in (elsewhere, folder / "own.rona"):
        save_session(Session(name="bone", setup=Setup(seed=42)), path)
        hub.open_path(path)
        assert hub.get().session.setup.seed == 42
    own, copy = hub.all()[1], hub.all()[0]
    assert hub.file(own.session.id) == folder / "own.rona"
    assert hub.file(copy.session.id) is None  # saving does not write it over
    elsewhere.write_bytes(b"of another age")
    with pytest.raises(SessionFormatError):
        hub.open_path(elsewhere)
    hub.close_all()


def test_the_address_of_a_file_is_that_of_the_session(tmp_path):
    plain = ServerSettings(sessions=tmp_path, token=None)
    assert address(plain, 8642) == "http://127.0.0.1:8642/"
    with_file = ServerSettings(sessions=tmp_path, token="t", file=tmp_path / "bone.rona")
    assert address(with_file, 8642) == "http://127.0.0.1:8642/session?token=t"


def test_a_port_that_is_taken_is_refused_by_name(tmp_path, web):
    def never(*_):
        raise AssertionError("nothing must be built before the port is ours")

    settings = ServerSettings(port=web.port, sessions=tmp_path, token="t")
    with pytest.raises(InvalidInputError, match=str(web.port)):
        serve(settings, build_registry=never, open_window=never, say=never)


def test_serve_opens_the_window_says_the_address_and_cleans_up(tmp_path, monkeypatch):
    told, closed = [], threading.Event()

    class Window:
        def close(self):
            closed.set()

    class Once:
        def __init__(self, *_):
            pass

        def run(self, sockets):
            told.append(sockets[0].getsockname()[1])

    monkeypatch.setattr("rona_ui.server.server_of", Once)
    settings = ServerSettings(port=0, sessions=tmp_path, token="t", open_browser=False)
    serve(
        settings,
        build_registry=lambda folder: build_registry(folder, processes=False),
        open_window=lambda server, hub: Window(),
        say=told.append,
    )
    assert told[0] == f"http://127.0.0.1:{told[1]}/?token=t"
    assert closed.is_set()
