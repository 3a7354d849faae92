"""The journal of a session: a whole copy of it, and the commands since; a database of SQLite.

The copy is the first row, each command another one. The chain digest of a row covers all rows
before it, and one more table has the chain digest of the last: a row that is damaged, missing or
of another time is noticed wherever it stood.
"""

import contextlib
import hashlib
import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import message_from
from rona_core.app.runtime.session_step import Redo, Undo
from rona_core.app.runtime.store import Store
from rona_core.errors import RonaError, SessionFormatError
from rona_core.session.codec import decode, encode
from rona_core.session.document import LogEntry, Session
from rona_core.session.files import (
    move_whole,
    open_temporary,
    session_bytes,
    session_from_bytes,
)

JOURNAL_SUFFIX = ".journal"
ROLLBACK_SUFFIX = "-journal"  # of SQLite's own file beside it, in use while a row is added
MOST_ENTRIES = 64  # then a whole copy is due: doing them again takes time
# what the library raises for a damaged file; a ValueError where a name in it is no text any more
UNREADABLE = (sqlite3.Error, ValueError, MemoryError)
TABLES = """
CREATE TABLE rows (number INTEGER PRIMARY KEY, data BLOB NOT NULL, chain BLOB NOT NULL);
CREATE TABLE last (number INTEGER NOT NULL, chain BLOB NOT NULL);
"""


@dataclass(frozen=True, slots=True)
class Reach:
    """How far commands can be done again from a copy, which has no steps to take back."""

    n_entries: int = 0
    undo: int = 0  # steps since the copy that can be taken back
    redo: int = 0  # and those that can be done again then

    def after(self, entries: Sequence[LogEntry]) -> "Reach | None":
        """Return the reach after these entries too; None where only a whole copy would hold them.

        That is what a device or a long computation produced, and what takes back more than was
        done since the copy.
        """
        undo, redo = self.undo, self.redo
        for entry in entries:
            if entry.message == Undo.__name__:
                undo, redo = undo - 1, redo + 1
            elif entry.message == Redo.__name__:
                undo, redo = undo + 1, redo - 1
            elif entry.message in REGISTRY.command_types:
                undo, redo = undo + 1, 0
            else:
                return None
            if undo < 0 or redo < 0:
                return None
        count = self.n_entries + len(entries)
        return Reach(count, undo, redo) if count <= MOST_ENTRIES else None


@dataclass(frozen=True, slots=True)
class Journal:
    """What a journal holds, and what of it cannot be read, if anything."""

    session: Session  # the copy
    entries: tuple[LogEntry, ...] = ()  # the commands since
    problem: str | None = None


