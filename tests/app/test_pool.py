"""Computing in another process: same result, progress, cancel, errors with their type."""

import threading
import time

import pytest

from rona_core.app.pool import ProcessCompute
from rona_core.errors import CancelledError, NotReachableError


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
