"""What a loss of power or a bad disk does to a journal, and whether reading it says so."""

import contextlib
import sqlite3
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from rona_core.app.messages.message import serialize_arguments
from rona_core.app.runtime.saving.journal import append_entries, begin_journal, read_journal
from rona_core.app.runtime.store import Store
from rona_core.app.steps.setup.messages import SetSeed
from rona_core.errors import SessionFormatError
from rona_core.session.document import LogEntry, Session
from rona_core.session.files import session_bytes

SECTOR = 512  # bytes that a disk writes or does not
SPILLED = 300_000  # bytes of a row, so that SQLite writes half of it before it is committed
TIME = "2026-01-01T00:00:00.000+00:00"


@dataclass(frozen=True, slots=True)
class Written:
    """A journal as it was written: its file, the one before the last row, and what is in it."""

    path: Path
    data: bytes
    before: bytes
    copy: bytes
    entries: tuple[LogEntry, ...]


def entry(number: int) -> LogEntry:
    """Return a command as the log of a session has it."""
    message = SetSeed(number)
    return LogEntry(number, "SetSeed", serialize_arguments(message), TIME)


def written_journal(folder: Path, rows: int) -> Written:
    """Write a journal of so many commands, row by row."""
    session = Store(Session(name="damaged")).dispatch(SetSeed(0), TIME).session
    path, before = folder / "damaged.journal", b""
    begin_journal(path, session)
    entries = tuple(entry(number) for number in range(2, 2 + rows))
    for each in entries:
        before = path.read_bytes()
        append_entries(path, [each])
    return Written(path, path.read_bytes(), before, session_bytes(session), entries)


def cuts(data: bytes, step: int = 1) -> Iterator[bytes]:
    """Yield every beginning of a file."""
    return (data[:end] for end in range(0, len(data), step))


def flips(data: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Yield a file with one bit turned over, at random places."""
    for bit in np.random.default_rng(seed).integers(8 * len(data), size=count):
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << int(bit % 8)
        yield bytes(changed)


def sectors(data: bytes, before: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Yield a file of which the disk lost sectors: some at random to zeros, or one to what it was.

    Where all that a writing changed is as it was, the file is that of before: a disk that confirms
    what it never writes cannot be found out.
    """
    random = np.random.default_rng(seed)
    places = range(0, len(data), SECTOR)
    old = before.ljust(len(data), b"\0")
    for place in places:
        yield data[:place] + old[place : place + SECTOR] + data[place + SECTOR :]
    for _ in range(count):
        changed = bytearray(data)
        for place, lost in zip(places, random.random(len(places)) < 0.3, strict=True):
            if lost:
                end = min(place + SECTOR, len(data))
                changed[place:end] = bytes(end - place)
        yield bytes(changed)


def half_added(written: Written, folder: Path) -> tuple[bytes, bytes]:
    """Return file and rollback file of a program that was killed while it added a row."""
    path = folder / "half.journal"
    path.write_bytes(written.data)
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.executescript("PRAGMA journal_mode = TRUNCATE; PRAGMA cache_size = 1; BEGIN")
        row = (len(written.entries) + 2, bytes(SPILLED), b"")
        database.execute("INSERT INTO rows VALUES (?, ?, ?)", row)
        database.execute("UPDATE last SET number = number + 1")
        found = path.read_bytes(), path.with_name(f"{path.name}-journal").read_bytes()
        database.execute("ROLLBACK")
    return found


def is_silent(written: Written, data: bytes, rollback: bytes = b"") -> bool:
    """Return whether a damaged journal gives less or something else without a word.

    Args:
        written: What was acknowledged.
        data: Bytes of the file now.
        rollback: Bytes of the rollback file beside it.
    """
    beside = written.path.with_name(f"{written.path.name}-journal")
    written.path.write_bytes(data)
    beside.write_bytes(rollback)
    try:
        found = read_journal(written.path)
    except SessionFormatError:
        return False  # said, and nothing is given
    finally:
        unchanged = written.path.read_bytes() == data and beside.read_bytes() == rollback
    same_copy = session_bytes(found.session) == written.copy
    entries, acknowledged = map(asdict, found.entries), list(map(asdict, written.entries))
    given = list(entries) == acknowledged[: len(found.entries)]
    complete = len(found.entries) == len(acknowledged)
    return not (unchanged and same_copy and given and (complete or found.problem is not None))
