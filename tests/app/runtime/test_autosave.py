"""Journals of what is not saved: written with a change and before long work, gone when saved."""

import sqlite3
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from rona_core.app.runtime.saving import autosave
from rona_core.app.runtime.saving.autosave import Autosave
from rona_core.app.runtime.saving.journal import read_journal
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.runtime.session_step import RenameSession
from rona_core.app.runtime.store import Store
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.compose import build_registry, virtual_services
from rona_core.session.document import Session
from rona_core.session.files import session_bytes

DEADLINE_S = 20.0


class Bell:
    """Lets a test wait until the autosave has reported a change of its state."""

    def __init__(self):
        self._event = threading.Event()

    def __call__(self):
        self._event.set()

    def wait(self):
        assert self._event.wait(DEADLINE_S)
        self._event.clear()


@pytest.fixture
def watched(tmp_path):
    """A watched store whose changes are kept, its autosave, and the bell."""
    bell, store = Bell(), Store(Session(name="first"))
    keeper = Autosave(tmp_path, bell)
    keeper.watch(store)
    yield store, keeper, bell
    keeper.close()
    store.close()


def change(watched, message):
    """Change the session as a workbench does, and return it."""
    store, keeper, _ = watched
    session = store.dispatch(message).session
    keeper.keep(session)
    return session


def copy_in(path):
    return read_journal(path).session


def test_a_change_is_copied_and_the_copy_is_the_session(watched):
    store, keeper, bell = watched
    assert keeper.state(store.session.id) == "none"
    change(watched, RenameSession("second"))
    bell.wait()
    assert keeper.state(store.session.id) == "kept"
    copy = copy_in(keeper.file(store.session.id))
    assert copy.name == "second"
    assert session_bytes(copy) == session_bytes(store.session)


def test_an_unchanged_session_is_not_copied(watched):
    store, keeper, _ = watched
    keeper.keep(store.session)
    assert not keeper.file(store.session.id).exists()


def test_what_is_saved_needs_no_copy_until_it_changes_again(watched):
    store, keeper, bell = watched
    change(watched, RenameSession("second"))
    bell.wait()
    keeper.saved(store.session)
    assert keeper.state(store.session.id) == "none"
    assert not keeper.file(store.session.id).exists()
    change(watched, RenameSession("third"))
    bell.wait()
    assert copy_in(keeper.file(store.session.id)).name == "third"


def test_saving_an_older_state_leaves_the_copy_of_the_newer_one(watched):
    store, keeper, _ = watched
    older = store.dispatch(RenameSession("second")).session
    newer = store.dispatch(RenameSession("third")).session
    keeper.keep(newer)
    keeper.saved(older)
    assert copy_in(keeper.file(newer.id)).name == "third"


FAILURES = [
    OSError(28, "full"), sqlite3.OperationalError("disk I/O error"), ValueError("no number"),
    MemoryError(),
]  # fmt: skip


@pytest.mark.parametrize("error", FAILURES)
def test_a_journal_that_cannot_be_written_is_shown_and_tried_again_by_itself(
    watched, monkeypatch, capsys, error
):
    store, keeper, bell = watched
    real, tries = autosave.begin_journal, []

    def fails_once(*args):
        tries.append(args)
        if len(tries) == 1:
            raise error
        return real(*args)

    monkeypatch.setattr(autosave, "RETRY_S", 0.2)
    monkeypatch.setattr(autosave, "begin_journal", fails_once)
    change(watched, RenameSession("second"))
    bell.wait()
    assert store.session.id in capsys.readouterr().err
    bell.wait()
    assert keeper.state(store.session.id) == "kept"
    assert copy_in(keeper.file(store.session.id)).name == "second"


def test_between_two_tries_no_change_waits_for_the_disk(watched, monkeypatch):
    store, keeper, _ = watched
    tries = []

    def full(*args):
        tries.append(args)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(autosave, "begin_journal", full)
    for number in range(5):
        change(watched, RenameSession(str(number)))
        assert keeper.state(store.session.id) == "failed"
    assert len(tries) == 1


@pytest.fixture
def hub(tmp_path):
    hub = build_registry(tmp_path, processes=False)
    yield hub
    hub.close_all()


def copies(hub):
    return sorted((hub.files.folder / autosave.FOLDER).rglob("*.journal"))


def test_the_copy_is_written_before_long_work_starts(tmp_path):
    services = virtual_services()
    found = []

    def build_rig(setup):  # the first thing that the work does
        found.extend(copy_in(copy).setup.seed for copy in copies(hub))
        return services.build_rig(setup)

    hub = SessionRegistry(replace(services, build_rig=build_rig), tmp_path)
    bench = hub.create("long")
    bench.dispatch(SetSeed(7))
    status = bench.start(StartPointerCapture())
    assert bench.jobs.wait(status.id, DEADLINE_S).state == "done"
    hub.close_all()
    assert found == [7]


def test_saving_removes_the_copy_and_closing_too(hub):
    for leave in (lambda b: hub.save(b.session.id), lambda b: hub.close(b.session.id)):
        bench = hub.create("one")
        bench.dispatch(SetSeed(1))
        hub._autosave.keep(bench.session)
        assert len(copies(hub)) == 1
        assert hub.copy_state(bench.session.id) == "kept"
        leave(bench)
        assert copies(hub) == []


def test_a_copy_that_cannot_be_removed_stops_neither_saving_nor_closing(hub, monkeypatch):
    bench = hub.create("one")
    bench.dispatch(SetSeed(1))
    hub._autosave.keep(bench.session)

    def refuse(path, missing_ok=False):
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "unlink", refuse)
    assert hub.save(bench.session.id).is_file()
    hub.close(bench.session.id)
    assert hub.ids() == ()


def test_the_end_of_the_program_keeps_what_was_not_saved(tmp_path):
    hub = build_registry(tmp_path, processes=False)
    bench = hub.create("one")
    bench.dispatch(SetSeed(5))
    hub.close_all()
    (copy,) = copies(hub)
    assert copy_in(copy).setup.seed == 5
    assert not hub.files.all()  # it does not pass for a saved session
