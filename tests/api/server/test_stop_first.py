"""Stop is answered before whatever else is under way: the order of answers, in a real process."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time

import httpx2
import pytest

TOKEN = "a-token-of-the-tests"
# Whatever goes through a gate that is shut says so and waits there: the load is surely under way.
PROGRAM = """
import sys, time
from pathlib import Path

import fastapi.applications
import rona_core.app.runtime.session_registry as registry
import rona_core.app.runtime.store as store
import rona_core.app.steps.maps.comparison as comparison
import rona_ui.api.problems as problems
import rona_ui.api.routes.results as results
from rona_core.app.steps.path.messages import PaintRegion
from rona_ui.cli import main

folder = Path(sys.argv[1])


def gate(owner, attribute, name):
    held, number = getattr(owner, attribute), 0

    def through(*arguments, **named):
        nonlocal number
        if (folder / name).exists():
            number += 1
            (folder / f"{name}.{number}").touch()
            while (folder / name).exists():
                time.sleep(0.01)
        return held(*arguments, **named)

    setattr(owner, attribute, through)


# a job process imports this program under another name
gate(comparison, "read_triangles", "server" if __name__ == "__main__" else "reference")
if __name__ == "__main__":
    gate(PaintRegion, "__post_init__", "validation")
    gate(results, "plain", "reading")
    gate(store, "handle", "command")
    gate(registry, "Workbench", "opening")
    gate(fastapi.applications, "get_openapi", "document")
    gate(problems, "_methods", "methods")
    sys.exit(main(sys.argv[2:]))
