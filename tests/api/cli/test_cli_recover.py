"""`rona recover`: what it lists, saves, discards and refuses."""

import contextlib
import json
import sqlite3
import sys

import pytest

from rona_core.app.runtime.session_step import RenameSession
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry
from rona_core.session.codec import digest
from rona_core.session.files import load_session
from rona_ui.cli import main, serve
from tests.api.cli.test_cli import refused


@pytest.fixture
def left(tmp_path):
    """Sessions that a program left unsaved in ``tmp_path``, by name."""
    hub = build_registry(tmp_path, processes=False)
    sessions = {}
    for name in ("first", "second", "second"):
        bench = hub.create("new")
        bench.dispatch(SetSeed(len(sessions) + 1))
        bench.dispatch(RenameSession(name))
        sessions[bench.session.id] = bench.session
    hub.close_all()
    return sessions


def facts(capsys, *arguments):
    assert main(["recover", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_list_tells_name_time_size_and_steps(left, capsys, tmp_path):
    found = facts(capsys, "--sessions", tmp_path)["recoverable"]
    assert sorted(lost["name"] for lost in found) == ["first", "second", "second"]
    assert main(["recover", "--sessions", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert all(lost["key"] in out for lost in found)
    assert out.count("1 of 10 steps done") == 3
    assert out.count(" MB, ") == 3
    assert main(["recover", "--sessions", str(tmp_path / "empty")]) == 0
    assert "nothing to recover" in capsys.readouterr().out


def test_a_session_is_saved_whole_and_its_copy_goes(left, capsys, tmp_path):
    told = facts(capsys, "first", "--sessions", tmp_path)
    session = load_session(tmp_path / "first.rona")
    assert told == {"file": str(tmp_path / "first.rona"), "problem": None}
    assert digest(session) == digest(left[session.id])
    assert len(facts(capsys, "--sessions", tmp_path)["recoverable"]) == 2


def test_a_file_that_exists_is_not_written_over(left, capsys, tmp_path):
    (tmp_path / "first.rona").write_bytes(b"mine")
    out = tmp_path / "out.rona"
    out.write_bytes(b"mine")
    where = ["--sessions", str(tmp_path)]
    text = refused(capsys, ["recover", "first", "--out", str(out), *where])
    assert "exists already: choose another name" in text
    assert facts(capsys, "first", *where)["file"].endswith("first 2.rona")
    assert (tmp_path / "first.rona").read_bytes() == out.read_bytes() == b"mine"


def test_of_two_of_one_name_one_is_chosen_by_its_key(left, capsys, tmp_path):
    where = ["--sessions", str(tmp_path)]
    text = refused(capsys, ["recover", "second", *where])
    keys = [x["key"] for x in facts(capsys, *where)["recoverable"] if x["name"] == "second"]
    assert all(key in text for key in keys)
    assert facts(capsys, keys[0], "--discard", *where) == {"discarded": keys[0]}
    assert facts(capsys, "second", *where)["problem"] is None


def test_what_cannot_be_done_is_refused(left, capsys, tmp_path):
    where = ["--sessions", str(tmp_path)]
    assert "rona recover lists them" in refused(capsys, ["recover", "absent", *where])
    assert "say which session" in refused(capsys, ["recover", "--discard", *where])
    for path in (tmp_path / ".autosave").glob("*/*.journal"):
        path.write_bytes(b"damaged")
    key = facts(capsys, *where)["recoverable"][0]["key"]
    assert "not a readable journal" in refused(capsys, ["recover", key, *where])
    assert main(["recover", *where]) == 0
    assert capsys.readouterr().out.count("a copy that cannot be read") == 3


def test_what_is_damaged_in_part_is_saved_and_stays(left, capsys, tmp_path):
    for path in (tmp_path / ".autosave").glob("*/*.journal"):
        with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as database:
            database.execute("DELETE FROM rows WHERE number > 1")
    where = ["--sessions", str(tmp_path)]
    key = facts(capsys, *where)["recoverable"][0]["key"]
    assert main(["recover", key, *where]) == 3
    out = capsys.readouterr().out
    assert "but its journal is damaged (its end does not fit): change 2 cannot be read" in out
    assert load_session(tmp_path / "new.rona").name == "new"
    assert len(facts(capsys, *where)["recoverable"]) == 3


@pytest.mark.parametrize(("ended", "words"), [(True, "3 sessions were not saved"), (False, None)])
def test_serve_says_at_its_start_what_can_be_recovered(
    left, capsys, tmp_path, monkeypatch, ended, words
):
    def once(settings, *, build_registry, open_window, say):
        say("http://address")

    def leave():
        sys.exit(0)  # not the whole process, which is that of the tests

    monkeypatch.setattr(serve, "serve", once)
    monkeypatch.setattr(serve, "_leave", leave)
    folder = tmp_path if ended else tmp_path / "empty"
    with pytest.raises(SystemExit):
        main(["serve", "--no-open", "--sessions", str(folder)])
    out = capsys.readouterr().out
    assert out.startswith("RONA is at http://address\n")
    assert ("recover" in out) == ended
    assert words is None or words in out
