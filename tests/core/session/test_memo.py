"""A memo is bounded, locked, goes by identity, and is emptied when a session is closed."""

import threading
from dataclasses import dataclass

import pytest

from rona_core.app.runtime import workbench
from rona_core.compose import new_workbench
from rona_core.session.document import Session
from rona_core.session.memo import Memo, forget_all, remember


@dataclass(frozen=True, slots=True, eq=False)
class Value:
    number: int


def test_it_computes_once_for_the_same_values_and_key():
    memo, calls = Memo(4), []

    def compute():
        calls.append(1)
        return len(calls)

    one, other = Value(1), Value(1)
    assert [memo.get((one,), compute), memo.get((one,), compute)] == [1, 1]
    assert memo.get((other,), compute) == 2
    assert memo.get((one,), compute, key="b") == 3
    assert len(memo) == 3


def test_it_forgets_what_was_not_asked_for_longest():
    memo, values = Memo(2), [Value(i) for i in range(3)]
    for value in (values[0], values[1], values[0], values[2]):
        memo.get((value,), lambda value=value: value.number)
    assert len(memo) == 2
    assert memo.get((values[0],), lambda: -1) == 0
    assert memo.get((values[1],), lambda: -1) == -1


def test_no_other_value_can_take_the_identity_of_one_that_is_remembered():
    memo = Memo(1000)
    found = [memo.get((Value(i),), lambda i=i: i) for i in range(1000)]
    assert found == list(range(1000))


def test_an_error_is_not_remembered():
    memo = Memo(2)
    with pytest.raises(ZeroDivisionError):
        memo.get((), lambda: 1 // 0)
    assert memo.get((), lambda: 5) == 5


def test_a_function_is_remembered_by_its_arguments():
    calls = []

    @remember(2)
    def double(value, *, by=2):
        calls.append(value)
        return value.number * by

    one = Value(3)
    assert [double(one), double(one), double(one, by=3)] == [6, 6, 9]
    assert len(calls) == 2
    forget_all()
    assert double(one) == 6
    assert len(calls) == 3


def test_many_threads_get_what_belongs_to_their_values():
    memo, values, wrong = Memo(8), [Value(i) for i in range(32)], []

    def ask():
        for _ in range(50):
            for value in values:
                if memo.get((value,), lambda value=value: value.number) != value.number:
                    wrong.append(value)

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong
    assert len(memo) <= 8


def test_closing_a_session_empties_every_memo(monkeypatch):
    monkeypatch.setattr(workbench, "forget_all", forget_all)  # other tests keep what they computed
    memo = Memo(2)
    memo.get((Value(1),), lambda: 1)
    new_workbench(Session()).close()
    assert len(memo) == 0
