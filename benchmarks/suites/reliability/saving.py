"""What is lost or written over without a word, and how long a frozen process is in the way.

Programs are killed between edits, captures and saves; journals are cut at every byte and their bits
turned over; two programs save one file at the same moment; a computing process is stopped.
"""

import contextlib
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.metric import Metric, Progress
from benchmarks.reference.damaged_journals import cuts, flips, is_silent, sectors, written_journal
from benchmarks.reliability.crash import REPOSITORY, measure
from benchmarks.suites.reliability.kills import toil
from rona_core.app.runtime.process_pool import ProcessCompute
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry
from rona_core.devices.protocols import Cancel, never, silent
from rona_core.devices.protocols import Progress as Report
from rona_core.errors import CancelledError, FileChangedError
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session

KILLS = 300
CAPTURES = 0.05  # share of what is done before a kill
ROWS = 8  # commands in the journal that is damaged
CUT_STEP = 1  # bytes
FLIPS = 3000
ROUNDS = 50  # of two programs that save at the same moment
FREEZES = 3  # of each kind
EDITS = 200
LARGE = b"0" * (1 << 22)  # bytes of a task, more than a pipe holds
FILE = "bone"


def run(progress: Progress) -> list[Metric]:
    """Return what was lost, written over or kept waiting."""
    return [*_kills(progress), *_damage(progress), *_programs(progress), *_frozen(progress)]


def _kills(progress: Progress) -> Iterator[Metric]:
    progress(f"{KILLS} kills of a program that edits, captures and saves")
    count = measure(KILLS, 0, CAPTURES)
    for name, reported, lost in (
        ("changes", count.changes, count.changes_lost),
        ("captures", count.captures, count.captures_lost),
        ("saves", count.saves, count.saves_lost),
    ):
        text = f"{KILLS} kills: {name} lost, of {reported} acknowledged"
        yield Metric(text, lost, name, "lower", 0.0)
    yield Metric(f"{KILLS} kills: differing sessions", count.differing, "sessions", "lower", 0.0)
    yield Metric(f"{KILLS} kills: files left behind", count.left_over, "files", "lower", 0.0)


def _damage(progress: Progress) -> Iterator[Metric]:
    with tempfile.TemporaryDirectory() as folder:
        written = written_journal(Path(folder), ROWS)
        kinds = {
            "journal cut at every byte": cuts(written.data, CUT_STEP),
            "journal with one bit turned over": flips(written.data, FLIPS, 0),
            "journal with sectors old or zero": sectors(written.data, written.before, FLIPS, 1),
        }
        for name, damaged in kinds.items():
            progress(name)
            silent_ones = [is_silent(written, data) for data in damaged]
            text = f"{name}: less or other without a word, of {len(silent_ones)}"
            yield Metric(text, sum(silent_ones), "journals", "lower", 0.0)
    progress("cost of an edit")
    with tempfile.TemporaryDirectory() as folder:
        hub = build_registry(Path(folder), processes=False)
        bench, times_s = hub.create("edits"), list[float]()
        bench.dispatch(SetSeed(0))
        for number in range(EDITS):
            began_s = time.perf_counter()
            bench.dispatch(SetSeed(number))
            times_s.append(time.perf_counter() - began_s)
        hub.close_all()
    yield Metric("an edit, written to the disk", 1e3 * statistics.median(times_s), "ms", "lower")


def save_once(folder: Path, seed: int) -> None:
    """Open the file, change it, say so, and save it when a line comes; report how that ended."""
    hub = build_registry(folder, processes=False)
    for number, _ in enumerate(sys.stdin):
        if number % 2 == 0:
            bench = hub.reload("current") if hub.ids() else hub.open_file(f"{FILE}.rona")
            bench.dispatch(SetSeed(seed + 2 * number))
            sys.stdout.write("ready\n")
        else:
            try:
                hub.save()
                sys.stdout.write(f"{hub.get().session.setup.seed}\n")
            except FileChangedError:
                sys.stdout.write("refused\n")
        sys.stdout.flush()
    hub.close_all()


def _programs(progress: Progress) -> Iterator[Metric]:
    progress("two programs on one file")
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from benchmarks.suites.reliability.saving import save_once\n"
        "save_once(Path(sys.argv[1]), int(sys.argv[2]))\n"
    )
    overwritten = unsaved = 0
    with contextlib.ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory()))
        path = save_session(Session(name=FILE), folder / f"{FILE}.rona")
        programs = [
            held.enter_context(
                subprocess.Popen(
                    [sys.executable, "-c", code, str(folder), str(seed)],
                    cwd=REPOSITORY,
                    text=True,
                    bufsize=1,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                )
            )
            for seed in (1, 2)
        ]
        for _ in range(ROUNDS):
            _say(programs)
            saved = [end for end in _say(programs) if end != "refused"]
            overwritten += len(saved) > 1
            unsaved += saved != [str(load_session(path).setup.seed)]
        for program in programs:
            if program.stdin is not None:
                program.stdin.close()
    text = "two programs save one file at once"
    yield Metric(f"{text}: silent overwrites, of {ROUNDS}", overwritten, "files", "lower", 0.0)
    yield Metric(f"{text}: no winner in the file, of {ROUNDS}", unsaved, "files", "lower", 0.0)


def _say(programs: list[subprocess.Popen[str]]) -> list[str]:
    """Send each program a line at the same moment; return what they answer."""
    for program in programs:
        if program.stdin is not None:
            program.stdin.write("\n")
    return [str(p.stdout.readline()).strip() for p in programs if p.stdout is not None]


def length(data: bytes, *, progress: Report, cancel: Cancel) -> int:
    """Return the length of the data: a job that is large to send."""
    return len(data)


def _frozen(progress: Progress) -> Iterator[Metric]:
    for when in ("idle", "idle, large task", "busy"):
        progress(f"a computing process that is frozen while {when}")
        times_s = [_freeze(when) for _ in range(FREEZES)]
        cancel_s, next_s, starts = (max(column) for column in zip(*times_s, strict=True))
        text = f"process frozen while {when}, worst of {FREEZES}"
        yield Metric(f"{text}: Cancel", cancel_s, "s", "lower", 1.0)
        yield Metric(f"{text}: next job after Cancel", next_s, "s", "lower")
        yield Metric(f"{text}: that job beside a first one", starts, "times", "lower", 2.0)


def _freeze(when: str) -> tuple[float, float, float]:
    """Return how long Cancel and the next job take where a process is frozen.

    Returns:
        Seconds from Cancel to the end of the job that met the process, seconds that the next job
        takes, and how often those hold the time of a first job, which a process is started for.
    """
    pool, frozen_s = ProcessCompute(), list[float]()
    began_s = time.monotonic()
    pool(length, b"", progress=silent, cancel=never)
    start_s = time.monotonic() - began_s

    def freeze(share: float = 0.0) -> None:
        if not frozen_s:
            os.kill(pool.pids[0], signal.SIGSTOP)
            frozen_s.append(time.monotonic())

    if when != "busy":
        freeze()
    data = LARGE if "large" in when else b""
    function, args = (toil, ()) if when == "busy" else (length, (data,))
    with contextlib.suppress(CancelledError):
        pool(
            function,
            *args,
            progress=freeze,
            cancel=lambda: bool(frozen_s) and time.monotonic() > frozen_s[0] + 1.0,
        )
    ended_s = time.monotonic()
    pool(length, b"", progress=silent, cancel=never)
    done_s = time.monotonic()
    pool.close()
    return ended_s - frozen_s[0] - 1.0, done_s - ended_s, (done_s - ended_s) / start_s
