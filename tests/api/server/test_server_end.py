"""How a real `rona serve` ends: asked or killed, idle or busy, followed or with stuck threads."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx2
import pytest

TOKEN = "a-token-of-the-tests"
PROGRAM = """
import concurrent.futures, sys, time
from rona_ui.cli import main

if __name__ == "__main__":
    stuck = concurrent.futures.ThreadPoolExecutor(1).submit(time.sleep, 600)  # a thread of viser's
    sys.exit(main(sys.argv[1:]))
"""
pytestmark = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="needs /proc to see processes"
)


def processes():
    """Return the parent of every process that runs; zombies do not."""
    found = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            with contextlib.suppress(OSError):
                words = (folder / "stat").read_text().rpartition(")")[2].split()
                if words[0] != "Z":
                    found[int(folder.name)] = int(words[1])
    return found


@pytest.fixture
def program(tmp_path):
    """A server in a process of its own, with a thread that is stuck."""
    script = tmp_path / "program.py"
    script.write_text(PROGRAM)
    told = subprocess.Popen(
        [sys.executable, script, "serve", "--no-open", "--port", "0", "--sessions", tmp_path],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "RONA_TOKEN": TOKEN},
    )
    address = told.stdout.readline().split()[-1].partition("?")[0]
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with httpx2.Client(base_url=f"{address}api/v1", headers=headers, timeout=120) as client:
        client.post("/sessions").raise_for_status()
        yield told, client
    told.kill()
    told.communicate()


def start_search(client):
    """Start a job in the computing process and wait until it is under way."""
    sent = client.post("/sessions/current/jobs/StartProbeSweep", json={"n": 60})
    assert sent.status_code == 202, sent.text
    where = sent.headers["location"].removeprefix("/api/v1")
    while client.get(where).json()["progress"] == 0.0:
        assert client.get(where).json()["state"] == "running"
        time.sleep(0.02)


def children_of(program):
    return [child for child, parent in processes().items() if parent == program.pid]


def all_gone(pids, timeout_s=60.0):
    end = time.monotonic() + timeout_s
    while (left := processes().keys() & set(pids)) and time.monotonic() < end:
        time.sleep(0.02)
    return not left


@pytest.mark.parametrize(
    ("busy", "number"),
    [
        pytest.param(True, signal.SIGTERM, id="busy-term", marks=pytest.mark.ci),
        pytest.param(True, signal.SIGINT, id="busy-ctrl-c", marks=pytest.mark.slow),
        pytest.param(False, signal.SIGTERM, id="idle-term", marks=pytest.mark.slow),
        pytest.param(False, signal.SIGINT, id="idle-ctrl-c", marks=pytest.mark.slow),
    ],
)
def test_it_ends_when_it_is_asked_to_whatever_is_under_way(program, number, busy):
    told, client = program
    if busy:
        start_search(client)
    children = children_of(told)
    assert children, "it computes in another process"
    with (
        client.stream("GET", "/status/events") as status,
        client.stream("GET", "/sessions/current/robot/stream"),
    ):
        next(status.iter_lines())
        told.send_signal(number)
        assert told.wait(60) == 0
    assert all_gone(children)


@pytest.mark.slow
@pytest.mark.parametrize("busy", [False, True], ids=["idle", "busy"])
def test_nothing_outlives_it_when_it_is_killed(program, busy):
    told, client = program
    if busy:
        start_search(client)
    children = children_of(told)
    assert children
    told.kill()
    assert all_gone([told.pid, *children])
