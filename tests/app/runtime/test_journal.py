"""A journal gives what was acknowledged, or says what of it cannot be read: never less silently.

Whatever a loss of power, a bad disk or a kill in the middle of a row leaves. The damage and the
judge are those of `python -m benchmarks saving`, which tries every byte.
"""

from dataclasses import asdict, replace

import numpy as np
import pytest

from benchmarks.reference.damaged_journals import (
    cuts,
    entry,
    flips,
    half_added,
    is_silent,
    sectors,
    written_journal,
)
from rona_core.app.runtime.saving import journal

ROWS = 5
KINDS = {  # of a journal, and of every how many places one is damaged
    "cut": lambda w, every: cuts(w.data, 41 * every),
    "tail of zeros": lambda w, every: (
        c.ljust(len(w.data), b"\0") for c in cuts(w.data, 83 * every)
    ),
    "grown": lambda w, _: (w.data + bytes(n) for n in (1, 511, 4096, 5000)),
    "bits flipped": lambda w, every: flips(w.data, 600 // every, 1),
    "first page": lambda w, every: high_bits(w.data[:4096], w.data[4096:], every),
    "sectors old or zero": lambda w, every: sectors(w.data, w.before, 200 // every, 2),
}
EVERY = pytest.mark.parametrize("every", [10, pytest.param(1, marks=pytest.mark.slow)])


def high_bits(page, rest, every):
    """Yield a file with one byte of its page made no character: names of tables among them."""
    for place in np.flatnonzero(np.frombuffer(page, np.uint8))[::every]:
        changed = bytearray(page)
        changed[place] ^= 0x80
        yield bytes(changed) + rest


@pytest.fixture
def written(tmp_path):
    return written_journal(tmp_path, ROWS)


def test_a_journal_gives_what_was_written(written):
    assert not is_silent(written, written.data)
    assert journal.read_journal(written.path).problem is None


@EVERY
@pytest.mark.parametrize("kind", KINDS)
def test_no_damage_is_silent_and_none_changes_the_evidence(written, kind, every):
    tried = list(KINDS[kind](written, every))
    assert len(tried) > 3
    assert [n for n, data in enumerate(tried) if is_silent(written, data)] == []


def test_the_judge_sees_a_journal_that_comes_back_shorter_without_a_word(written, monkeypatch):
    """Without the chain of digests, SQLite alone would be silent."""
    monkeypatch.setattr(journal, "_chain", lambda before, number, data: b"")
    blind = written_journal(written.path.parent, ROWS)
    silent = sum(is_silent(blind, data) for data in flips(blind.data, 200, 1))
    assert silent > 0


@EVERY
@pytest.mark.parametrize("rollback", ["whole", "cut", "flipped", "absent"])
def test_a_row_that_was_half_added_is_taken_back_or_it_is_said(written, tmp_path, rollback, every):
    data, beside = half_added(written, tmp_path)
    assert data != written.data
    kinds = {
        "whole": [beside],
        "cut": cuts(beside, 97 * every),
        "flipped": flips(beside, 200 // every, 3),
        "absent": [b""],
    }
    assert not [b for b in kinds[rollback] if is_silent(written, data, b)]
    if rollback == "whole":
        written.path.write_bytes(data)
        found = journal.read_journal(written.path)
        assert (found.problem, len(found.entries)) == (None, ROWS)


def test_rows_are_added_all_or_none(written):
    bad = [entry(ROWS + 2), entry(ROWS + 2)]  # a number twice
    with pytest.raises(journal.sqlite3.Error):
        journal.append_entries(written.path, bad)
    assert not is_silent(written, written.data)
    assert journal.read_journal(written.path).problem is None


def test_a_new_journal_is_not_rolled_back_by_what_the_one_before_left(written, tmp_path):
    data, beside = half_added(written, tmp_path)
    written.path.write_bytes(data)
    written.path.with_name(f"{written.path.name}-journal").write_bytes(beside)
    session = journal.read_journal(written.path).session
    journal.begin_journal(written.path, session)
    found = journal.read_journal(written.path)
    assert (found.entries, found.problem) == ((), None)


def test_a_large_row_is_kept_too(written):
    large = replace(entry(ROWS + 2), arguments={"seed": "x" * 200_000})
    journal.append_entries(written.path, [large])
    assert asdict(journal.read_journal(written.path).entries[-1]) == asdict(large)
    random = np.random.default_rng(4)
    data = bytearray(written.path.read_bytes())
    data[int(random.integers(len(data) - 150_000, len(data)))] ^= 1
    written.path.write_bytes(data)
    assert journal.read_journal(written.path).problem is not None
