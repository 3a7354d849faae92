"""``rona calibrate pivot``: what it prints, and its exit status."""

import json

import numpy as np
import pytest

from rona_ui.cli import main
from tests.helpers.pivot_data import (
    TIP,
    geometry_file,
    marker_rows,
    markers_file,
    matrix_files,
    poses,
    rows_file,
)

KEYS = ["tip_mm", "pivot_mm", "sigma_mm", "rmse_mm", "n_used", "n_rejected", "n_repeated"]
KEYS += ["verdict", "reasons", "notes"]


@pytest.fixture
def put(tmp_path):
    """Return a function that writes a file and returns its path."""

    def write(file):
        path = tmp_path / file.name
        path.write_bytes(file.data)
        return str(path)

    return write


def asked(capsys, *arguments, status=0):
    assert main(["calibrate", "pivot", *arguments, "--json"]) == status
    out = capsys.readouterr().out
    assert out.count("\n") == 1
    figures = json.loads(out)
    assert list(figures) == KEYS
    return figures


def test_matrices_a_file_each_a_folder_of_them_and_rows_agree(put, capsys, tmp_path):
    made, pivot = poses(n=40, sigma_mm=0.1)
    files = [put(file) for file in matrix_files(made)]
    one = asked(capsys, *files)
    assert one["verdict"] == "good"
    np.testing.assert_allclose(one["tip_mm"], TIP, atol=0.5)
    np.testing.assert_allclose(one["pivot_mm"], pivot, atol=0.5)
    assert (one["n_used"] + one["n_rejected"], one["reasons"]) == (40, [])
    assert asked(capsys, str(tmp_path)) == one
    rows = asked(capsys, put(rows_file(made)))
    assert rows["tip_mm"] == pytest.approx(one["tip_mm"], abs=1e-9)


@pytest.mark.parametrize("method", ["ml", "sphere"])
def test_markers_with_and_without_geometry(put, capsys, method):
    made, _ = poses(n=50)
    file = put(markers_file(marker_rows(made, noise_mm=0.05)))
    known = asked(capsys, file, "--geometry", put(geometry_file()), "--method", method)
    np.testing.assert_allclose(known["tip_mm"], TIP, atol=0.4)
    free = asked(capsys, file, "--method", method)
    assert np.linalg.norm(free["pivot_mm"]) == pytest.approx(
        np.linalg.norm(known["pivot_mm"]), abs=0.4
    )


@pytest.mark.slow
def test_twenty_thousand_rows(put, capsys):
    made, _ = poses(n=20_000, sigma_mm=0.2)
    assert asked(capsys, put(rows_file(made)))["n_used"] > 19_000


def test_what_determines_no_tip_is_printed_with_status_3(put, capsys):
    figures = asked(capsys, put(rows_file(poses(n=6)[0])), status=3)
    assert figures["verdict"] == "bad"
    assert figures["reasons"] == ["too few poses: at least 10 are needed, not 6"]
    assert [figures[key] for key in KEYS[:4]] == [None] * 4
    narrow = put(rows_file(poses(n=40, half_angle_deg=2.0)[0]))
    assert main(["calibrate", "pivot", narrow]) == 3
    out = capsys.readouterr().out
    assert "bad: the swing covers a cone of only 2.0 degrees" in out


def test_a_table_for_people(put, capsys):
    file = put(rows_file(poses(n=40, half_angle_deg=8.0, sigma_mm=0.3)[0]))
    assert main(["calibrate", "pivot", file]) == 0
    out = capsys.readouterr().out
    for words in ("40 poses from rows of poses", "Tip in the marker frame", "Verdict", "weak"):
        assert words in out
    assert "sweep to 20 degrees" in out


@pytest.mark.parametrize("json_wanted", [True, False])
def test_bad_input_is_one_line_and_status_2(put, capsys, tmp_path, json_wanted):
    good = put(rows_file(poses(n=20)[0]))
    bad = tmp_path / "bad.csv"
    bad.write_text("1 2 3")
    empty = tmp_path / "empty"
    empty.mkdir()
    for arguments, words in (
        ([str(tmp_path / "no.csv")], "there is no file"),
        ([str(bad)], "bad.csv, line 1: expected 16 or 12 numbers"),
        ([good, "--geometry", str(tmp_path / "no.rom")], "there is no file"),
        ([good, "--geometry", str(bad)], "bad.csv, line 1: expected 4 cells"),
        ([str(empty)], "no files in the folder"),
    ):
        status = main(["calibrate", "pivot", *arguments, *(["--json"] if json_wanted else [])])
        out, err = capsys.readouterr()
        assert (status, out) == (2, "")
        assert words in err
        assert err.count("\n") == 1


@pytest.mark.parametrize("words", [[], ["tip"], ["pivot"], ["pivot", "x", "--dof", "4"]])
def test_words_that_are_not_understood(words, capsys):
    with pytest.raises(SystemExit) as end:
        main(["calibrate", *words])
    assert end.value.code == 2
    assert "usage: rona calibrate" in capsys.readouterr().err
