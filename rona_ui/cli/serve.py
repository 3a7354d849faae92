"""``rona serve``: the program for the browser."""

import contextlib
import os
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any, NoReturn

from rona_core.app.runtime.saving.autosave import Recovery
from rona_core.compose import build_registry
from rona_core.errors import InvalidInputError
from rona_ui.resources import sessions_dir
from rona_ui.server import ServerSettings, serve, token_from_environment
from rona_ui.window.window import open_window


def _end(number: int, frame: object) -> None:
    """Leave as after Ctrl-C, so that devices and processes end too."""
    raise KeyboardInterrupt


def _recoverable(folder: Path) -> str:
    """Return a line about what can be recovered; empty where there is nothing."""
    try:
        count = len(Recovery(folder).keys())
    except OSError as error:
        return f"Cannot look for unsaved work: {error}\n"
    if not count:
        return ""
    what = "session was" if count == 1 else "sessions were"
    return (
        f"{count} {what} not saved when the program ended last: the page offers to recover, "
        "and so does rona recover.\n"
    )


def _leave() -> NoReturn:
    """End the process now that everything is closed.

    The interpreter would first wait for every thread that still answers a request, stuck ones too.
    """
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)


def run(wanted: Any) -> NoReturn:
    """Serve until interrupted; the process ends with it."""
    pace = wanted.pace or None
    if pace is not None and not 0.0 < pace <= 1000.0:
        raise InvalidInputError(f"--pace must be 0 to 1000, not {wanted.pace:g}")
    folder = sessions_dir() if wanted.sessions is None else wanted.sessions.expanduser().resolve()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass  # sessions and their copies can be written here
    except OSError as error:
        raise InvalidInputError(
            f"sessions cannot be kept in {folder}: {error.strerror or error}; "
            "choose another folder with --sessions"
        ) from error
    settings = ServerSettings(
        host=wanted.host,
        port=wanted.port,
        sessions=folder,
        allow_hosts=tuple(wanted.allow_host),
        token=None if wanted.no_auth else token_from_environment(),
        open_browser=not wanted.no_open,
        file=wanted.file,
        root_path=wanted.root_path.rstrip("/"),
    )

    def say(url: str) -> None:
        sys.stdout.write(f"RONA is at {url}\nSessions are in {folder}. Ctrl-C ends it.\n")
        sys.stdout.write(_recoverable(folder))
        sys.stdout.flush()

    signal.signal(signal.SIGTERM, _end)
    with contextlib.suppress(KeyboardInterrupt):
        serve(
            settings,
            build_registry=lambda place: build_registry(place, pace=pace),
            open_window=open_window,
            say=say,
        )
    _leave()
