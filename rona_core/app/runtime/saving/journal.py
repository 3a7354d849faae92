"""The journal beside a copy: commands that came after it, one line each, to be done again."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.serialization import message_from
from rona_core.app.runtime.session_step import Redo, Undo
from rona_core.app.runtime.store import Store
from rona_core.errors import RonaError
from rona_core.session.codec import decode, encode
from rona_core.session.document import LogEntry
from rona_core.session.message_migration import with_present_message

JOURNAL_SUFFIX = ".jsonl"
MOST_ENTRIES = 64  # then a whole copy is due: doing them again takes time


@dataclass(frozen=True, slots=True)
class Reach:
    """How far commands can be done again from a copy, which knows no steps to take back."""

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


def append_entries(path: Path, entries: Sequence[LogEntry]) -> None:
    """Add lines to a journal; they outlive the process.

    Raises:
        OSError: no room, or no right to write.
    """
    lines = (json.dumps(encode(e, "entry", {}), sort_keys=True, allow_nan=False) for e in entries)
    with path.open("ab") as file:
        file.write("".join(f"{line}\n" for line in lines).encode())


@dataclass(frozen=True, slots=True)
class Journal:
    """What a journal adds to its copy, and what is wrong with the rest of it, if anything."""

    entries: tuple[LogEntry, ...] = ()
    problem: str | None = None


def read_journal(path: Path, after: int) -> Journal:
    """Return what a journal adds to a copy of revision ``after``; nothing where there is none.

    A last line that is not complete was never acknowledged, and is left out. At a line before that
    is damaged, or where one is missing, it ends with a problem.
    """
    if not path.is_file():
        return Journal()
    complete = path.read_bytes().split(b"\n")[:-1]
    found: list[LogEntry] = []
    for number, line in enumerate(complete, 1):
        try:
            plain = with_present_message(json.loads(line))  # an older RONA may have written it
            entry = decode(plain, LogEntry, {}, f"line {number} of its journal")
        except (ValueError, TypeError, RecursionError, RonaError):
            return Journal(tuple(found), f"line {number} of its journal is damaged")
        if entry.number <= after:  # the copy has it: it was written before the journal was cut
            continue
        if entry.number != after + len(found) + 1:
            return Journal(tuple(found), f"change {after + len(found) + 1} is not in its journal")
        found.append(entry)
    return Journal(tuple(found))


def replay_entries(store: Store, entries: Sequence[LogEntry]) -> str | None:
    """Do commands of a journal again, at the times when they were first done.

    Returns:
        None, or which one could not be done; those before it are.
    """
    for entry in entries:
        try:
            store.dispatch(message_from(entry.message, entry.arguments), entry.time_utc)
        except Exception as error:  # a defect of this version too: what came before is recovered
            return f"change {entry.number} ({entry.message}) cannot be done again: {error}"
    return None
