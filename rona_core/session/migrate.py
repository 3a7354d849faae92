"""Bring the manifest of an older file to the present schema, one pure function per step."""

from collections.abc import Callable
from typing import Any

from rona_core.errors import SessionFormatError

SCHEMA = 2  # raise it with every change of the document, and add the step below


def _from_1(manifest: dict[str, Any]) -> dict[str, Any]:
    """Forget the calibration of the pointer, which had no covariance, verdict and reasons.

    They cannot be made up. The captures stay, so the pointer is calibrated again with one click;
    until then everything that was computed with the old tip shows as stale, not as gone.
    """
    session = manifest["session"]
    results = {**session["results"], "pointer": None}
    return {**manifest, "schema": 2, "session": {**session, "results": results}}


# MIGRATIONS[n] turns a manifest of schema n into one of schema n + 1.
MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {1: _from_1}


def migrate(manifest: dict[str, Any]) -> dict[str, Any]:
    """Return ``manifest`` in the present schema.

    Raises:
        SessionFormatError: no schema number, or one that is newer than this program.
    """
    schema = manifest.get("schema")
    if type(schema) is not int or schema < 1:
        raise SessionFormatError(f"the session file names no schema number, but {schema!r}")
    if schema > SCHEMA:
        raise SessionFormatError(
            f"the session file has schema {schema}, this program reads up to {SCHEMA}: "
            f"it was saved by a newer RONA ({manifest.get('app_version', 'unknown')}); update first"
        )
    while schema < SCHEMA:
        manifest = MIGRATIONS[schema](manifest)
        schema += 1
    return manifest
