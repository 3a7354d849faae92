"""Two programs on one folder, and people with a file manager: nothing is written over unseen.

The law of every history: a save that was not told to replace writes over no content but what this
program opened or saved last; and `saved` is true only over a file that holds the session.
"""

import os
import threading
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.runtime.session_registry import MAX_OPEN
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry
from rona_core.errors import FileChangedError, NotFoundError, RonaError, SessionFormatError
from rona_core.session import files
from rona_core.session.document import Session
from rona_core.session.files import alone_in, load_session, save_session, session_bytes

ROUNDS = 6


@pytest.fixture
def hubs(tmp_path):
    """Two programs, each with the session of one file open."""
    save_session(Session(name="bone"), tmp_path / "bone.rona")
    started = [build_registry(tmp_path, processes=False) for _ in range(2)]
    for hub in started:
        hub.open_file("bone.rona")
    yield started
    for hub in started:
        hub.close_all()


def edit(hub, seed):
    hub.get().dispatch(SetSeed(seed))


def in_place(path):
    """Change a file as some editors do: the same inode and size, the time set back."""
    was, data = path.stat(), bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(was.st_atime_ns, was.st_mtime_ns))


FOREIGN = {
    "delete": lambda path, number: path.unlink(missing_ok=True),
    "replace": lambda path, number: save_session(Session(name=f"foreign {number}"), path),
    "in place": lambda path, number: in_place(path) if path.exists() else None,
    "touch": lambda path, number: path.touch() if path.exists() else None,
    "copy": lambda path, number: (
        files.write_whole(path, path.read_bytes()) if path.exists() else None
    ),
}


def _saved(hub, path):
    """Save without replacing; return whether that was done."""
    try:
        assert hub.save() == path
    except FileChangedError:
        return False
    return True


@pytest.mark.parametrize("seed", range(12))
def test_no_history_writes_over_what_this_program_has_not_seen(hubs, tmp_path, seed):
    random, path = np.random.default_rng(seed), tmp_path / "bone.rona"
    seen = [path.read_bytes()] * 2
    verbs = ["edit", "save", "save", "reload", *FOREIGN]
    refused = 0
    for number in range(40):
        who, verb = int(random.integers(2)), verbs[random.integers(len(verbs))]
        hub, before = hubs[who], path.read_bytes() if path.exists() else None
        if verb == "edit":
            edit(hub, number)
        elif verb in FOREIGN:
            FOREIGN[verb](path, number)
        elif verb == "reload":
            try:
                hub.reload("current")
                seen[who] = before
            except (NotFoundError, SessionFormatError):
                assert before is None or before != seen[who]
        else:
            written = _saved(hub, path)
            if written:
                assert before is None or before == seen[who], (number, "written over unseen")
                seen[who] = path.read_bytes()
                assert seen[who] == session_bytes(hub.get().session)
            else:
                refused += 1
                assert before not in (None, seen[who])
                assert path.read_bytes() == before
        for own, each in enumerate(hubs):
            now = path.read_bytes() if path.exists() else None
            if each.is_saved("current"):
                assert now == seen[own]
            if now != seen[own]:
                assert each.file_state("current") == ("missing" if now is None else "changed")
                assert each.has_changes("current")
                assert each.copy_state("current") == "kept"
    assert refused > 0


def test_of_two_programs_that_save_at_the_same_moment_one_is_refused(hubs, tmp_path):
    for number in range(ROUNDS):
        for who, hub in enumerate(hubs):
            hub.reload("current")
            edit(hub, 2 * number + who + 100)
        gate, ends = threading.Barrier(2), {}

        def save(who, gate=gate, ends=ends):
            gate.wait()
            try:
                hubs[who].save()
                ends[who] = None
            except FileChangedError:
                ends[who] = "refused"

        threads = [threading.Thread(target=save, args=(who,)) for who in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        (winner,) = (who for who, end in ends.items() if end is None)
        assert load_session(tmp_path / "bone.rona").setup.seed == 2 * number + winner + 100
        assert [hub.is_saved("current") for hub in hubs] == [winner == 0, winner == 1]


def test_new_sessions_of_two_programs_get_two_files(hubs):
    gate, paths = threading.Barrier(2), []

    def save(hub):
        hub.create("new")
        gate.wait()
        paths.append(hub.save())

    threads = [threading.Thread(target=save, args=(hub,)) for hub in hubs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {path.name for path in paths} == {"new.rona", "new 2.rona"}


def test_the_ways_out_of_a_conflict(hubs, tmp_path):
    first, second = hubs
    path = tmp_path / "bone.rona"
    edit(first, 1)
    edit(second, 2)
    first.save()
    with pytest.raises(FileChangedError, match="save under another name, reload it, or say"):
        second.save()
    assert second.save(file="other").name == "other.rona"  # save as
    assert load_session(path).setup.seed == 1

    edit(first, 3)
    save_session(Session(name="foreign"), path)
    with pytest.raises(FileChangedError):
        first.save(file="bone")  # by its name too
    first.save(replace=True)  # overwrite, said in so many words
    assert load_session(path).setup.seed == 3
    assert load_session(Path(f"{path}.bak")).name == "foreign"

    save_session(Session(name="foreign"), path)
    before = first.ids()
    back = first.reload("current")
    assert (back.session.name, first.is_saved("current")) == ("foreign", True)
    assert first.file("current") == path
    assert len(first.ids()) == len(before)
    edit(first, 4)
    assert first.save() == path


def test_what_cannot_be_reloaded_leaves_the_session_as_it_was(hubs, tmp_path):
    hub, path = hubs[0], tmp_path / "bone.rona"
    edit(hub, 5)
    key = hub.get().session.id
    path.write_bytes(b"PK damaged")
    with pytest.raises(SessionFormatError):
        hub.reload(key)
    path.unlink()
    with pytest.raises(NotFoundError):
        hub.reload(key)
    assert hub.get(key).session.setup.seed == 5
    assert hub.file(key) == path
    hub.create("no file")
    with pytest.raises(NotFoundError, match="save it first"):
        hub.reload("current")
    while len(hub.ids()) < MAX_OPEN:
        hub.create()
    save_session(Session(name="foreign"), path)
    assert hub.reload(key).session.name == "foreign"  # it takes the place of another one
    assert len(hub.ids()) == MAX_OPEN


def test_a_file_that_was_removed_is_no_saved_session_and_is_recovered_after_a_kill(hubs, tmp_path):
    hub = hubs[0]
    edit(hub, 6)
    path = hub.save()
    assert (hub.is_saved("current"), hub.copy_state("current")) == (True, "none")
    path.unlink()
    assert (hub.is_saved("current"), hub.file_state("current")) == (False, "missing")
    assert hub.copy_state("current") == "kept"
    assert hub.save() == path
    assert (hub.is_saved("current"), hub.copy_state("current")) == (True, "none")


def test_a_program_that_hangs_while_it_saves_keeps_no_other_waiting_for_good(
    hubs, tmp_path, monkeypatch
):
    monkeypatch.setattr(files, "WAIT_S", 0.2)
    edit(hubs[0], 7)
    with alone_in(tmp_path), pytest.raises(RonaError, match="end it, or save again"):
        hubs[0].save()
    assert not hubs[0].is_saved("current")
    hubs[0].save()
