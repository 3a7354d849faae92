"""Studies on Dask: the same bits, workers and schedulers that are killed, and the table."""

import subprocess
import sys

import pytest

from rona_core.errors import DeviceError
from rona_core.study.engines import WorkerDiedError, opened
from rona_core.study.folder import StudyFolder
from rona_core.study.patient import run_row
from rona_core.study.plan import Patient, plan_of
from rona_core.study.study import run_study
from tests.helpers.study_workers import seed_or_death

EXTRA = "pip install 'rona[study]'"
pytest.importorskip("distributed", reason=EXTRA)
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]  # those of Dask itself
TIMES = ("wall_s", "cpu_s")


def small(count):
    text = f'until = "tool"\nseeds = {{ first = 40, count = {count} }}\n'
    return plan_of({"until": "tool", "seeds": {"first": 40, "count": count}}, "small", text)


def rows_of(folder, plan):
    rows = StudyFolder(folder).rows(plan)
    return {k: {n: v for n, v in row.items() if n not in TIMES} for k, row in rows.items()}


def here(plan):
    return {
        one.key: {name: value for name, value in run_row(one).items() if name not in TIMES}
        for one in plan.patients()
    }


def unwatched(progress):
    pass


def patient(seed, **files):
    return Patient(seed, {}, "tool", (), {name: str(path) for name, path in files.items()})


class Servers:
    """A scheduler of Dask and two workers, each a process of its own."""

    def __init__(self, port):
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = self._start("scheduler", "--port", str(port), "--no-dashboard")
        self.workers = [
            self._start("worker", self.address, "--nthreads", "1", "--no-nanny") for _ in range(2)
        ]

    def _start(self, kind, *arguments):
        command = [sys.executable, "-m", "dask", kind, *arguments]
        return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def close(self):
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@pytest.fixture
def servers(unused_port):
    made = Servers(unused_port)
    yield made
    made.close()


@pytest.fixture
def unused_port():
    import socket

    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def test_workers_of_this_machine_give_the_same_bits_and_a_table_with_units(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason=EXTRA)
    plan = small(3)
    with opened(None, 2) as engine:
        assert engine.workers() == 2
        table = run_study(plan, tmp_path, engine, unwatched)
    rows = rows_of(tmp_path, plan)
    assert rows == here(plan)
    read = parquet.read_table(table)
    assert read.column("key").to_pylist() == list(rows)
    errors = [row["tool_tip_error_mm"] for row in rows.values()]
    assert read.column("tool_tip_error_mm").to_pylist() == errors
    assert read.schema.field("tool_tip_error_mm").metadata[b"unit"] == b"mm"
    assert read.schema.field("surface_rms_mm").metadata[b"unit"] == b"mm", "also where all is null"


def test_a_worker_that_dies_costs_its_patient_alone_and_is_tried_again_once(tmp_path):
    always, once = tmp_path / "always", tmp_path / "once"
    patients = [patient(0), patient(1, always=always), patient(2), patient(3, once=once)]
    patients += [patient(seed) for seed in range(4, 9)]
    with opened(None, 2) as engine:
        outcome = {one.seed: value for one, value in engine.each(seed_or_death, patients)}
    assert isinstance(outcome.pop(1), WorkerDiedError)
    assert outcome == {seed: seed for seed in (0, *range(2, 9))}
    assert always.read_text() == "xx"


def test_no_scheduler_is_named():
    with pytest.raises(DeviceError, match=r"no scheduler of Dask .* tcp://127\.0\.0\.1:9:"):
        with opened("tcp://127.0.0.1:9", 1):
            pass


@pytest.mark.slow
def test_a_study_by_address_survives_kills_of_worker_and_scheduler(servers, unused_port, tmp_path):
    """One worker killed costs nothing; the scheduler killed ends the study, which then goes on."""
    plan = small(8)
    done = []

    def kill(progress):
        done.append(progress.done)
        if progress.done == 1:
            servers.workers[0].kill()
        if progress.done == 4:
            servers.scheduler.kill()

    with pytest.raises(DeviceError, match="the scheduler has gone: run the same command again"):
        with opened(servers.address, 1) as engine:
            run_study(plan, tmp_path, engine, kill)
    servers.close()
    kept = {path: path.read_bytes() for path in tmp_path.glob("patients/*.json")}
    assert 4 <= len(kept) < 8
    again = Servers(unused_port)
    try:
        with opened(again.address, 1) as engine:
            run_study(plan, tmp_path, engine, unwatched)
    finally:
        again.close()
    assert all(path.read_bytes() == before for path, before in kept.items()), "none twice"
    assert rows_of(tmp_path, plan) == here(plan), "none lost, and the same bits"