def begin_journal(path: Path, session: Session) -> None:
    """Write a journal with a copy of ``session`` and no commands, in the place of what was there.

    Raises:
        OSError: no space, or no right to write; what was there stays.
        sqlite3.Error: likewise.
        SessionFormatError: the session holds more than a file may hold.
    """
    number, data = len(session.log), session_bytes(session, quick=True)
    chain = _chain(b"", number, data)
    descriptor, temporary = open_temporary(path)
    try:
        with contextlib.closing(sqlite3.connect(temporary, isolation_level=None)) as database:
            database.executescript(f"PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF; {TABLES}")
            database.execute("INSERT INTO rows VALUES (?, ?, ?)", (number, data, chain))
            database.execute("INSERT INTO last VALUES (?, ?)", (number, chain))
        os.fsync(descriptor)
        _rollback_of(path).unlink(missing_ok=True)  # what is in it is of the one that goes
        move_whole(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    finally:
        os.close(descriptor)


def append_entries(path: Path, entries: Sequence[LogEntry]) -> None:
    """Add commands to a journal, all or none; on return they outlive process and machine.

    Raises:
        sqlite3.Error: it is not there or damaged, no space, or no right to write.
    """
    with contextlib.closing(_connect(path, "mode=rw")) as database:
        database.executescript("PRAGMA journal_mode = TRUNCATE; PRAGMA synchronous = FULL")
        database.execute("BEGIN IMMEDIATE")
        (chain,) = database.execute("SELECT chain FROM last").fetchone()
        for entry in entries:
            data = json.dumps(encode(entry, "entry", {}), sort_keys=True, allow_nan=False).encode()
            chain = _chain(chain, entry.number, data)
            database.execute("INSERT INTO rows VALUES (?, ?, ?)", (entry.number, data, chain))
        database.execute("UPDATE last SET number = ?, chain = ?", (entries[-1].number, chain))
        database.execute("COMMIT")


def read_journal(path: Path) -> Journal:
    """Return what a journal holds up to the first row that is not as it was written.

    The files are not changed. A command whose writing did not end was never acknowledged, and is
    left out.

    Raises:
        SessionFormatError: the copy in it cannot be read.
    """
    rows, last, trouble = _read_rows(path)
    chain, good = b"", list[tuple[int, bytes]]()
    for number, data, stored in rows:
        follows = not good or number == good[-1][0] + 1
        if not (follows and isinstance(data, bytes) and _chain(chain, number, data) == stored):
            trouble = trouble or "its digest does not fit"
            break
        chain = stored
        good.append((number, data))
    if not good:
        why = trouble or "it holds no copy"
        raise SessionFormatError(f"{path.name} is not a readable journal: {why}; it stays there")
    session = session_from_bytes(good[0][1], f"the copy in {path.name}")
    entries: list[LogEntry] = []
    for number, data in good[1:]:
        try:
            entry = decode(json.loads(data), LogEntry, {}, f"change {number} of its journal")
            entries.append(entry)
        except (ValueError, TypeError, RecursionError, RonaError) as error:
            problem = f"change {number} and those after it cannot be read: {error}"
            return Journal(session, tuple(entries), problem)
    complete = last is not None and last[1] == chain
    problem = None if complete else _missing(good[-1][0], last, trouble)
    return Journal(session, tuple(entries), problem)


def _missing(read: int, last: tuple[Any, Any] | None, trouble: str | None) -> str:
    """Return words for what a journal held beyond change ``read``, as far as that can be said."""
    written = 0 if last is None else last[0]
    damage = f"its journal is damaged ({trouble or 'its end does not fit'})"
    if isinstance(written, int) and read < written <= read + MOST_ENTRIES:
        lost = f"change {written}" if written == read + 1 else f"changes {read + 1} to {written}"
        return f"{damage}: {lost} cannot be read"
    return f"{damage}: change {read} is the last that can be read, later ones may be missing"


def _read_rows(path: Path) -> tuple[list[tuple[Any, ...]], tuple[Any, Any] | None, str | None]:
    """Return all rows that SQLite reads, the record of the last, and its error where it stops."""
    rows: list[tuple[Any, ...]] = []
    last, trouble = None, None
    try:
        with _unchanged(path) as database:
            try:
                last = database.execute("SELECT number, chain FROM last").fetchone()
            except UNREADABLE as error:  # the rows may be whole
                trouble = str(error)
            found = database.execute("SELECT number, data, chain FROM rows ORDER BY number")
            rows.extend(found)  # those before an error stay
    except UNREADABLE as error:
        trouble = str(error)
    return rows, last, trouble


@contextlib.contextmanager
def _unchanged(path: Path) -> Generator[sqlite3.Connection, None, None]:
    """Open a journal so that its files stay as they are.

    Where a program was killed while it added a row, SQLite takes the half of it back: in a copy.
    """
    rollback = _rollback_of(path)
    with contextlib.ExitStack() as held:
        mode = "immutable=1"
        if rollback.is_file() and rollback.stat().st_size > 0:
            folder = Path(held.enter_context(tempfile.TemporaryDirectory()))
            shutil.copyfile(rollback, _rollback_of(folder / path.name))
            path, mode = Path(shutil.copyfile(path, folder / path.name)), "mode=rw"
        yield held.enter_context(contextlib.closing(_connect(path, mode)))


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    place = f"file:{quote(str(path.absolute()))}?{mode}"
    database = sqlite3.connect(place, uri=True, isolation_level=None)
    database.text_factory = bytes  # a damaged one need not be text
    return database


def _rollback_of(path: Path) -> Path:
    return path.with_name(path.name + ROLLBACK_SUFFIX)


def remove_journal(path: Path) -> None:
    """Remove a journal, if there is one."""
    path.unlink(missing_ok=True)
    _rollback_of(path).unlink(missing_ok=True)


def _chain(before: bytes, number: Any, data: bytes) -> bytes:
    """Return the chain digest of a row after the one whose chain digest is ``before``."""
    return hashlib.sha256(b"%b%s\n%b" % (before, str(number).encode(), data)).digest()


def restore(store: Store, journal: Journal) -> str | None:
    """Do the commands of a journal again, at the times when they were first done.

    Returns:
        None, or what could not be read or done again; what comes before it is restored.
    """
    for entry in journal.entries:
        try:
            store.dispatch(message_from(entry.message, entry.arguments), entry.time_utc)
        except Exception as error:  # a defect of this version too: what came before is recovered
            return f"change {entry.number} ({entry.message}) cannot be done again: {error}"
    return journal.problem
