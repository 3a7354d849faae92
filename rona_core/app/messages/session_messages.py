"""Messages of every session, whatever its steps."""

from rona_core.app.messages.message import message
from rona_core.devices.settings import require


@message
class RenameSession:
    """Give the session another name."""

    name: str

    def __post_init__(self) -> None:
        require(0 < len(self.name.strip()) <= 80, "name must have 1 to 80 characters")


@message
class Undo:
    """Take the last change back."""


@message
class Redo:
    """Do again what was taken back."""


@message
class StartReplay:
    """Compute every result again from the captures and compare; the session stays as it is.

    Results that are stale are left out. What was found is the `result` of the job.
    """
