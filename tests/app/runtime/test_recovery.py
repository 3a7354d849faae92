"""What a program that is killed leaves behind, and how it comes back."""

import contextlib
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rona_core.app.runtime.saving import autosave, journal
from rona_core.app.runtime.saving.autosave import (
    FOLDER,
    Autosave,
    Recovery,
    RunFolder,
    dead_folders,
)
from rona_core.app.runtime.saving.journal import MOST_ENTRIES, Reach, read_journal
from rona_core.app.runtime.session_registry import MAX_OPEN
from rona_core.app.runtime.session_step import Redo, RenameSession, Undo
from rona_core.app.runtime.store import Store
from rona_core.app.steps.pointer.messages import CalibratePointer, ExcludePoses, StartPointerCapture
from rona_core.app.steps.setup.messages import AddObstacle, SetSeed
from rona_core.compose import build_registry
from rona_core.errors import InvalidInputError, NameTakenError, NotFoundError, SessionFormatError
from rona_core.session.document import LogEntry, Session
from rona_core.session.files import load_session, save_session, session_bytes

DEADLINE_S = 60.0


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a program on the folder; what it started is ended."""
    started = []

    def begin():
        started.append(build_registry(tmp_path, processes=False))
        return started[-1]

    yield begin
    for hub in started:
        hub.close_all()


def killed(hub):
    """End a hub as SIGKILL does: nothing more is written, the system lets go of its lock."""
    descriptor = hub._autosave._folder._descriptor
    hub._autosave._folder._descriptor = None
    hub._autosave._watched.clear()
    if descriptor is not None:
        os.close(descriptor)


def only(hub):
    (lost,) = hub.lost()
    return lost


# -- nothing acknowledged is lost ------------------------------------------------------------------


def test_every_change_is_written_down_before_it_counts(start):
    """Killed after any of these, the session comes back bit by bit, as a file of it would be."""
    hub = start()
    bench = hub.create("one")
    job = bench.jobs.wait(bench.start(StartPointerCapture()).id, DEADLINE_S)
    assert job.state == "done"
    steps = [
        None, SetSeed(7), RenameSession("two"), ExcludePoses("pointer", (3, 4)), Undo(), Undo(),
        Redo(), AddObstacle("box", (500.0, 0.0, 100.0), (50.0, 50.0, 50.0)), Undo(), Undo(), Undo(),
        Undo(), Redo(), CalibratePointer(),
    ]  # fmt: skip
    whole = 0
    for step in steps:
        if step is not None:
            bench.dispatch(step)
        added = read_journal(hub._autosave.file(bench.session.id))
        whole += not added.entries
        store = Store(added.session)
        assert journal.restore(store, added) is None
        kept, held = (session_bytes(one.session, quick=True) for one in (store, bench))
        assert kept == held, step
    # the capture, and steps taken back from before a copy; the rest are rows after it
    assert whole < len(steps) / 2


def test_a_finished_capture_is_in_the_copy_when_its_job_says_done(start):
    hub = start()
    bench = hub.create("one")
    found, looked = [], threading.Event()

    def look(status):
        if status.state == "done":
            copy = hub._autosave.file(bench.session.id)
            found.extend([read_journal(copy).session] if copy.is_file() else [])
            looked.set()

    bench.jobs.subscribe(look)
    bench.start(StartPointerCapture())
    assert looked.wait(DEADLINE_S)
    assert [len(copy.archive) for copy in found] == [1]
    assert found[0].results.pointer is not None


def test_changes_of_several_threads_are_all_in_the_journal_in_order(start):
    hub = start()
    bench = hub.create("one")
    bench.dispatch(SetSeed(0))

    def change(first):
        for number in range(first, first + 10):
            bench.dispatch(SetSeed(number))

    threads = [threading.Thread(target=change, args=(10 * n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    killed(hub)
    hub = start()
    back, problem = hub.recover(only(hub).key)
    assert problem is None
    assert session_bytes(back.session) == session_bytes(bench.session)


def test_a_long_journal_becomes_a_whole_copy(start):
    hub = start()
    bench = hub.create("one")
    lengths = []
    for number in range(MOST_ENTRIES + 3):
        bench.dispatch(SetSeed(number))
        lengths.append(len(read_journal(hub._autosave.file(bench.session.id)).entries))
    assert max(lengths) == MOST_ENTRIES
    assert lengths[-1] < 3


@pytest.mark.parametrize(
    ("messages", "suffices"),
    [
        (["SetSeed", "Undo", "Redo", "Undo"], True),
        (["Undo"], False),  # of something before the copy
        (["SetSeed", "Undo", "Undo"], False),
        (["SetSeed", "Redo"], False),
        (["SetSeed", "Undo", "SetSeed", "Redo"], False),
        (["StoreCapture"], False),  # what a device measured
        (["SetSeed"] * MOST_ENTRIES, True),
        (["SetSeed"] * (MOST_ENTRIES + 1), False),
    ],
)
def test_what_a_journal_can_hold(messages, suffices):
    entries = [LogEntry(n, message, {}, "") for n, message in enumerate(messages, 1)]
    assert (Reach().after(entries) is not None) == suffices


WORK = """
import sys
from pathlib import Path
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry
bench = build_registry(Path(sys.argv[1]), processes=False).create("killed")
assert bench.jobs.wait(bench.start(StartPointerCapture()).id).state == "done"
bench.dispatch(SetSeed(41))
print(len(bench.session.log), flush=True)
sys.stdin.read()
"""


@pytest.mark.ci
def test_a_killed_process_loses_nothing_it_had_acknowledged(tmp_path):
    command = [sys.executable, "-c", WORK, str(tmp_path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        acknowledged = int(process.stdout.readline())
        during = Recovery(tmp_path).keys()
        process.send_signal(signal.SIGKILL)
    assert during == ()  # what another program is working on is not lost
    hub = build_registry(tmp_path, processes=False)
    lost = only(hub)
    assert (lost.name, lost.revision, lost.problem) == ("killed", acknowledged, None)
    assert {"setup", "pointer"} == {*lost.steps_done, *lost.steps_stale}
    bench, problem = hub.recover(lost.key)
    assert problem is None
    assert (bench.store.revision, bench.session.setup.seed) == (acknowledged, 41)
    hub.close_all()


# -- what is offered -------------------------------------------------------------------------------


def test_a_recovered_session_is_open_marked_and_can_be_undone(start):
    hub = start()
    bench = hub.create("one")
    bench.dispatch(SetSeed(1))
    bench.dispatch(RenameSession("two"))
    killed(hub)

    hub = start()
    back, problem = hub.recover(only(hub).key)
    key = back.session.id
    assert problem is None
    assert hub.get() is back
    assert session_bytes(replace(back.session, id=bench.session.id)) == session_bytes(bench.session)
    assert (hub.is_saved(key), hub.is_recovered(key), hub.has_changes(key)) == (False, True, True)
    assert hub.copy_state(key) == "kept"
    assert hub.lost() == ()
    back.dispatch(Undo())
    assert back.session.name == "one"
    hub.save(key)
    assert (hub.is_saved(key), hub.is_recovered(key), hub.has_changes(key)) == (True, False, False)


def test_what_is_recovered_and_killed_again_is_offered_again(start):
    hub = start()
    hub.create("one").dispatch(SetSeed(1))
    for _ in range(3):
        killed(hub)
        hub = start()
        assert only(hub).name == "one"
        hub.recover(only(hub).key)
    assert hub.lost() == ()


def test_an_orderly_end_leaves_unsaved_work_to_be_recovered_and_nothing_else(start, tmp_path):
    hub = start()
    for number, name in enumerate(("unsaved", "saved", "untouched", "closed")):
        bench = hub.create(name)
        if name != "untouched":
            bench.dispatch(SetSeed(number + 1))
    hub.close(hub.get().session.id)
    hub.save(hub.ids()[1])
    hub.close_all()
    assert [lost.name for lost in start().lost()] == ["unsaved"]
    start().discard(start().lost_keys()[0])
    assert start().lost() == ()
    assert [path.name for path in (tmp_path / FOLDER).iterdir()] == ["lock"]


def test_sessions_of_a_running_program_are_not_offered(start):
    first, second = start(), start()
    first.create("one").dispatch(SetSeed(1))
    assert first.lost() == second.lost() == ()
    killed(first)
    assert only(second).name == "one"


def test_the_same_session_in_two_programs_has_two_copies(start, tmp_path):
    session = Session(name="same")
    save_session(session, tmp_path / "same.rona")
    hubs = [start(), start()]
    for number, hub in enumerate(hubs):
        hub.open_file("same.rona").dispatch(SetSeed(10 + number))
        assert hub.get().session.id == session.id
    for hub in hubs:
        killed(hub)
    hub = start()
    assert len(hub.lost()) == 2
    seeds = [hub.recover(lost.key)[0].session.setup.seed for lost in hub.lost()]
    assert sorted(seeds) == [10, 11]


def test_a_copy_that_cannot_be_read_is_shown_and_stays(start):
    hub = start()
    bench = hub.create("one")
    bench.dispatch(SetSeed(1))
    path = hub._autosave.file(bench.session.id)
    killed(hub)
    path.write_bytes(path.read_bytes()[:80])
    hub = start()
    lost = only(hub)
    assert lost.name is None
    assert "not a readable journal" in lost.problem
    before = hub.ids()
    with pytest.raises(SessionFormatError):
        hub.recover(lost.key)
    assert hub.ids() == before
    assert only(hub) == lost
    hub.discard(lost.key)
    assert not path.exists()


def sql(*commands):
    """Return what damages a journal by commands of SQL."""

    def damage(path):
        with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as database:
            for command in commands:
                database.execute(command)

    return damage


def impossible(path):
    """Add a change that cannot be done: what a defect of another version may have written."""
    entry = LogEntry(5, "SetSeed", {"seed": -2}, "2026-01-01T00:00:00+00:00")
    journal.append_entries(path, [entry])


@pytest.mark.parametrize(
    ("damage", "kept", "problem"),
    [
        (lambda path: None, 4, None),
        (sql("UPDATE rows SET data = replace(data, '2', '3') WHERE number = 3"), 2,
         "its journal is damaged (its digest does not fit): changes 3 to 4 cannot be read"),
        (sql("DELETE FROM rows WHERE number = 3"), 2,
         "its journal is damaged (its digest does not fit): changes 3 to 4 cannot be read"),
        (sql("DELETE FROM rows WHERE number = 4"), 3,
         "its journal is damaged (its end does not fit): change 4 cannot be read"),
        (sql("UPDATE rows SET number = 9 WHERE number = 4"), 3,
         "its journal is damaged (its digest does not fit): change 4 cannot be read"),
        (sql("DELETE FROM last"), 4, "its journal is damaged (its end does not fit): "
         "change 4 is the last that can be read, later ones may be missing"),
        (impossible, 4,
         "change 5 (SetSeed) cannot be done again: SetSeed: seed must be 0 to 2147483647, not -2"),
    ],
)  # fmt: skip
def test_a_damaged_journal_gives_what_comes_before_and_stays(start, damage, kept, problem):
    hub = start()
    bench = hub.create("one")
    for seed in range(4):
        bench.dispatch(SetSeed(seed))
    path = hub._autosave.file(bench.session.id)
    killed(hub)
    damage(path)
    evidence = path.read_bytes()
    hub = start()
    lost = only(hub)
    assert (lost.revision, lost.problem) == (kept, problem)
    back, told = hub.recover(lost.key)
    assert (back.store.revision, told) == (kept, problem)
    assert hub.lost_keys() == (() if problem is None else (lost.key,))
    assert problem is None or path.read_bytes() == evidence


def test_what_cannot_be_recovered_is_refused_and_nothing_changes(start):
    hub = start()
    with pytest.raises(NotFoundError):
        hub.recover("absent")
    with pytest.raises(NotFoundError):
        hub.discard("../x")
    hub.create("one").dispatch(SetSeed(1))
    killed(hub)
    hub = start()
    for number in range(MAX_OPEN):
        hub.create(str(number))
    with pytest.raises(InvalidInputError, match="close one first"):
        hub.recover(only(hub).key)
    assert only(hub).name == "one"


def test_while_one_is_recovered_the_others_of_its_program_stay_in_the_list(start, tmp_path):
    hub = start()
    for number in (1, 2):
        hub.create(f"session {number}").dispatch(SetSeed(number))
    killed(hub)
    recovery = Recovery(tmp_path)
    first, second = recovery.keys()
    with recovery.held(first):
        assert recovery.keys() == (first, second)
        with pytest.raises(NotFoundError), Recovery(tmp_path).held(second):
            pass  # of another program
    for key in (first, second):
        with recovery.held(key) as copy:
            assert copy.key == key


def test_of_several_threads_one_recovers_a_session(start):
    hub = start()
    hub.create("one").dispatch(SetSeed(1))
    killed(hub)
    hub = start()
    (key,), back = hub.lost_keys(), []

    def recover():
        with contextlib.suppress(NotFoundError):
            back.append(hub.recover(key))

    threads = [threading.Thread(target=recover) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(back) == len(hub.ids()) == 1


def test_what_cannot_be_done_again_for_a_defect_does_not_hide_what_came_before():
    class Broken:
        def dispatch(self, message, time_utc):
            raise TypeError("of this version")

    entry = LogEntry(1, "SetSeed", {"seed": 3}, "2026-01-01T00:00:00+00:00")
    assert "cannot be done again: of this version" in journal.restore(
        Broken(), journal.Journal(Session(), (entry,))
    )


def test_what_is_being_measured_when_the_program_ends_is_kept(tmp_path):
    hub = build_registry(tmp_path, processes=False, pace=1.0)
    bench = hub.create("measuring")
    bench.start(StartPointerCapture())
    deadline_s = time.monotonic() + DEADLINE_S
    while bench.live.get().frame is None and time.monotonic() < deadline_s:
        time.sleep(0.02)
    hub.close_all()
    after = build_registry(tmp_path, processes=False)
    bench, problem = after.recover(only(after).key)
    assert problem is None
    assert [capture.partial for capture in bench.session.archive] == [True]
    after.close_all()


def test_a_copy_stays_until_the_recovered_session_has_one_of_its_own(start, monkeypatch):
    hub = start()
    hub.create("one").dispatch(SetSeed(1))
    killed(hub)
    hub = start()

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(autosave, "begin_journal", full)
    bench, _ = hub.recover(only(hub).key)
    assert hub.copy_state(bench.session.id) == "failed"
    assert only(hub).name == "one"


def test_after_a_row_that_could_not_be_written_the_journal_is_begun_anew(tmp_path, monkeypatch):
    store, retried = Store(Session(name="first")), threading.Event()
    monkeypatch.setattr(autosave, "RETRY_S", 0.2)
    keeper = Autosave(tmp_path, lambda: keeper.state(store.session.id) == "kept" and retried.set())
    keeper.watch(store)
    keeper.keep(store.dispatch(SetSeed(1)).session)
    retried.clear()
    path = keeper.file(store.session.id)
    path.write_bytes(path.read_bytes()[:3000])  # a disk that lost something
    keeper.keep(store.dispatch(SetSeed(2)).session)
    assert retried.wait(DEADLINE_S)
    held = read_journal(path)
    assert (held.session.setup.seed, held.entries, held.problem) == (2, (), None)
    keeper.close()
    store.close()


@pytest.mark.parametrize("everything", [True, False])
def test_what_somebody_clears_away_meanwhile_is_written_anew(start, tmp_path, everything):
    hub = start()
    bench = hub.create("one")
    bench.dispatch(SetSeed(1))
    if everything:
        shutil.rmtree(tmp_path / FOLDER)
    else:
        hub._autosave.file(bench.session.id).unlink()
    bench.dispatch(SetSeed(2))
    assert hub.copy_state(bench.session.id) == "kept"
    assert hub.lost() == ()  # it is in a folder with a lock again
    killed(hub)
    assert (only(start()).revision, only(start()).problem) == (2, None)


def test_a_folder_that_nobody_may_look_into_keeps_no_program_from_starting(tmp_path, capsys):
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "lock").mkdir()  # not a file: it cannot be opened as one
    hub = build_registry(tmp_path, processes=False)
    with pytest.raises(OSError, match="lock"):
        hub.lost()
    bench = hub.create("one")
    bench.dispatch(SetSeed(1))
    assert hub.copy_state(bench.session.id) == "failed"
    assert hub.save(bench.session.id).is_file()
    hub.close_all()
    assert "no copy of session" in capsys.readouterr().err


# -- folders and temporary files -------------------------------------------------------------------


def test_a_folder_is_dead_once_its_lock_is_free(tmp_path):
    folder = RunFolder(tmp_path)
    (folder.claim() / "x.rona").write_bytes(b"x")
    assert dead_folders(tmp_path) == ()
    folder.release()
    assert dead_folders(tmp_path) == (folder.path,)
    empty = RunFolder(tmp_path)
    empty.claim()
    empty.release()
    assert not empty.path.exists()


@pytest.mark.ci
def test_temporary_files_of_killed_programs_go_at_the_start_and_no_others(tmp_path):
    script = (
        "import os, sys\nfrom pathlib import Path\n"
        "from rona_core.session.files import open_temporary\n"
        "for place in sys.argv[1:]:\n"
        "    Path(place).parent.mkdir(parents=True, exist_ok=True)\n"
        "    os.write(open_temporary(Path(place))[0], b'half')\n"
        "print('ready', flush=True)\nsys.stdin.read()\n"
    )
    places = [tmp_path / "a.rona", tmp_path / ".uploads/b.stl", tmp_path / FOLDER / "f00/c.rona"]
    users = [tmp_path / ".a.rona.original", tmp_path / ".a.rona.notes.part", tmp_path / "b.part"]

    def half_written():
        return sorted(p for p in tmp_path.rglob(".*") if p.is_file() and p not in users)

    command = [sys.executable, "-c", script, *map(str, places)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"ready\n"
        for path in users:
            path.write_bytes(b"half")
        build_registry(tmp_path, processes=False).close_all()
        assert len(half_written()) == 3  # they are being written
        process.send_signal(signal.SIGKILL)
    build_registry(tmp_path, processes=False).close_all()
    assert half_written() == []
    assert all(path.exists() for path in users)


# -- names -----------------------------------------------------------------------------------------


def test_a_name_that_is_taken_is_refused_unless_it_is_to_be_replaced(start, tmp_path):
    hub = start()
    first, second = hub.create("first", 1), hub.create("second", 2)
    path = hub.save(first.session.id, "same")
    before = path.read_bytes()
    with pytest.raises(NameTakenError, match=r"same\.rona is the file of another open session"):
        hub.save(second.session.id, "same.rona")
    (tmp_path / "foreign.rona").write_bytes(b"x")
    with pytest.raises(NameTakenError, match=r"foreign\.rona exists already"):
        hub.save(second.session.id, "foreign")
    assert path.read_bytes() == before
    assert not hub.is_saved(second.session.id)
    assert hub.save(first.session.id, "same") == path  # its own

    hub.save(second.session.id, "same", replace=True)
    assert load_session(path).name == "second"
    assert Path(f"{path}.bak").read_bytes() == before
    assert (hub.is_saved(second.session.id), hub.is_saved(first.session.id)) == (True, False)
    assert hub.file(first.session.id) is None
    assert hub.has_changes(first.session.id)
    assert hub.copy_state(first.session.id) == "kept"
    assert hub.save(first.session.id).name == "first.rona"


def test_a_file_belongs_to_the_session_that_was_opened_from_it_first(start, tmp_path):
    save_session(Session(name="bone"), tmp_path / "bone.rona")
    hub = start()
    first, second = hub.open_file("bone.rona"), hub.open_file("bone.rona")
    first.dispatch(SetSeed(1))
    second.dispatch(SetSeed(2))
    assert hub.save(first.session.id).name == "bone.rona"
    assert hub.save(second.session.id).name == "bone 2.rona"
    assert load_session(tmp_path / "bone.rona").setup.seed == 1


def test_sessions_saved_at_once_under_one_name_do_not_replace_each_other(start):
    hub = start()
    benches = [hub.create(f"s{n}", n) for n in range(8)]
    refused = []

    def save(bench):
        try:
            hub.save(bench.session.id, "same")
        except NameTakenError:
            refused.append(bench)

    threads = [threading.Thread(target=save, args=(bench,)) for bench in benches]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(refused) == 7
    assert [hub.is_saved(b.session.id) for b in benches].count(True) == 1


def test_an_untouched_session_has_nothing_to_lose(start, tmp_path):
    save_session(Session(name="bone"), tmp_path / "bone.rona")
    hub = start()
    again = tmp_path / "bone.rona"
    for bench in (hub.create(), hub.open_file("bone.rona"), hub.open_upload(again, "x")):
        assert not hub.has_changes(bench.session.id)
        bench.dispatch(SetSeed(1))
        assert hub.has_changes(bench.session.id)
