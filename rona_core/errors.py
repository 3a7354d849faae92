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
└── CancelledError           somebody pressed Cancel or Stop
"""


class RonaError(Exception):
    """Base of all errors that RONA raises on purpose.

    The message says what was expected, what came, and what to do about it.
    """

    code = "rona_error"

    def __init__(self, message: str, **data: object) -> None:
        super().__init__(message)
        self.data = data  # plain values for whoever handles the error


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
    """Somebody pressed Cancel or Stop."""

    code = "cancelled"
