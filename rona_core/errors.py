"""One tree of errors, each with a stable ``code`` that REST, browser and terminal show alike.

RonaError
├── InvalidInputError        (also a ValueError)  wrong shape, range or value from outside
├── DegenerateGeometryError  the data cannot determine the answer
├── NotReachableError        the robot cannot go there
├── DeviceError              a device refused, failed or is not there
├── StepBlockedError         an earlier step is missing
├── StaleResultError         an input has changed since
├── NotFoundError            no session, job, capture or tool of that name
├── NameTakenError           a file of that name is there, and it is not this session's
├── FileChangedError         the file of this session is not the one that it was
├── SessionFormatError       a file is damaged, foreign or newer
├── StorageError             (also an OSError)  the file system refused
└── CancelledError           Cancel or Stop was pressed
"""

import errno
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path


class RonaError(Exception):
    """Base of all errors that RONA raises on purpose.

    The message says what was expected, what came, and what to do about it.
    """

    code = "rona_error"

    def __init__(self, message: str, **data: object) -> None:
        super().__init__(message)
        self.data = data  # plain values for the handler of the error


class InvalidInputError(RonaError, ValueError):
    """A value from outside has the wrong shape, range or type."""

    code = "invalid_input"


class DegenerateGeometryError(RonaError):
    """The data cannot determine the answer (flat motion, one strand of points, ...)."""

    code = "degenerate_geometry"


class NotReachableError(RonaError):
    """The robot cannot go where it was asked to."""

    code = "not_reachable"


class DeviceError(RonaError):
    """A device refused, failed or is not there."""

    code = "device_error"


class StepBlockedError(RonaError):
    """A step was asked for before the one it needs."""

    code = "step_blocked"


class StaleResultError(RonaError):
    """A result was computed from inputs that have changed since."""

    code = "stale_result"


class NotFoundError(RonaError):
    """There is no session, job, capture or tool of that name."""

    code = "not_found"


class NameTakenError(RonaError):
    """A file of that name is there, and it is not the file of this session."""

    code = "name_taken"


class FileChangedError(RonaError):
    """The file of a session was changed by another program since it was opened or saved."""

    code = "file_changed"


class SessionFormatError(RonaError):
    """A session file is damaged, foreign or newer than this program."""

    code = "session_format"


class CancelledError(RonaError):
    """Cancel or Stop was pressed."""

    code = "cancelled"


class StorageError(RonaError, OSError):
    """The file system refused: disk full, no right, read-only, folder gone, ..."""

    code = "storage"


FREE = "free space there, or choose another folder"
RIGHTS = "change the rights, or choose another folder"
REFUSED: Mapping[int, tuple[str, str]] = {  # errno -> cause, what to do
    errno.ENOSPC: ("the disk is full", FREE),
    errno.EDQUOT: ("the disk quota of this user is used up", FREE),
    errno.EFBIG: ("the file would be larger than the system allows", "choose another folder"),
    errno.EROFS: ("the file system is read-only", "choose another folder"),
    errno.EACCES: ("this user has no right to do that", RIGHTS),
    errno.EPERM: ("this user has no right to do that", RIGHTS),
    errno.ENOENT: ("it is not there", "make it, or choose another"),
    errno.ENOTDIR: ("a part of the path is no folder", "choose another folder"),
    errno.EISDIR: ("it is a folder", "choose another name"),
    errno.ENAMETOOLONG: ("the name is too long", "choose a shorter name"),
    errno.EMFILE: ("too many files are open", "close other sessions or programs, and try again"),
    errno.ENFILE: ("too many files are open", "close other sessions or programs, and try again"),
    errno.EIO: ("the disk reports an error", "choose a folder on another disk, and check this one"),
    errno.ESTALE: ("the network drive has gone", "connect it again, or choose another folder"),
}


def storage_error(error: OSError, path: Path | str | None = None) -> StorageError:
    """Return our error for one of the file system, with its cause and what to do.

    Args:
        error: What the system said.
        path: What was to be written or read; the error's own one where it is left out.
    """
    if isinstance(error, StorageError):
        return error
    usual = error.strerror or str(error) or type(error).__name__, "try another folder"
    cause, remedy = REFUSED.get(error.errno or 0, usual)
    named = error.filename if path is None else path
    return StorageError(f"the file system refused{f' {named}' if named else ''}: {cause}; {remedy}")


@contextmanager
def storing(path: Path | str) -> Generator[None]:
    """Have what the file system refuses within the block end in a `StorageError`.

    Raises:
        StorageError: the file system refused.
    """
    try:
        yield
    except OSError as error:
        raise storage_error(error, path) from error
