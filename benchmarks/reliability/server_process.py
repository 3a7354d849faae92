"""A `rona serve` in a process of its own, and who its children are: for what kills and ends it."""

import contextlib
import json
import os
import subprocess
import sys
import time
import urllib.parse
import urllib.request
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from rona_ui.resources import demo_session

TOKEN = "token-of-the-benchmark"


def running() -> dict[int, int]:
    """Return the parent of every process that runs; zombies do not."""
    found: dict[int, int] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            with contextlib.suppress(OSError):
                words = (folder / "stat").read_text().rpartition(")")[2].split()
                if words[0] != "Z":
                    found[int(folder.name)] = int(words[1])
    return found


def left_after(pids: Sequence[int], timeout_s: float = 10.0) -> int:
    """Return how many of ``pids`` still run after a while; sooner if none does."""
    end_s = time.monotonic() + timeout_s
    while (left := running().keys() & set(pids)) and time.monotonic() < end_s:
        time.sleep(0.02)
    return len(left)


def cpu_s_of(pid: int) -> float:
    """Return the CPU time that a process has taken so far, without its children."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


class ServerProcess:
    """A server that answers."""

    def __init__(self, folder: Path) -> None:
        """Start it on a free port with a copy of the demo; its sessions live in ``folder``."""
        self.process = subprocess.Popen(
            [sys.executable, "-m", "rona_ui", "serve", str(demo_session()), "--no-open"]
            + ["--port", "0", "--sessions", str(folder)],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "RONA_TOKEN": TOKEN},
        )
        line = self.process.stdout.readline() if self.process.stdout else ""
        self._address = line.split()[-1].rpartition("/")[0]

    @property
    def children(self) -> list[int]:
        """Its child processes."""
        return [child for child, parent in running().items() if parent == self.process.pid]

    @property
    def port(self) -> int:
        """Where it listens."""
        return urllib.parse.urlsplit(self._address).port or 0

    def cpu_s(self) -> float:
        """Return the CPU time that it has taken so far, without its children."""
        return cpu_s_of(self.process.pid)

    def open(self, path: str, body: dict[str, Any] | None = None, *, below: str = "/api/v1") -> Any:
        """Return the answer to a GET, or to a POST of ``body``."""
        request = urllib.request.Request(
            self._address.rstrip("/") + below + path,
            headers={"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/json"},
            data=None if body is None else json.dumps(body).encode(),
        )
        return urllib.request.urlopen(request, timeout=120)

    def compute(self) -> None:
        """Keep it busy: start a long computation and return once it is under way."""
        with self.open("/sessions/current/jobs/StartProbeSweep", {"n": 400}) as answer:
            where = "/jobs/" + json.load(answer)["id"]
        progress = 0.0
        while progress == 0.0:
            with self.open(where) as answer:
                progress = json.load(answer)["progress"]


@contextlib.contextmanager
def server(folder: Path) -> Generator[ServerProcess]:
    """Run a server as long as the block runs."""
    started = ServerProcess(folder)
    try:
        yield started
    finally:
        started.process.kill()
        started.process.communicate()
