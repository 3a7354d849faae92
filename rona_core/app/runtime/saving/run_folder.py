"""A folder for each running program: its lock shows whether the program still runs."""

import contextlib
import os
import uuid
from collections.abc import Generator
from pathlib import Path

from rona_core.session.files import lock_file, sync_folder

LOCK = "lock"


class RunFolder:
    """A folder of this program alone below ``root``, made when it is first needed.

    The lock in it ends with the process, so that it need not be guessed from the number of a
    process whether that one still runs.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self.path = root / uuid.uuid4().hex[:12]
        self._descriptor: int | None = None

    def claim(self) -> Path:
        """Return the folder, locked; a second call finds it as it is, or makes it anew.

        Raises:
            OSError: no room, or no right to write.
        """
        if self._descriptor is not None and not (self.path / LOCK).exists():
            os.close(self._descriptor)  # it was cleared away meanwhile
            self._descriptor = None
        if self._descriptor is None:
            self._root.mkdir(parents=True, exist_ok=True)
            with _alone(self._root):  # else it might be taken for a dead one before it is locked
                self.path.mkdir(exist_ok=True)
                descriptor = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
                lock_file(descriptor)
                self._descriptor = descriptor
            for folder in (self._root, self._root.parent):  # it outlives the machine too
                sync_folder(folder)
        return self.path

    def release(self) -> None:
        """Let go of the folder, which goes if nothing is in it; a second call does nothing."""
        if self._descriptor is not None:
            with contextlib.suppress(OSError):
                remove_if_empty(self.path)
            os.close(self._descriptor)
            self._descriptor = None


def dead_folders(root: Path) -> tuple[Path, ...]:
    """Return the folders below ``root`` whose program does not run any more.

    Raises:
        OSError: no right to look.
    """
    if not root.is_dir():
        return ()
    with _alone(root):
        return tuple(sorted(f for f in root.iterdir() if f.is_dir() and _is_dead(f)))


def _is_dead(folder: Path) -> bool:
    with _hold(folder) as held:
        return held


@contextlib.contextmanager
def hold(folder: Path) -> Generator[bool, None, None]:
    """Hold a folder whose program has ended; yields False where that or another one has it."""
    with contextlib.ExitStack() as held:
        with _alone(folder.parent):  # else a look whether it is dead may be in the way
            taken = held.enter_context(_hold(folder))
        yield taken


@contextlib.contextmanager
def _hold(folder: Path) -> Generator[bool, None, None]:
    try:
        descriptor = os.open(folder / LOCK, os.O_RDWR)
    except FileNotFoundError:
        yield folder.is_dir()  # of a time without locks
        return
    try:
        yield lock_file(descriptor)
    finally:
        os.close(descriptor)


def remove_if_empty(folder: Path) -> None:
    """Remove a folder with nothing but its lock in it."""
    if {path.name for path in folder.iterdir()} <= {LOCK}:
        (folder / LOCK).unlink(missing_ok=True)
        folder.rmdir()


@contextlib.contextmanager
def _alone(root: Path) -> Generator[None, None, None]:
    """Be the only program that makes or judges folders below ``root``, for a moment."""
    descriptor = os.open(root / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        lock_file(descriptor, wait=True)
        yield
    finally:
        os.close(descriptor)
