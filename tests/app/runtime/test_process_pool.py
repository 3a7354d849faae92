"""Computing in another process: same result, progress, cancel, errors with their type.

Whatever is killed or frozen, idle or busy, the next computation works and Cancel is answered;
nothing outlives the program.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from rona_core.app.runtime import process_pool
from rona_core.app.runtime.process_pool import ProcessCompute
from rona_core.errors import CancelledError, NotReachableError, RonaError

KILLS = 2  # of each kind; `python -m benchmarks kills` does 50


def add(a, b, *, progress, cancel):
    progress(0.5)
    progress(1.0)
    return a + b


def refuse(*, progress, cancel):
    raise NotReachableError("joint 5 at 130 deg, limit 120", joint=5)


def spin(*, progress, cancel):
    for i in range(2000):
        if cancel():
            raise CancelledError("seen by the worker")
        progress(i / 2000)
        time.sleep(0.005)
    return "ran to its end"


def deaf(*, progress, cancel):
    """Work that never looks at Cancel."""
    progress(0.5)
    time.sleep(600.0)


def stranger(*, progress, cancel):
    raise KeyError("a defect")


def unsendable(*, progress, cancel):
    return threading.Lock()


def wait_until(condition, timeout_s=30.0):
    """Wait until ``condition()`` holds; return whether it came to that."""
    end = time.monotonic() + timeout_s
    while not (held := condition()) and time.monotonic() < end:
        time.sleep(0.01)
    return held


def lives(pid):
    """Whether a process runs; one that only waits to be counted by its parent does not."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def kill_busy(compute, function=spin):
    """Kill the process as soon as it is under way; return the error that the job ends in."""
    killed = []

    def progress(share):
        if not killed:
            killed.append(compute.pids[0])
            os.kill(killed[0], signal.SIGKILL)

    with pytest.raises(RonaError) as caught:
        run(compute, function, progress=progress)
    return caught.value


@pytest.fixture(scope="module")
def compute():
    pool = ProcessCompute()
    yield pool
    pool.close()
    pool.close()  # a second call does nothing


def run(compute, function, *args, progress=lambda share: None, cancel=lambda: False):
    return compute(function, *args, progress=progress, cancel=cancel)


def test_the_result_comes_back(compute):
    assert run(compute, add, 2, 3) == 5


def test_errors_keep_their_type_text_and_data(compute):
    with pytest.raises(NotReachableError, match="limit 120") as caught:
        run(compute, refuse)
    assert caught.value.data == {"joint": 5}


def test_progress_and_cancel_cross_the_border(compute):
    seen, asked = [], threading.Event()

    def progress(share):
        seen.append(share)
        asked.set()  # as soon as it is under way, cancel

    with pytest.raises(CancelledError):
        run(compute, spin, progress=progress, cancel=asked.is_set)
    assert seen
    assert seen == sorted(seen)
    assert seen[-1] < 1.0
    assert run(compute, add, 1, 1) == 2, "the process lives on"


@pytest.mark.slow
def test_a_defect_comes_back_with_the_place_where_it_happened(compute):
    with pytest.raises(KeyError, match="a defect") as caught:
        run(compute, stranger)
    assert "in stranger" in caught.value.__notes__[0]
    with pytest.raises(TypeError, match="cannot leave its process"):
        run(compute, unsendable)
    assert run(compute, add, 1, 1) == 2


@pytest.mark.slow
def test_a_process_killed_while_idle_is_replaced_without_a_word(compute):
    for number in range(KILLS):
        assert run(compute, add, number, 1) == number + 1
        os.kill(compute.pids[0], signal.SIGKILL)
        assert run(compute, add, number, 2) == number + 2


@pytest.mark.slow
def test_a_process_killed_while_it_starts_is_replaced_too():
    fresh = ProcessCompute()
    fresh.warm_up()
    os.kill(fresh.pids[0], signal.SIGKILL)
    assert run(fresh, add, 2, 2) == 4
    fresh.close()


@pytest.mark.slow
def test_a_process_killed_while_busy_fails_its_job_and_no_other(compute):
    for number in range(KILLS):
        error = kill_busy(compute)
        assert type(error) is RonaError
        assert "ended unexpectedly: start it again" in str(error)
        assert run(compute, add, number, 1) == number + 1


FROZEN_WHEN = ["starting", "idle", "busy", "busy with a large task", "busy with a large result"]
LARGE = b"0" * (1 << 22)  # more than a pipe holds, so that either end blocks


def length(data, *, progress, cancel):
    return len(data)


def expand(*, progress, cancel):
    progress(0.5)
    return LARGE


def frozen_pool(when):
    """Return a pool whose process is stopped in a state, and a call that meets it so."""
    pool, done = ProcessCompute(), threading.Event()

    def freeze(share=0.0):
        if not done.is_set():
            done.set()
            os.kill(pool.pids[0], signal.SIGSTOP)

    pool.warm_up()
    if when != "starting":
        run(pool, add, 1, 1)
    if when in ("starting", "idle", "busy with a large task"):
        freeze()
    met = {"busy": (spin,), "busy with a large result": (expand,)}
    met |= {"busy with a large task": (length, LARGE)}
    task = met.get(when, (add, 2, 3))
    return pool, lambda cancel: run(pool, *task, progress=freeze, cancel=cancel)


