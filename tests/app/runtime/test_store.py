"""The store: one way to change a session, undo of everything, listeners in order."""

import itertools
import threading

import pytest

from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime import store as store_module
from rona_core.app.runtime.session_step import Redo, RenameSession, Undo
from rona_core.app.runtime.store import Store
from rona_core.app.steps.setup.messages import SetPointer, SetSeed, SetToolVisible
from rona_core.errors import InvalidInputError, StepBlockedError
from rona_core.session.codec import digest
from rona_core.session.document import Session
from tests.core.session.test_session_files import capture


def document(session: Session) -> tuple[str, ...]:
    return tuple(map(digest, (session.setup, session.captures, session.results)))


def test_a_command_makes_a_new_session_and_leaves_the_old_one():
    store = Store(Session())
    old = store.session
    store.dispatch(SetSeed(7))
    assert old.setup.seed == 0
    assert store.session.setup.seed == 7
    assert store.session.captures is old.captures, "unchanged parts are the same objects"
    assert [e.message for e in store.session.log] == ["SetSeed"]
    assert store.session.log[0].arguments == {"seed": 7}


def test_undo_and_redo_walk_through_every_state():
    store = Store(Session())
    states = [document(store.session)]
    for message in (SetSeed(3), SetPointer("pointer5d"), SetToolVisible("toolmarker", False)):
        store.dispatch(message)
        states.append(document(store.session))
    for expected in reversed(states[:-1]):
        store.dispatch(Undo())
        assert document(store.session) == expected
    with pytest.raises(InvalidInputError, match="nothing to undo"):
        store.dispatch(Undo())
    for expected in states[1:]:
        store.dispatch(Redo())
        assert document(store.session) == expected
    with pytest.raises(InvalidInputError, match="nothing to do again"):
        store.dispatch(Redo())
    assert store.revision == 3 + 3 + 3


def test_only_so_many_steps_are_kept_to_be_taken_back(monkeypatch):
    monkeypatch.setattr(store_module, "UNDO_STEPS", 3)
    store = Store(Session())
    for seed in range(1, 7):
        store.dispatch(SetSeed(seed))
    for expected in (5, 4, 3):
        assert store.dispatch(Undo()).session.setup.seed == expected
    assert not store.can_undo


def test_a_new_command_ends_the_redo():
    store = Store(Session())
    store.dispatch(SetSeed(3))
    store.dispatch(Undo())
    store.dispatch(SetSeed(4))
    assert not store.can_redo


def test_an_undone_capture_stays_in_the_archive():
    store = Store(Session())
    store.dispatch(StoreCapture("pointer", capture()))
    store.dispatch(Undo())
    assert store.session.captures.pointer is None
    assert [c.ordinal for c in store.session.archive] == [1]


def test_a_refused_message_changes_nothing():
    from rona_core.app.steps.tool.messages import RegisterTool

    store = Store(Session())
    before = store.session
    with pytest.raises(StepBlockedError, match="record the tool motion"):
        store.dispatch(RegisterTool())
    assert store.session is before
    assert not store.can_undo


def test_listeners_see_every_state_once_in_order_and_end_at_the_newest():
    store = Store(Session())
    seen, done = [], threading.Event()

    def listen(old, new):
        seen.append((len(old.log), len(new.log)))
        if len(new.log) == 100:
            done.set()

    store.subscribe(listen)
    threads = [
        threading.Thread(target=lambda: [store.dispatch(SetSeed(i)) for i in range(25)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert done.wait(10)
    assert seen[0][0] == 0
    assert all(a[1] == b[0] for a, b in itertools.pairwise(seen)), "no gap, no overlap"
    assert [e.number for e in store.session.log] == list(range(1, 101))
    store.close()


def test_a_listener_that_fails_does_not_silence_the_others(capsys):
    store = Store(Session())
    heard = threading.Event()

    def fail(old, new):
        raise ValueError("drawing failed")

    store.subscribe(fail)
    store.subscribe(lambda old, new: heard.set())
    store.dispatch(RenameSession("patient 1"))
    assert heard.wait(10)
    assert "drawing failed" in capsys.readouterr().err
    store.close()


def test_a_listener_that_was_removed_is_not_called_again():
    store, removed, heard = Store(Session()), [], threading.Event()
    unsubscribe = store.subscribe(lambda old, new: removed.append(new))
    store.subscribe(lambda old, new: heard.set())
    unsubscribe()
    unsubscribe()  # a second call does nothing
    store.dispatch(RenameSession("patient 1"))
    assert heard.wait(10)  # they are called in the order in which they came
    assert removed == []
    store.close()


def test_what_was_done_again_can_be_taken_back():
    store = Store(Session())
    store.dispatch(SetSeed(3))
    store.dispatch(Undo())
    store.dispatch(Redo())
    assert store.can_undo
    store.dispatch(Undo())
    assert store.session.setup.seed == 0


def test_two_hundred_steps_are_kept():
    assert store_module.UNDO_STEPS == 200


def test_a_closed_store_tells_nobody_anything_and_leaves_no_thread():
    before = set(threading.enumerate())
    store, told = Store(Session()), []
    store.subscribe(lambda old, new: told.append(new))
    store.close()
    store.close()
    store.dispatch(SetSeed(3))
    for thread in set(threading.enumerate()) - before:
        thread.join(5.0)
    assert not told
    assert set(threading.enumerate()) <= before
