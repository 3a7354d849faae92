"""Jobs: one at a time on the devices, always an end, never a lost outcome."""

import threading
import time
from dataclasses import dataclass

import pytest

from rona_core.app.runtime.jobs import MAX_RUNNING, Jobs, JobStatus
from rona_core.errors import (
    CancelledError,
    DeviceError,
    NotFoundError,
    NotReachableError,
    RonaError,
)


@dataclass(frozen=True)
class Work:
    """An activity by name only."""


def until_cancelled(progress, cancel):
    while not cancel():
        threading.Event().wait(0.002)
    raise CancelledError("stopped")


def test_a_job_ends_with_the_revision_it_stored():
    jobs = Jobs()
    job = jobs.start(Work(), lambda progress, cancel: 42, device=False)
    end = jobs.wait(job.id, 10)
    assert (end.state, end.revision, end.progress) == ("done", 42, 1.0)


def test_progress_only_shows_what_was_reported_and_ends_at_the_end():
    jobs = Jobs()
    seen = []
    jobs.subscribe(lambda status: seen.append(status.progress))

    def work(progress, cancel):
        for share in (0.25, 0.5, 0.75):
            progress(share)
        return 1

    jobs.wait(jobs.start(Work(), work, device=False).id, 10)
    assert seen == [0.25, 0.5, 0.75, 1.0]


def test_the_time_that_is_left_follows_from_what_has_passed_once_enough_has():
    def left(passed_s, progress, state="running"):
        status = JobStatus("1", "StartScan", state, progress, started_s=100.0)
        return status.time_left_s(100.0 + passed_s)

    assert left(10.0, 0.25) == pytest.approx(30.0)
    assert left(30.0, 0.25) == pytest.approx(90.0)  # a job that hangs does not promise an end
    assert left(1.0, 0.25) is None
    assert left(10.0, 0.01) is None
    assert left(10.0, 1.0, "done") is None
    assert JobStatus("1", "StartScan", "running", 0.5).time_left_s(1e6) is None


def test_a_job_knows_when_it_was_started():
    jobs, go = Jobs(), threading.Event()

    def work(progress, cancel):
        progress(0.5)
        go.wait(10)
        return 1

    job = jobs.start(Work(), work, device=False)
    while jobs.status(job.id).progress < 0.5:
        go.wait(0.01)
    now_s = time.monotonic()
    left_s = jobs.status(job.id).time_left_s(now_s + 60.0)
    go.set()
    jobs.wait(job.id, 10)
    assert left_s == pytest.approx(60.0, abs=5.0)


def test_an_error_of_ours_ends_the_job_with_its_code_and_text():
    jobs = Jobs()

    def work(progress, cancel):
        raise NotReachableError("too far")

    end = jobs.wait(jobs.start(Work(), work, device=True).id, 10)
    assert (end.state, end.error_code, end.error) == ("failed", "not_reachable", "too far")


def test_a_defect_ends_the_job_too(capsys):
    jobs = Jobs()
    end = jobs.wait(jobs.start(Work(), lambda p, c: 1 // 0, device=True).id, 10)
    assert (end.state, end.error_code) == ("failed", "internal")
    assert "ZeroDivisionError" in capsys.readouterr().err
    again = jobs.wait(jobs.start(Work(), lambda p, c: 1, device=True).id, 10)
    assert again.state == "done", "the devices are free again"


def test_the_devices_do_one_thing_at_a_time():
    jobs = Jobs()
    first = jobs.start(Work(), until_cancelled, device=True)
    with pytest.raises(DeviceError, match=first.id):
        jobs.start(Work(), until_cancelled, device=True)
    beside = jobs.wait(jobs.start(Work(), lambda p, c: 7, device=False).id, 10)
    assert beside.state == "done", "computations go on beside"
    jobs.cancel_device_job()
    assert jobs.wait(first.id, 10).state == "cancelled"
    assert jobs.wait(jobs.start(Work(), lambda p, c: 1, device=True).id, 10).state == "done"


def test_a_crowd_of_jobs_is_refused_until_some_have_ended():
    jobs = Jobs()
    started = [jobs.start(Work(), until_cancelled, device=False) for _ in range(MAX_RUNNING)]
    with pytest.raises(RonaError, match="jobs are running"):
        jobs.start(Work(), until_cancelled, device=True)
    assert not jobs.devices_busy
    jobs.cancel_all()
    assert {jobs.wait(job.id, 10).state for job in started} == {"cancelled"}
    assert jobs.wait(jobs.start(Work(), lambda p, c: 1, device=True).id, 10).state == "done"


def test_cancelled_work_that_stored_a_part_says_both():
    jobs = Jobs()

    def work(progress, cancel):
        while not cancel():
            threading.Event().wait(0.002)
        return 5

    job = jobs.start(Work(), work, device=True)
    jobs.cancel(job.id)
    end = jobs.wait(job.id, 10)
    assert (end.state, end.revision) == ("cancelled", 5)


def test_an_unknown_job_is_named():
    with pytest.raises(NotFoundError, match="nope"):
        Jobs().status("nope")
