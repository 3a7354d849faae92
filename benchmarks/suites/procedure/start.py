"""Start, page and memory: what is waited for before the first click, and what a session takes.

Linux alone: CPU and memory of other processes are looked up in /proc.
"""

import asyncio
import dataclasses
import gc
import os
import re
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.metric import Metric, Progress
from benchmarks.reference.yardstick import Yardstick, pair
from benchmarks.reliability.server_process import ServerProcess, server
from benchmarks.suites.procedure.viewer import one_visit
from rona_core.session.files import load_session

SESSION = Path(__file__).resolve().parents[3] / "sessions" / "demo.rona"
HELP = (("--help",), ("demo", "--help"), ("serve", "--help"))
DEMO = ("demo", "--seed", "3", "--json")
# the command line, and then the most memory that it ever held
COMMAND = (
    "import sys; from rona_ui.cli import main; main(sys.argv[1:]); "
    "print(*(line for line in open('/proc/self/status') if line.startswith('VmHWM')))"
)
STARTS, PAGES = 3, 3  # of which the best counts, but for the first page
STAY_S = 3.0  # of a visit; its page is drawn in less
QUIET_S, QUIET_CPU_S = 2.0, 0.05  # a server that computes less meanwhile is at rest
LOADED = re.compile(r'(?:src|href)="(/static/[^"]+)"')  # by the page at once


def run(progress: Progress) -> list[Metric]:
    """Return how long start and page take, and the memory of a session and of a procedure."""
    yardstick = Yardstick()
    helped = max(_carried_out(["-m", "rona_ui", *words])[0] for words in HELP)
    progress(f"help: {helped:.2f} s")
    served = [_served(PAGES if number == 0 else 0) for number in range(STARTS)]
    pages = served[0].pages_cpu_s
    progress(f"server answers after {', '.join(f'{one.answers_s:.2f}' for one in served)} s")
    progress(f"CPU of pages: {', '.join(f'{page:.2f}' for page in pages)} s")
    yardstick.lay()
    share = session_share(SESSION)
    demo_cpu_s, told = _carried_out(["-c", COMMAND, *DEMO])
    peak_mb = int(told.split()[-2]) * 1024 / 1e6
    yardstick.lay()
    times = (
        ("CPU of a --help, the longest", helped, 0.3),
        ("page and REST answered after", min(s.answers_s for s in served), 2.0),
        ("the server's CPU until then", min(s.cpu_s for s in served), None),
        ("the server's CPU of the first page", pages[0], 0.7),
        ("the server's CPU of a later page", min(pages), 0.7),
        ("rona demo: CPU", demo_cpu_s, None),
    )
    return [
        *(metric for time in times for metric in pair(*time[:2], yardstick.median_s, time[2])),
        Metric("memory of a session over that of its arrays", share, "", "lower", 1.5),
        Metric("rona demo: peak of memory", peak_mb, "MB", "lower", 300.0),
    ]


def _carried_out(arguments: Sequence[str]) -> tuple[float, str]:
    """Return the CPU in s of a Python of its own, and what it printed."""
    with subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        printed = process.stdout.read() if process.stdout else ""
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(arguments)} ended with {process.returncode}")
    return used.ru_utime + used.ru_stime, printed


# ------------------------------------------------------------------ server and page


@dataclass(frozen=True, slots=True)
class Served:
    """A server that was started and visited."""

    answers_s: float  # after which page and REST were answered
    cpu_s: float  # of the server until then
    pages_cpu_s: tuple[float, ...]  # of the server for pages, one after another


def _served(pages: int) -> Served:
    """Start a server and open some pages."""
    begun_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, server(Path(folder)) as running:
        running.open("", below="").close()
        running.open("/status").close()
        answers_s, cpu_s = time.monotonic() - begun_s, running.cpu_s()
        return Served(answers_s, cpu_s, tuple(_page_cpu_s(running) for _ in range(pages)))


def _page_cpu_s(running: ServerProcess) -> float:
    """Return the server's CPU of one page: what a browser loads, and all that is drawn in it."""
    _rest(running)
    before_s = running.cpu_s()
    with running.open("", below="") as page:
        loaded = LOADED.findall(page.read().decode())
    for path in (*loaded, "/viewer/", "/api/v1/status"):
        running.open(path, below="").close()
    asyncio.run(one_visit(running.port, STAY_S))
    _rest(running)
    return running.cpu_s() - before_s


def _rest(running: ServerProcess) -> None:
    """Wait until a server is at rest."""
    cpu_s = -1.0
    while running.cpu_s() - cpu_s > QUIET_CPU_S:
        cpu_s = running.cpu_s()
        time.sleep(QUIET_S)


# ------------------------------------------------------------------ memory of a session


def session_share(path: Path) -> float:
    """Return the memory that the session of a file takes, over the bytes of its arrays."""
    load_session(path)  # what is kept of classes is kept once
    gc.collect()
    tracemalloc.start()
    try:
        session = load_session(path)
        gc.collect()
        return tracemalloc.get_traced_memory()[0] / sum(a.nbytes for a in arrays_of(session))
    finally:
        tracemalloc.stop()


def arrays_of(session: Any) -> list[NDArray[Any]]:
    """Return every array of a session, each once."""
    known: dict[int, Any] = {}

    def below(value: Any) -> Generator[Any]:
        if id(value) in known:
            return
        known[id(value)] = value
        if isinstance(value, np.ndarray):
            yield value
        parts = value if isinstance(value, (tuple, list)) else ()
        if isinstance(value, dict):
            parts = value.values()
        elif dataclasses.is_dataclass(value):
            parts = (getattr(value, field.name) for field in dataclasses.fields(value))
        for part in parts:
            yield from below(part)

    return list(below(session))
