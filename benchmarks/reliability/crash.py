"""Kill a program that changes a session; count what it had acknowledged, and what of it is lost.

`python -m benchmarks.reliability.crash --kills 40` has a process of its own change a session, some
thirty times a second: commands, undo, redo, captures as jobs, and saves. Each change is reported
once the call that made it has returned, each capture once its job says done. The process is ended
by SIGKILL, and what can be recovered, or is in the file, is compared with what was reported, bit by
bit. It is part of `python -m benchmarks saving`.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Timer

import numpy as np

from rona_core.app.runtime.session_step import Redo, RenameSession, Undo
from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_core.app.steps.setup.messages import AddObstacle, MoveTracker, SetSeed, SetToolVisible
from rona_core.compose import build_registry
from rona_core.errors import RonaError
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import MADE, load_session

WAIT_S = (0.05, 4.0)  # from the first change to the kill
PAUSE_S = 0.03
LOOK_S = 3.0  # that a person looks at what was captured
SAVES = 0.05  # share of what is done
REPOSITORY = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Count:
    """What was acknowledged, and what of it was lost, over all kills."""

    kills: int
    changes: int
    changes_lost: int
    captures: int
    captures_lost: int
    saves: int
    saves_lost: int
    differing: int  # sessions that came back otherwise than they were
    left_over: int  # temporary files that the next start leaves lying


def work(folder: Path, seed: int, captures: float) -> None:
    """Change a session until somebody ends the process, and say so line by line."""
    random = np.random.default_rng(seed)
    hub = build_registry(folder, processes=False)
    bench = hub.create("work", seed)
    while True:
        time.sleep(PAUSE_S)
        number = int(random.integers(1000))
        choices = (
            SetSeed(number), RenameSession(f"work {number}"), Undo(), Redo(),
            SetToolVisible("pointer6d", bool(number % 2)), CalibratePointer(),
            AddObstacle(f"box{number % 5}", (500.0, float(number), 100.0), (50.0, 50.0, 50.0)),
            MoveTracker((float(number % 50), 0.0, 0.0)),
        )  # fmt: skip
        try:
            if random.random() < SAVES:
                hub.save(file="work")
                kind = "save"
            elif random.random() < captures:
                started = bench.start(StartPointerCapture())
                ended = bench.jobs.wait(started.id)
                kind = "capture" if ended.state == "done" else "change"
            else:
                bench.dispatch(choices[random.integers(len(choices))])
                kind = "change"
        except RonaError:  # nothing to take back, or this cannot be done now
            continue
        session = bench.session
        told = {"kind": kind, "revision": len(session.log), "digest": digest(session)}
        sys.stdout.write(json.dumps(told) + "\n")
        sys.stdout.flush()
        if kind == "capture":
            time.sleep(LOOK_S)


def kill_one(folder: Path, seed: int, captures: float, wait_s: float) -> list[dict[str, object]]:
    """Let a process work for a while, kill it, and return what it had reported."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.reliability.crash",
        "--work",
        str(folder),
        "--seed",
        str(seed),
    ]
    command += ["--captures", str(captures)]
    process = subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True)
    if process.stdout is None:
        raise RuntimeError("the process has no output")  # cannot be: it is a pipe
    with process:
        lines = [process.stdout.readline()]
        kill = Timer(wait_s, os.kill, (process.pid, signal.SIGKILL))
        kill.start()
        lines += process.stdout.readlines()
        kill.join()
    if not lines[0]:
        raise RuntimeError("the process ended by itself, before it had changed anything")
    return [json.loads(line) for line in lines if line.endswith("\n")]


def recovered(folder: Path) -> tuple[Session | None, int]:
    """Return the newest that a new program recovers or finds, and how many files it leaves."""
    hub = build_registry(folder, processes=False)
    try:
        found = [hub.recover(copy.key)[0].session for copy in hub.lost()]
        found += [load_session(path) for path in hub.files.all()]
        left = [path for path in folder.rglob(".*") if MADE.fullmatch(path.name)]
    finally:
        hub.close_all()
    return max(found, key=lambda session: len(session.log), default=None), len(left)


def measure(kills: int, seed: int, share: float) -> Count:
    """Kill so many processes, at random moments."""
    random = np.random.default_rng(seed)
    reported: Counter[str] = Counter()
    missing: Counter[str] = Counter()
    differing = left_over = 0
    for number in range(kills):
        with tempfile.TemporaryDirectory() as place:
            wait_s = float(random.uniform(*WAIT_S))
            told = kill_one(Path(place), seed + number, share, wait_s)
            session, left = recovered(Path(place))
            kept = 0 if session is None else len(session.log)
            reported.update(str(t["kind"]) for t in told)
            missing.update(str(t["kind"]) for t in told if int(str(t["revision"])) > kept)
            same = [t["digest"] for t in told if t["revision"] == kept]
            differing += bool(same) and session is not None and same[0] != digest(session)
            left_over += left
    return Count(
        kills=kills,
        changes=reported["change"],
        changes_lost=missing["change"],
        captures=reported["capture"],
        captures_lost=missing["capture"],
        saves=reported["save"],
        saves_lost=missing["save"],
        differing=differing,
        left_over=left_over,
    )


def main() -> None:
    """Work, or kill who works."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    text = "share of the changes that are captures (0.02)"
    parser.add_argument("--captures", type=float, default=0.02, help=text)
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    wanted = parser.parse_args()
    if wanted.work is not None:
        work(wanted.work, wanted.seed, wanted.captures)
    started = time.monotonic()
    count = asdict(measure(wanted.kills, wanted.seed, wanted.captures))
    print(json.dumps({**count, "wall_s": round(time.monotonic() - started)}))


if __name__ == "__main__":
    main()
