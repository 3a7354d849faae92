"""Studies that are run: the same bits, none lost and none twice, failures as rows."""

import csv
import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from rona_core.app.procedure import stages
from rona_core.compose import run_demo
from rona_core.errors import InvalidInputError, NameTakenError
from rona_core.session.files import load_session
from rona_core.study.engines import WorkerDiedError, processes
from rona_core.study.folder import StudyFolder
from rona_core.study.patient import run_row, run_session
from rona_core.study.plan import Patient, plan_of, read_plan
from rona_core.study.study import Progress, failures_of, run_study
from rona_ui.cli import main
from rona_ui.cli.study import remaining_words
from tests.helpers.study_workers import seed_or_death

TIMES = ("wall_s", "cpu_s")
PLAN = """
title = "tool tips"
until = "tool"
seeds = { first = 40, count = 2 }
keep = ["worst 1 of tool_tip_error_mm"]
[factors]
SetTracker.profile = ["vega"]
"""


class Here:
    """Runs patients in this process, one after the other."""

    words = "here"

    def workers(self):
        return 1

    def each(self, function, patients):
        return ((patient, function(patient)) for patient in patients)


def small(tmp_path, text=PLAN, name="plan.toml"):
    file = tmp_path / name
    file.write_text(text)
    return file


def without_times(row):
    return {name: value for name, value in row.items() if name not in TIMES}


def rows_of(folder, plan):
    return {key: without_times(row) for key, row in StudyFolder(folder).rows(plan).items()}