@pytest.mark.slow
@pytest.mark.parametrize("when", FROZEN_WHEN)
def test_a_frozen_process_keeps_no_cancel_waiting_and_the_next_job_runs(when):
    pool, meet = frozen_pool(when)
    asked_s = time.monotonic() + 1.0
    with contextlib.suppress(CancelledError):  # a large result may have come whole before
        meet(lambda: time.monotonic() > asked_s)
    assert time.monotonic() < asked_s + 10.0, "a bound for a loaded machine; alone it is 0.5 s"
    assert run(pool, add, 20, 3) == 23
    pool.close()


@pytest.mark.slow
@pytest.mark.parametrize("when", FROZEN_WHEN)
def test_a_frozen_process_is_replaced_without_cancel_too(when):
    pool, meet = frozen_pool(when)
    held = pool.pids
    if when == "busy":
        with pytest.raises(RonaError, match="did not answer any more: start it again"):
            meet(lambda: False)
    else:
        with contextlib.suppress(RonaError):  # what had begun fails, what had not is done elsewhere
            assert meet(lambda: False) in (5, len(LARGE), LARGE)
    assert run(pool, add, 20, 3) == 23
    if when != "busy with a large result":  # that one may have come whole before it was stopped
        assert not set(pool.pids) & set(held)
    pool.close()


@pytest.mark.slow
def test_a_process_that_neither_speaks_nor_counts_but_lives_is_left_alone(compute):
    """It waits for a slow disk, say, for longer than a frozen one is given."""
    assert run(compute, sleep_long) == "rested"


def sleep_long(*, progress, cancel):
    time.sleep(process_pool.FROZEN_S + 2.0)
    return "rested"


@pytest.mark.slow
def test_cancel_ends_what_does_not_look_at_it(compute):
    under_way = threading.Event()
    began_s = time.process_time()
    with pytest.raises(CancelledError):
        run(compute, deaf, progress=lambda share: under_way.set(), cancel=under_way.is_set)
    assert time.process_time() - began_s < 60.0
    assert run(compute, add, 1, 1) == 2


@pytest.mark.slow
def test_cancel_while_the_process_starts_or_another_computes():
    fresh = ProcessCompute()
    with pytest.raises(CancelledError, match="before it began"):
        run(fresh, deaf, cancel=lambda: True)
    held = fresh.pids
    under_way, over = threading.Event(), threading.Event()

    def job():
        with pytest.raises(CancelledError):
            run(fresh, deaf, progress=lambda share: under_way.set(), cancel=over.is_set)

    first = threading.Thread(target=job)
    first.start()
    assert under_way.wait(60.0)
    assert fresh.pids == held, "the process that was starting was kept"
    with pytest.raises(CancelledError, match="before it began"):
        run(fresh, add, 1, 1, cancel=lambda: True)
    over.set()
    first.join(60.0)
    assert not first.is_alive()
    assert run(fresh, add, 3, 4) == 7
    fresh.close()


@pytest.mark.slow
def test_closing_ends_what_is_stuck():
    fresh = ProcessCompute()
    under_way, ends = threading.Event(), []

    def job():
        with pytest.raises(RonaError) as caught:
            run(fresh, deaf, progress=lambda share: under_way.set())
        ends.append(str(caught.value))

    thread = threading.Thread(target=job)
    thread.start()
    assert under_way.wait(60.0)
    pids = fresh.pids
    fresh.close()
    thread.join(60.0)
    assert not thread.is_alive()
    assert len(ends) == 1
    assert not any(lives(pid) for pid in pids)
    assert fresh.pids == ()


PROGRAM = """
import os, sys, threading, time
from multiprocessing import resource_tracker
sys.path[:0] = {path!r}
from tests.app.runtime.test_process_pool import add, deaf
from rona_core.app.runtime.process_pool import ProcessCompute

if __name__ == "__main__":
    pool = ProcessCompute()
    pool.warm_up()
    def say(share=0.0):
        print(*pool.pids, resource_tracker._resource_tracker._pid, flush=True)
    if {busy}:
        pool(deaf, progress=say, cancel=lambda: False)
    else:
        pool(add, 1, 2, progress=lambda share: None, cancel=lambda: False)
        say()
        time.sleep(600)
"""


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc to see processes")
@pytest.mark.parametrize("busy", [False, True], ids=["idle", "busy"])
def test_nothing_outlives_a_killed_program(busy, tmp_path):
    script = tmp_path / "program.py"
    script.write_text(PROGRAM.format(busy=busy, path=[str(Path(__file__).parents[3])]))
    for _ in range(KILLS):
        with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE) as program:
            pids = [int(word) for word in program.stdout.readline().split()]
            assert len(pids) == 2
            assert all(lives(pid) for pid in pids)
            program.kill()
        assert wait_until(lambda pids=pids: not any(lives(pid) for pid in pids)), pids
