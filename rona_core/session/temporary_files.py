"""Temporary files beside what they become; a lock tells which of them nobody writes any more."""

import contextlib
import fcntl
import os
import re
import tempfile
from pathlib import Path

SUFFIX = ".part"
MADE = re.compile(r"\..+\.[a-z0-9_]{8}\.part")  # .NAME.RANDOM.part, as they are named here


def lock_file(descriptor: int, *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; False where another holds it, unless told to wait.

    The system lets go when the process ends, however it ends.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def open_temporary(path: Path) -> tuple[int, Path]:
    """Return descriptor and path of a new, locked file beside ``path`` that may become it."""
    while True:
        descriptor, name = tempfile.mkstemp(SUFFIX, f".{path.name}.", path.parent)
        lock_file(descriptor)  # a file system without locks is no reason not to write
        if os.path.exists(name):  # else it was taken for a stale one before it was locked
            return descriptor, Path(name)
        os.close(descriptor)


def remove_stale_temporaries(folder: Path, named: re.Pattern[str] = MADE) -> int:
    """Remove what programs that were killed left half written in ``folder``; return how many.

    Args:
        folder: Where to look; not in folders below it.
        named: Names of temporary files of ours; all others stay.
    """
    removed = 0
    for path in folder.glob(".*"):
        if not named.fullmatch(path.name) or not path.is_file() or path.is_symlink():
            continue
        with contextlib.suppress(OSError):  # one that cannot be removed does no harm
            descriptor = os.open(path, os.O_RDWR)
            try:
                if lock_file(descriptor):  # nobody writes it
                    path.unlink()
                    removed += 1
            finally:
                os.close(descriptor)
    return removed
