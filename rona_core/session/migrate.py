"""Bring the manifest of an older file to the present schema, one pure function per step."""

from collections.abc import Callable
from typing import Any

from rona_core.errors import SessionFormatError

SCHEMA = 1  # raise it with every change of the document, and add the step below

# MIGRATIONS[n] turns a manifest of schema n into one of schema n + 1.
MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {}


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
