"""The command line: what it prints, what it refuses, and its exit status."""

import json
import runpy
import sys

import pytest

from rona_core.app.declarations.figures import FIGURES
from rona_core.app.procedure import PROCEDURE
from rona_core.app.runtime.workbench import Workbench
from rona_core.compose import DemoSkull, new_workbench
from rona_core.devices.world_settings import WorldSettings
from rona_core.errors import DegenerateGeometryError
from rona_core.session.document import Session, Setup
from rona_core.session.files import load_session, save_session
from rona_core.session.members import SCHEMA
from rona_ui.cli import demo, main

FIGURES_OF_A_RUN = {
    "seed": 5,
    "specimen": "simulated",
    "robot": "rx90",
    "surface_rms_mm": 0.123,
    "outer_rms_mm": 0.5,
    "thickness_rms_mm": 9.0,
    "path_points_smoothed": 51,
    "roll_mode": "constant",
    "completed": True,
    "wall_s": 12.3,
}


@pytest.fixture
def run_demo(monkeypatch):
    """Replace the procedure by its outcome; returns what it was asked for."""
    asked = {}
    outcome = dict(FIGURES_OF_A_RUN)

    def fake(seed, skull, *, progress, **options):
        asked.update(seed=seed, skull=skull, **options)
        progress("tool", 0.5)
        return Session(name="run", setup=Setup(seed=seed)), outcome

    monkeypatch.setattr(demo, "run_demo", fake)
    return asked, outcome


def refused(capsys, arguments, status=2):
    assert main(arguments) == status
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    return err


def test_demo_passes_everything_on(run_demo, capsys, tmp_path):
    asked, _ = run_demo
    bone, inner = tmp_path / "bone.stl", tmp_path / "inner.stl"
    for file in (bone, inner):
        file.write_bytes(b"x")
    arguments = ["demo", "--seed", "5", "--specimen", str(bone), "--inner", str(inner)]
    arguments += ["--threshold", "300", "--center", "1", "-2", "3.5", "--radius", "20"]
    arguments += ["--label", "2"]
    assert main([*arguments, "--robot", "rx90", "--world", "hard"]) == 0
    assert asked == {
        "seed": 5,
        "skull": DemoSkull(str(bone), str(inner), 300.0, (1.0, -2.0, 3.5), 20.0, 2),
        "robot": "rx90",
        "world": WorldSettings("hard"),
        "probe": "2.25MHz",
        "among": PROCEDURE,
    }
    assert main([*arguments, "--probe", "1MHz", "--skip", "caliper", "--skip", "tilts"]) == 0
    assert asked["probe"] == "1MHz"
    left = [stage for stage in PROCEDURE if stage.name not in ("caliper", "tilts")]
    assert asked["among"] == tuple(left)