"""
STROKE = {"kind": "scan", "stroke_base_mm": [[1.0, 2.0, 3.0]]}
# gate -> how often at once, and the request that waits there
WAITING = {
    "validation": (1, "POST", "/sessions/current/commands/PaintRegion", STROKE),
    "reading": (1, "GET", "/sessions/current/results/maps", None),
    "every thread reading": (60, "GET", "/sessions/current/results/maps", None),
    "every thread validating": (60, "POST", "/sessions/current/commands/PaintRegion", STROKE),
    "command": (1, "POST", "/sessions/current/commands/SetSeed", {"seed": 5}),
    "many commands": (60, "POST", "/sessions/current/commands/SetSeed", {"seed": 5}),
    "opening": (1, "POST", "/sessions", {"name": "another"}),
    "document": (1, "GET", "/openapi.json", None),
    "methods": (1, "PATCH", "/sessions/current/undo", None),
}
GATE = {"every thread reading": "reading", "every thread validating": "validation"}
GATE |= {"many commands": "command"}


def request(client, method, path, body, answered):
    answer = client.request(method, path, json=body)
    answered.append(("load", answer.status_code))


def wait_for(condition):
    deadline_s = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < deadline_s, "the load did not begin"
        time.sleep(0.01)


class Program:
    """A server with gates."""

    def __init__(self, folder, client, port, demo):
        self.folder, self.client, self.port, self.demo = folder, client, port, demo

    def stop(self, answered):
        limit_s = 30.0  # a server that lets Stop wait would let it wait for ever
        answer = self.client.post("/sessions/current/robot/stop", timeout=limit_s)
        answered.append(("stop", answer.status_code))


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    folder = tmp_path_factory.mktemp("gates")
    script = folder / "program.py"
    script.write_text(PROGRAM)
    told = subprocess.Popen(
        [sys.executable, script, folder, "serve", "--no-open", "--port", "0"]
        + ["--sessions", folder / "sessions"],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "RONA_TOKEN": TOKEN},
    )
    address = told.stdout.readline().split()[-1].partition("?")[0]
    port = int(address.rstrip("/").rpartition(":")[2])
    limits = httpx2.Limits(max_connections=None)
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with httpx2.Client(
        base_url=f"{address}api/v1", headers=headers, timeout=120, limits=limits
    ) as client:
        demo = client.post("/sessions/demo").raise_for_status().json()["id"]
        yield Program(folder, client, port, demo)
    told.kill()
    told.communicate()


@pytest.mark.slow
@pytest.mark.parametrize("load", WAITING)
def test_stop_is_answered_before_what_waits_in_a_thread(program, load):
    count, *what = WAITING[load]
    name = GATE.get(load, load)
    gate = program.folder / name
    for old in program.folder.glob(f"{name}.*"):
        old.unlink()
    gate.touch()
    answered = []
    threads = [
        threading.Thread(target=request, args=(program.client, *what, answered))
        for _ in range(count)
    ]
    try:
        for thread in threads:
            thread.start()
        wait_for(lambda: any(program.folder.glob(f"{name}.*")))
        program.stop(answered)
    finally:
        gate.unlink()
    for thread in threads:
        thread.join(120)
    assert answered[0] == ("stop", 200)
    assert len(answered) == count + 1
    assert all(status < 500 for _, status in answered)


def wire(program, head, length):
    """Return a connection over which the head of a request was sent."""
    made = socket.create_connection(("127.0.0.1", program.port), timeout=60)
    made.sendall(
        f"{head} HTTP/1.1\r\nHost: 127.0.0.1:{program.port}\r\nAuthorization: Bearer {TOKEN}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n".encode()
    )
    return made


def answer_of(connection):
    text = b""
    with contextlib.suppress(ConnectionError):
        while b"\r\n\r\n" not in text and (more := connection.recv(4096)):
            text += more
    return int(text.split()[1])


@pytest.mark.slow
def test_stop_is_answered_before_a_large_upload_has_come(program):
    data, answered = bytes(8_000_000), []
    head = "POST /api/v1/sessions/current/uploads?name=large.nrrd"
    with wire(program, head, len(data)) as upload:
        upload.sendall(data[:-1])
        program.stop(answered)
        upload.sendall(data[-1:])
        answered.append(("load", answer_of(upload)))
    assert answered == [("stop", 200), ("load", 201)]


@pytest.mark.slow
def test_a_huge_body_is_refused_before_it_has_come_and_stop_does_not_wait(program):
    body = json.dumps({"kind": "scan", "stroke_base_mm": [["x"] * 3] * 60_000}).encode()
    answered = []
    with wire(program, "POST /api/v1/sessions/current/commands/PaintRegion", len(body)) as huge:
        huge.sendall(body[:1000])
        answered.append(("load", answer_of(huge)))  # the rest has not been sent
        program.stop(answered)
    assert answered == [("load", 413), ("stop", 200)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", ["file", "results/maps/array?at=/captures/second/value/0/scans/rf"]
)
def test_stop_is_answered_before_a_large_answer_is_taken(program, path):
    answered = []
    with wire(program, f"GET /api/v1/sessions/{program.demo}/{path}", 0) as reading:
        first = reading.recv(1000)
        assert first.startswith(b"HTTP/1.1 200")
        program.stop(answered)
        length = int(first.lower().partition(b"content-length: ")[2].split()[0])
        rest = len(first) - first.index(b"\r\n\r\n") - 4
        while rest < length:
            rest += len(reading.recv(1 << 20))
    assert answered == [("stop", 200)]
    assert rest == length > 3_000_000


@pytest.mark.slow
def test_stop_is_answered_before_a_job_has_ended(program):
    started = program.client.post(
        "/sessions/current/jobs/StartPointerCapture", json={"by_hand": True, "duration_s": 120}
    )
    job, answered = started.json()["id"], []
    program.stop(answered)
    assert answered == [("stop", 200)]
    wait_for(lambda: program.client.get(f"/jobs/{job}").json()["finished"])
    assert program.client.get(f"/jobs/{job}").json()["state"] == "cancelled"


@pytest.mark.slow
def test_a_reference_is_read_in_a_job_process_which_cancel_ends(program):
    """A reader that never returns: Stop is answered, and Cancel ends the job beside it."""
    gates = [program.folder / name for name in ("reference", "server")]
    client, answered = program.client, []
    own = f"/sessions/{client.post('/sessions/demo').raise_for_status().json()['id']}"
    mesh = client.get(f"{own}/export/bone.stl").content
    client.post(f"{own}/uploads", params={"name": "bone.stl"}, content=mesh).raise_for_status()
    for gate in gates:
        gate.touch()
    try:
        started = client.post(f"{own}/jobs/StartComparison", json={"file": "bone.stl"})
        wait_for(lambda: any(program.folder.glob("reference.*")))
        assert not list(program.folder.glob("server.*"))
        program.stop(answered)
        assert answered == [("stop", 200)]
        job = f"/jobs/{started.json()['id']}"
        assert client.get(job).json()["state"] == "running"
        client.delete(job).raise_for_status()
        wait_for(lambda: client.get(job).json()["finished"])
        assert client.get(job).json()["state"] == "cancelled"
    finally:
        for gate in gates:
            gate.unlink()
    again = client.post(f"{own}/jobs/StartComparison", json={"file": "bone.stl"}).json()
    wait_for(lambda: client.get(f"/jobs/{again['id']}").json()["finished"])
    assert client.get(f"/jobs/{again['id']}").json()["result"]["figures"][0]["rms_mm"] < 0.001
