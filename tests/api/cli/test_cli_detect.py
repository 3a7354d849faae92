"""``rona detect``: what it prints, and its exit status."""

import json

import numpy as np
import pytest

from rona_ui.cli import main
from tests.scenes.tank_recordings import PLATE, record, varied

KEYS = [
    "n_scans",
    "mean_thickness_mm",
    "robust_sd_mm",
    "failure_fraction",
    "flagged_fraction",
    "thickness_mm",
]
CASE = varied(PLATE, scans=25, floor_gap_mm=12.0, full_scale=0.4, dropout=0.1, seed=2)


@pytest.fixture(scope="module")
def made():
    return record(CASE)


@pytest.fixture(scope="module")
def path(made, tmp_path_factory):
    file = tmp_path_factory.mktemp("rf") / "plate.npz"
    rf = made.file.rf.astype(np.int16)
    np.savez(file, rf=rf, fs=50e6, t0=0.0, positions=made.file.positions_mm)
    return str(file)


def asked(capsys, *arguments, status=0):
    assert main(["detect", *arguments, "--json"]) == status
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    figures = json.loads(out)
    assert list(figures) == KEYS
    return figures


def test_json_holds_a_thickness_or_null_for_every_scan(capsys, path, made):
    figures = asked(capsys, path, "--speed", "2850")
    assert figures["n_scans"] == 25
    assert len(figures["thickness_mm"]) == 25
    there = np.array([value is not None for value in figures["thickness_mm"]])
    assert not made.contact.all()
    np.testing.assert_array_equal(there, made.contact)
    assert figures["flagged_fraction"] == pytest.approx(1 - made.contact.mean())
    assert figures["failure_fraction"] == pytest.approx(figures["flagged_fraction"])
    assert figures["mean_thickness_mm"] == pytest.approx(6.0, abs=0.04)
    assert figures["robust_sd_mm"] < 0.01


def test_a_named_probe_changes_only_where_the_band_is_sought(capsys, path):
    figures = asked(capsys, path, "--speed", "2850", "--probe", "2.25MHz")
    assert figures["mean_thickness_mm"] == pytest.approx(6.0, abs=0.04)


def test_the_table_says_the_same(capsys, path):
    assert main(["detect", path, "--speed", "2850"]) == 0
    out = capsys.readouterr().out
    for words in ("Mean thickness", "Robust deviation about a plane", "Failures", "Flagged"):
        assert words in out
    assert "no front echo" in out
    assert "6.02" in out


def test_lines_without_a_plate_are_printed_with_status_3(capsys, tmp_path):
    file = tmp_path / "noise.npz"
    np.savez(file, rf=np.random.default_rng(1).normal(size=(9, 1000)), fs=50e6)
    figures = asked(capsys, str(file), "--speed", "2850", status=3)
    assert figures["mean_thickness_mm"] is None
    assert figures["robust_sd_mm"] is None
    assert figures["thickness_mm"] == [None] * 9
    assert main(["detect", str(file), "--speed", "2850"]) == 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--speed", "2.85"], "m/s are meant"),
        (["--speed", "nan"], "500 to 10000 m/s"),
        (["--speed", "2850", "--probe", "7MHz"], "probe must be one of"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(capsys, path, arguments, words):
    assert main(["detect", path, *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "Traceback" not in error


def test_a_file_that_is_none_is_refused(capsys, tmp_path):
    assert main(["detect", str(tmp_path), "--speed", "2850"]) == 2
    assert "is a folder" in capsys.readouterr().err
    assert main(["detect", str(tmp_path / "no.npz"), "--speed", "2850"]) == 2
    assert "there is no file" in capsys.readouterr().err
    text = tmp_path / "a.csv"
    text.write_text("1,2,3\n")
    assert main(["detect", str(text), "--speed", "2850"]) == 2
    assert "no HDF5, MATLAB" in capsys.readouterr().err


def test_ctrl_c_ends_cleanly(capsys, path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rona_ui.cli.detect.report_rf", interrupted)
    assert main(["detect", path, "--speed", "2850"]) == 130
    assert "interrupted" in capsys.readouterr().err
