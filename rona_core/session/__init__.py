"""The session document, its codec and its file."""

from rona_core.session.codec import digest
from rona_core.session.document import Session, Setup
from rona_core.session.files import load_session, save_session

__all__ = [
    "Session",
    "Setup",
    "digest",
    "load_session",
    "save_session",
]
