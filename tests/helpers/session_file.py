"""Sessions through a file, where it is not the file that is tested."""

from rona_core.session.document import Session
from rona_core.session.files import session_bytes, session_from_bytes


def reopened(session: Session) -> Session:
    """Return a session as a file of it gives it back; the file is not packed, to save time."""
    return session_from_bytes(session_bytes(session, quick=True))