def unwatched(progress):
    pass


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A study of two patients that was run here: its plan and its folder."""
    folder = tmp_path_factory.mktemp("study")
    plan = read_plan(small(folder))
    seen = []
    run_study(plan, folder / "out", Here(), lambda p: seen.append((p.done, p.failures)))
    assert seen == [(0, 0), (1, 0), (2, 0)]
    return plan, folder / "out"


@pytest.mark.slow
def test_a_patient_is_the_demo_with_its_levels(done):
    plan, out = done
    row = rows_of(out, plan)[plan.patients()[0].key]
    _, figures = run_demo(40, among=stages("tool"))
    assert row["seed"] == 40
    assert row["SetTracker.profile"] == "vega"
    differing = {key for key in figures if key not in TIMES and row[key] != figures[key]}
    assert "tool_tip_error_mm" in differing, "the level has an effect"
    of_the_run = [key for key in figures if key not in (*TIMES, "seed")]
    assert list(row) == ["key", "seed", "version", "SetTracker.profile", *of_the_run]


@pytest.mark.ci
def test_the_table_has_a_row_a_patient_and_its_schema_the_units(done):
    plan, out = done
    schema = {one["name"]: one for one in json.loads((out / "schema.json").read_text())}
    assert schema["tool_tip_error_mm"]["unit"] == "mm"
    assert schema["cpu_s"]["unit"] == "s"
    if not (out / "patients.csv").exists():
        pytest.skip("Parquet: tests/study/test_study_dask.py")
    with (out / "patients.csv").open() as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == list(schema)
    rows = rows_of(out, plan)
    assert [line["key"] for line in table] == list(rows)
    assert all(float(x["tool_tip_error_mm"]) == rows[x["key"]]["tool_tip_error_mm"] for x in table)


@pytest.mark.ci
def test_the_session_of_the_worst_alone_is_kept_and_is_that_patient(done):
    plan, out = done
    rows = StudyFolder(out).rows(plan)
    worst = max(rows.values(), key=lambda row: row["tool_tip_error_mm"])
    (kept,) = (out / "sessions").iterdir()
    assert kept.stem == worst["key"]
    session = load_session(kept)
    assert session.setup.seed == worst["seed"]
    assert session.results.tool.value.tip_sigma_mm == worst["tool_tip_sigma_mm"]


@pytest.mark.ci
def test_what_is_done_is_not_done_again_and_a_longer_plan_goes_on(done, tmp_path):
    _, out = done
    before = {path.name: path.read_bytes() for path in (out / "patients").iterdir()}
    longer = read_plan(small(tmp_path, PLAN.replace("count = 2", "count = 3")))
    run = []

    class Counted(Here):
        def each(self, function, patients):
            run.extend((function, patient.seed) for patient in patients)
            return super().each(function, patients)

    copy = tmp_path / "out"
    (copy / "patients").mkdir(parents=True)
    for name, data in before.items():
        (copy / "patients" / name).write_bytes(data)
    run_study(longer, copy, Counted(), unwatched)
    assert [seed for function, seed in run if function is run_row] == [42]
    assert [function for function, _ in run[1:]] == [run_session]
    after = {path.name: path.read_bytes() for path in (copy / "patients").iterdir()}
    assert before.items() <= after.items()
    assert len(after) == 3


@pytest.mark.ci
def test_two_studies_do_not_write_in_one_folder(done):
    plan, out = done
    with StudyFolder(out).held(plan), pytest.raises(NameTakenError, match="another study"):
        run_study(plan, out, Here(), unwatched)


def test_failures_are_rows_with_step_code_and_reason(tmp_path, monkeypatch):
    text = PLAN.replace(
        'SetTracker.profile = ["vega"]', "SetRegion.center_mesh_mm = [[900.0, 0.0, 0.0]]"
    )
    plan = read_plan(small(tmp_path, text.replace("count = 2", "count = 1")))
    run_study(plan, tmp_path / "out", Here(), unwatched)
    (row,) = rows_of(tmp_path / "out", plan).values()
    assert (row["completed"], row["failed_step"]) == (False, "setup")
    assert row["failure_code"] == "invalid_input"
    assert row["reason"]
    assert failures_of([row, row]) == [("setup", "invalid_input", 2, row["reason"])]

    def broken(*_, progress, **__):
        progress("scan", 0.5)
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("rona_core.study.patient.run_patient", broken)
    row = run_row(plan.patients()[0])
    assert (row["failed_step"], row["failure_code"]) == ("scan", "defect")
    assert row["reason"] == "ZeroDivisionError: by zero"


def test_a_stage_that_cannot_be_done_has_its_code():
    factors = {"SetToolVisible": {"tool": ["toolmarker"], "visible": [False]}}
    plan = plan_of({"seeds": {"first": 1, "count": 1}, "until": "tool", "factors": factors}, "x")
    row = run_row(plan.patients()[0])
    assert (row["completed"], row["failed_step"]) == (False, "tool")
    assert row["failure_code"] in ("device_error", "missing", "bad", "degenerate_geometry")
    assert row["reason"]


@pytest.mark.ci
def test_a_worker_of_another_version_ends_the_study(done):
    plan, _ = done
    with pytest.raises(InvalidInputError, match=r"a worker has RONA .* the study is of 9\.9"):
        run_row(dataclasses.replace(plan.patients()[0], version="9.9"))


def test_remaining_time_is_withheld_until_it_is_known_and_covers_the_truth(monkeypatch):
    progress = Progress(total=100, before=40, failures=0, workers=2, begun_s=0.0)
    now_s = [0.0]
    monkeypatch.setattr("rona_core.study.study.time.monotonic", lambda: now_s[0])
    for count in range(1, 21):
        progress.seconds.append(20.0 if count % 2 else 10.0)
        now_s[0] = sum(progress.seconds) / 2.0
        assert (progress.remaining_s() is None) == (count < 3)
    low_s, high_s = progress.remaining_s()
    assert low_s < 40 * 15.0 / 2.0 < high_s
    assert high_s - low_s < 0.5 * 40 * 15.0 / 2.0
    assert remaining_words((low_s, high_s)) == f"{low_s / 60:.0f} to {high_s / 60:.0f} min left"
    assert remaining_words(None) == "remaining time not known yet"
    assert remaining_words((0.0, 0.2)) == "0 s left"
    assert remaining_words((7200.0, 9000.0)) == "2.0 to 2.5 h left"


@pytest.mark.ci
def test_the_terminal_says_how_far_a_study_is(done, capsys, tmp_path):
    _, out = done
    assert main(["study", "status", str(out)]) == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first == "tool tips: 2 of 2 patients done, 0 failed, 0 left"
    assert second.startswith("CPU ")
    assert main(["study", "report", str(out)]) == 0
    assert (out / "report.html").stat().st_size > 5000
    for arguments in (["status", str(tmp_path)], ["status"], ["plan.toml"], ["x", "--out", "y"]):
        assert main(["study", *arguments]) == 2
        assert capsys.readouterr().err.startswith("error: ")


# ------------------------------------------------------------------ workers


def patient(seed, **files):
    return Patient(seed, {}, "tool", (), {name: str(path) for name, path in files.items()})


def test_a_full_disk_is_named_with_the_folder(tmp_path, capsys, monkeypatch):
    def full(path, *_args, **_options):
        raise OSError(28, "No space left on device", str(path))

    plan = small(tmp_path)
    monkeypatch.setattr(Path, "mkdir", full)
    assert main(["study", str(plan), "--out", str(tmp_path / "new")]) == 2
    assert "the disk is full" in capsys.readouterr().err


@pytest.mark.slow
def test_a_worker_that_dies_costs_its_patient_alone_and_is_tried_again_once(tmp_path):
    always, once = tmp_path / "always", tmp_path / "once"
    patients = [patient(0), patient(1, always=always), patient(2), patient(3, once=once)]
    patients += [patient(seed) for seed in range(4, 9)]
    with processes(2) as engine:
        outcome = {one.seed: value for one, value in engine.each(seed_or_death, patients)}
    assert isinstance(died := outcome.pop(1), WorkerDiedError)
    assert died.code == "worker_died"
    assert outcome == {seed: seed for seed in (0, *range(2, 9))}
    assert always.read_text() == "xx"


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.ci)])
def test_any_number_of_workers_gives_the_same_bits(done, tmp_path, workers):
    plan, out = done
    with processes(workers) as engine:
        run_study(dataclasses.replace(plan, keep=()), tmp_path / "out", engine, unwatched)
    assert rows_of(tmp_path / "out", plan) == rows_of(out, plan)


def begin(plan, out):
    command = [sys.executable, "-m", "rona_ui", "study", str(plan), "--out", str(out)]
    return subprocess.Popen(
        [*command, "--workers", "2"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def wait_for_row(out, process):
    deadline_s = time.monotonic() + 120.0
    while not list((out / "patients").glob("*.json")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("how", "status"), [(signal.SIGKILL, -9), (signal.SIGINT, 130)])
def test_a_study_that_is_ended_loses_no_patient_and_does_none_twice(done, tmp_path, how, status):
    file, out = small(tmp_path, PLAN.replace("count = 2", "count = 5")), tmp_path / "out"
    plan = read_plan(file)
    with closing((process := begin(file, out)).stdout), closing(process.stderr):
        wait_for_row(out, process)
        os.kill(process.pid, how)
        assert process.wait(20.0) == status
        if how == signal.SIGINT:
            assert "the same command goes on" in process.stderr.read()
    kept = {path: (path.read_bytes(), path.stat().st_ino) for path in out.glob("patients/*.json")}
    assert 0 < len(kept) < 5, "it was ended in the midst"
    with processes(2) as engine:
        run_study(plan, out, engine, unwatched)
    rows = rows_of(out, plan)
    assert list(rows) == [one.key for one in plan.patients()]
    for path, before in kept.items():
        assert (path.read_bytes(), path.stat().st_ino) == before
    assert len(list(out.glob("patients/*"))) == 5
    first = rows_of(done[1], done[0])
    assert {key: rows[key] for key in first} == first
