"""Damaged files: each ends in a result or a refusal, soon, and in bounded memory.

Seeded flips, cuts, doublings and words in the place of bytes, half of them in the header, of a
small valid file of every kind that is read.
"""

import contextlib
import os
import resource
import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Generator
from pathlib import Path

import numpy as np

from benchmarks.metric import Metric, Progress
from rona_core.errors import RonaError
from tests.helpers.damaged_files import FORMATS, mutated

INPUTS = int(os.environ.get("INPUTS", "10000"))
SEED = 42
APART = ("h5", "mat", "stl", "ply", "obj")  # read in a process of its own: half a second each
APART_SHARE = 0.004  # of the inputs, of each such kind
MOST_CPU_S, MOST_WALL_S = 20.0, 900.0  # of one input; more is a hang
MOST_MB = 1200.0  # that memory may grow by: what one file may take, and the libraries


class _Late(BaseException):
    """An input took too long; no reader may take it for damage, as it does any Exception."""


def run(progress: Progress) -> list[Metric]:
    """Return how many damaged files ended in anything else, and the most time and memory."""
    before_mb = _peak_mb()
    apart = max(1, round(APART_SHARE * INPUTS))
    here = [kind for kind in FORMATS if kind not in APART]
    left = max(len(here), INPUTS - apart * len(APART))
    ended = read = hung = 0
    longest_s = 0.0
    strange: list[str] = []
    with tempfile.TemporaryDirectory() as place, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numbers that overflow are refused after
        for number, kind in enumerate(FORMATS):
            at = here.index(kind) if kind in here else 0
            count = apart if kind in APART else (left + at) // len(here)
            progress(f"{kind}: {count} inputs")
            make, parse, _ = FORMATS[kind]
            data = make(Path(place))
            rng = np.random.default_rng((SEED, number))
            for index in range(count):
                spoilt = mutated(data, rng)
                began_s = time.process_time()
                try:
                    with _limited():
                        parse(spoilt, Path(place))
                except RonaError:
                    pass
                except _Late:
                    hung += 1
                except Exception as error:  # what the suite looks for
                    strange.append(f"{kind} {index}: {type(error).__name__}: {error}"[:160])
                    progress(strange[-1])
                ended, read = ended + 1, read + len(spoilt)
                longest_s = max(longest_s, time.process_time() - began_s)
    return [
        Metric(f"damaged files of {len(FORMATS)} kinds read", ended, "files", "higher", INPUTS),
        Metric("ended in another error than a refusal", len(strange), "files", "lower", 0.0),
        Metric(f"not ended after {MOST_CPU_S:g} s of CPU", hung, "files", "lower", 0.0),
        Metric("longest in this process", longest_s, "s", "lower", MOST_CPU_S),
        Metric("memory grown by", _peak_mb() - before_mb, "MB", "lower", MOST_MB),
    ]


def _peak_mb() -> float:
    """Return the most memory that this process and its ended children had, the larger of both."""
    kinds = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return max(resource.getrusage(kind).ru_maxrss for kind in kinds) / 1024.0


@contextlib.contextmanager
def _limited() -> Generator[None]:
    """Raise _Late where the block takes too much CPU, or waits too long."""

    def late(number: int, frame: object) -> None:
        raise _Late

    alarms: tuple[tuple[int, int, float], ...] = (
        (signal.SIGPROF, signal.ITIMER_PROF, MOST_CPU_S),
        (signal.SIGALRM, signal.ITIMER_REAL, MOST_WALL_S),
    )
    before: list[Callable[..., object] | int | None] = [
        signal.signal(number, late) for number, _, _ in alarms
    ]
    for _, timer, most_s in alarms:
        signal.setitimer(timer, most_s)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(alarms, before, strict=True):
            signal.setitimer(timer, 0.0)
            signal.signal(number, handler)
