"""``rona figures``: what it writes, what it says of what it cannot draw, and its exit status."""

import shutil
from pathlib import Path

import pytest

from rona_core.app.paper_figures.table import PAPER_FIGURES, drawn_figure, lacking
from rona_core.session.document import Session
from rona_core.session.files import load_session, save_session
from rona_ui.cli import main
from tests.scenes import demo_parts

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def early(tmp_path):
    """The file of a session after step 3."""
    file = tmp_path / "early.rona"
    save_session(demo_parts.registered(), file)
    return file


def test_what_can_be_drawn_is_and_of_the_rest_the_step_is_named(early, tmp_path, capsys):
    assert main(["figures", str(early)]) == 0
    made = sorted(tmp_path.glob("early_figures/*"))
    assert [path.name for path in made] == [f"figure_04_registrations.{f}" for f in ("png", "svg")]
    session, said = load_session(early), capsys.readouterr().out.splitlines()
    png, svg = (path.read_bytes() for path in made)
    assert svg == drawn_figure(session, "registrations", "svg")
    assert png.startswith(b"\x89PNG")
    missing = [lacking(one, session) for one in PAPER_FIGURES.values()]
    assert [line for line in said if line.startswith("Figure ")] == [m for m in missing if m]
    assert "Figure 10 needs the maps: compute the maps (step 9)" in said


def test_one_figure_in_one_form_where_it_is_wanted(early, tmp_path, capsys):
    out = tmp_path / "deep" / "er"
    wanted = ["--only", "registrations", "--format", "svg", "--out", str(out)]
    assert main(["figures", str(early), *wanted]) == 0
    (path,) = out.iterdir()
    assert path.read_bytes().startswith(b"<?xml")
    assert str(path) in capsys.readouterr().out


def test_an_empty_session_has_none_and_nothing_is_written(tmp_path, capsys):
    file = tmp_path / "empty.rona"
    save_session(Session(), file)
    assert main(["figures", str(file)]) == 3
    said = capsys.readouterr()
    assert len(said.out.splitlines()) == len(PAPER_FIGURES)
    assert not said.err
    assert list(tmp_path.iterdir()) == [file]


def test_bad_input_is_one_line_and_status_2(early, tmp_path, capsys):
    for arguments, words in (
        ([str(early), "--only", "figure_11"], "milling_path, registrations"),
        ([str(tmp_path / "absent.rona")], "no session file"),
    ):
        assert main(["figures", *arguments]) == 2
        said = capsys.readouterr()
        assert not said.out
        assert words in said.err
    with pytest.raises(SystemExit) as refused:
        main(["figures", str(early), "--format", "pdf"])
    assert refused.value.code == 2


@pytest.mark.slow
def test_of_the_demo_session_all_are_drawn(tmp_path, capsys):
    file = tmp_path / "demo.rona"
    shutil.copy(ROOT / "sessions" / "demo.rona", file)
    assert main(["figures", str(file), "--format", "svg"]) == 0
    names = [one.file_name("svg") for one in PAPER_FIGURES.values()]
    assert sorted(path.name for path in (tmp_path / "demo_figures").iterdir()) == names
    assert len(capsys.readouterr().out.splitlines()) == len(names)


def test_a_full_disk_is_named_with_the_file(early, capsys, monkeypatch):
    def full(path, data):
        raise OSError(28, "No space left on device", str(path))

    monkeypatch.setattr(Path, "write_bytes", full)
    assert main(["figures", str(early), "--only", "registrations"]) == 2
    said = capsys.readouterr().err
    assert "figure_04_registrations" in said
    assert "Traceback" not in said