def test_demo_prints_one_json_object(run_demo, capsys):
    assert main(["demo", "--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == FIGURES_OF_A_RUN
    assert out.count("\n") == 1
    assert "tool" in err  # the bars do not mix with the object


def test_demo_prints_a_table_with_limits_and_the_papers_figures(run_demo, capsys):
    assert main(["demo"]) == 0
    lines = capsys.readouterr().out.splitlines()

    def row(title):
        return next(line for line in lines if title in line).replace("│", " ").split()

    assert row("Surface cloud, RMS")[3:] == ["0.12", "mm", "≤", "0.50", "mm", "pass", "2.50", "mm"]
    assert "review" in row("Outer boundary, RMS")
    assert "fail" in row("Thickness, RMS")
    assert "51" in row("Path points, smoothed")
    assert all(any(kind.title in line for line in lines) for kind in FIGURES.values())


@pytest.mark.parametrize("json_wanted", [True, False])
def test_a_procedure_that_cannot_finish_says_so(run_demo, capsys, json_wanted):
    _, outcome = run_demo
    outcome.update(completed=False, failed_step="roll", reason="no roll works")
    assert main(["demo", *(["--json"] if json_wanted else [])]) == 3
    out = capsys.readouterr().out
    if json_wanted:
        assert json.loads(out)["failed_step"] == "roll"
    else:
        assert "ended at stage roll: no roll works" in out


def test_demo_saves_the_session(run_demo, capsys, tmp_path):
    file = tmp_path / "out.rona"
    assert main(["demo", "--seed", "8", "--out", str(file)]) == 0
    assert load_session(file).setup.seed == 8
    assert "out.rona" in capsys.readouterr().out


def test_bad_input_is_one_line_and_status_2(run_demo, capsys, tmp_path, monkeypatch):
    assert "absent.stl" in refused(capsys, ["demo", "--specimen", str(tmp_path / "absent.stl")])
    assert "folder" in refused(capsys, ["demo", "--out", str(tmp_path / "no" / "x.rona")])
    assert "is a folder" in refused(capsys, ["demo", "--out", str(tmp_path)])
    assert "is a folder" in refused(capsys, ["demo", "--specimen", str(tmp_path)])
    assert "--inner" in refused(capsys, ["demo", "--inner", __file__])
    assert "--threshold" in refused(capsys, ["demo", "--threshold", "300"])
    nothing = ["demo", "--specimen", __file__, "--threshold", "nan"]
    assert "--threshold" in refused(capsys, nothing)
    assert "nominal, realistic, hard" in refused(capsys, ["demo", "--world", "calm"])
    assert "2.25MHz, 1MHz, not 5MHz" in refused(capsys, ["demo", "--probe", "5MHz"])
    assert "gauge, tilts" in refused(capsys, ["demo", "--skip", "roll"])
    assert run_demo[0] == {}, "nothing has been started"
    assert "there is no session file" in refused(capsys, ["inspect", str(tmp_path / "absent")])
    damaged = tmp_path / "damaged.rona"
    damaged.write_bytes(b"PK damaged")
    assert "damaged.rona" in refused(capsys, ["inspect", str(damaged)])
    refused(capsys, ["inspect", str(tmp_path)])

    def fail(*_, **__):
        raise DegenerateGeometryError("flat\nmotion")

    monkeypatch.setattr(demo, "run_demo", fail)
    assert main(["demo"]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == "error: flat motion"


def test_figures_are_told_even_if_the_session_cannot_be_written(run_demo, capsys, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device", "out.rona")

    monkeypatch.setattr(demo, "save_session", full)
    assert main(["demo", "--json", "--out", "out.rona"]) == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["outer_rms_mm"] == FIGURES_OF_A_RUN["outer_rms_mm"]
    assert err.splitlines()[-1] == (
        "error: the file system refused out.rona: the disk is full; "
        "free space there, or choose another folder"
    )


@pytest.mark.parametrize("center", [["nan", "0", "0"], ["0", "inf", "0"], ["0", "0", "1e9"]])
def test_a_centre_that_is_nowhere_is_refused(capsys, center):
    assert main(["demo", "--center", *center]) == 2
    assert "center_mesh_mm must be" in capsys.readouterr().err


def test_a_defect_is_one_line_and_status_1(monkeypatch, capsys):
    monkeypatch.setattr(demo, "run_demo", lambda *_, **__: 1 / 0)
    monkeypatch.delenv("RONA_DEBUG", raising=False)
    assert main(["demo", "--json"]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    assert err.splitlines()[-1].startswith("error: ZeroDivisionError")


@pytest.mark.parametrize("seed", ["-1", "2147483648"])
def test_a_seed_out_of_range_is_refused(capsys, seed):
    assert main(["demo", "--json", "--seed", seed]) == 2
    assert "seed must be" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["dance"], ["demo", "--seed", "x"], ["inspect"]])
def test_words_that_are_not_understood(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert "usage: rona" in capsys.readouterr().err


def test_inspect_says_what_a_session_holds(capsys, tmp_path):
    bench: Workbench = new_workbench(Session(name="my skull", setup=Setup(seed=6)))
    bench.close()
    file = save_session(bench.session, tmp_path / "x.rona")
    assert main(["inspect", str(file)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("my skull  (id ")
    assert f"seed 6, revision 0, schema {SCHEMA}" in out
    for title in ("Set-up", "Tool", "Pointer", "Surface", "Path", "Smoothing", "Roll", "Scan"):
        assert title in out
    assert "recordings: none" in out
    assert "devices: Stäubli RX90, 2.25 MHz, chirp, NDI Polaris (0.35 mm RMS), 6D pointer" in out
    assert main(["inspect", "--json", str(file)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["name"], facts["seed"], facts["schema"]) == ("my skull", 6, SCHEMA)
    assert facts["steps"]["scan"]["state"] == "blocked"


def test_serve_refuses_what_is_not_safe(capsys):
    pytest.importorskip("rona_ui.window.window")
    refused(capsys, ["serve", "--no-auth", "--host", "0.0.0.0"])
    refused(capsys, ["serve", "--port", "70000"])
    refused(capsys, ["serve", "--pace", "-1"])
    for nowhere in (__file__, "/proc/nowhere"):
        assert "--sessions" in refused(capsys, ["serve", "--sessions", nowhere])


def test_it_runs_as_a_module_and_help_names_units(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["rona", "demo", "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_module("rona_ui", run_name="__main__")
    assert ended.value.code == 0
    assert " mm" in capsys.readouterr().out
    for arguments, status in ((["--version"], 0), ([], 2)):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == status
    assert capsys.readouterr().out.startswith("rona ")
