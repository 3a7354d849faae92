"""Resource folders: static files of the page, demo session, saved sessions.

In a checkout they are the folders ``static/`` and ``sessions/`` at the top of the repository; an
installed wheel carries them as ``rona_ui/_static`` and ``rona_ui/_sessions``.
"""

import contextlib
import os
import secrets
import sys
import tempfile
from pathlib import Path

from rona_core.errors import storing

SECRET_BYTES = 32
PACKAGE = Path(__file__).resolve().parent


def _checkout() -> Path | None:
    """Return the top of the repository, or None when RONA runs from an installed wheel."""
    top = PACKAGE.parent
    return top if (top / "pyproject.toml").is_file() else None


def static_dir() -> Path:
    """Return the folder of the page's static files."""
    top = _checkout()
    return top / "static" if top else PACKAGE / "_static"


def demo_session() -> Path:
    """Return the session file that a new user starts from; treat it as read-only."""
    top = _checkout()
    return (top / "sessions" if top else PACKAGE / "_sessions") / "demo.rona"


def sessions_dir() -> Path:
    """Return the folder where sessions are saved, made if it is missing.

    ``RONA_SESSIONS`` decides where it is set; else it is ``sessions/`` of a checkout, else the
    place the platform keeps a user's data in.
    """
    chosen, top = os.environ.get("RONA_SESSIONS"), _checkout()
    if chosen:
        folder = Path(chosen).expanduser().resolve()
    elif top:
        folder = top / "sessions"
    else:
        folder = _user_data_dir() / "rona" / "sessions"
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return folder


def cookie_secret(sessions: Path) -> bytes:
    """Return 32 random bytes from which the cookies of servers on a sessions folder are made.

    They are stored beside the sessions, for this user alone, so that a page that is open stays
    signed in while its server is started again. Where they cannot be stored they are those of
    one run.
    """
    path = sessions / ".cookie_secret"
    with contextlib.suppress(OSError):
        held = path.read_bytes()
        if len(held) == SECRET_BYTES:
            return held
    made = secrets.token_bytes(SECRET_BYTES)
    with contextlib.suppress(OSError):
        sessions.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=sessions, prefix=".cookie_secret")
        with os.fdopen(descriptor, "wb") as file:
            file.write(made)
        os.replace(name, path)
    return made


def _user_data_dir() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Application Support"
    return Path(os.environ.get("XDG_DATA_HOME", Path.home() / ".local" / "share"))
