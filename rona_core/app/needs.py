"""What has to be there before something can be computed."""

from typing import Any

from rona_core.errors import StepBlockedError
from rona_core.session.document import Session
from rona_core.session.specimen import LoadedSkull


def need(value: Any, wanted: str) -> Any:
    """Return ``value``; raise StepBlockedError that says what to do first where it is missing."""
    if value in (None, ()):
        raise StepBlockedError(f"first {wanted}")
    return value


def require_loaded(session: Session) -> LoadedSkull:
    """Return the loaded skull of a session.

    Raises:
        StepBlockedError: a simulated skull lies on the table.
    """
    skull = session.setup.specimen
    if not isinstance(skull, LoadedSkull):
        raise StepBlockedError(
            "the registration of the skull needs a loaded CT, mask or mesh: a simulated skull has "
            "no file to register to; load one in step 1"
        )
    return skull
