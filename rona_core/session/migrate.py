"""Bring the manifest of an older file to the present schema, one pure function per step."""

from collections.abc import Callable
from typing import Any

from rona_core.errors import SessionFormatError

SCHEMA = 2  # raise it with every change of the document, and add the step below


def _simplified_path_2(manifest: dict[str, Any]) -> dict[str, Any]:
    """Tell of a smoothed path what schema 1 did not: method "optimal" asked for Fréchet."""
    results = manifest["session"].get("results") or {}
    smoothing = results.get("smoothing")
    if smoothing is None:
        return manifest
    old = smoothing["value"]["simplified"]
    exact = old["method"] == "optimal"
    new = {
        **old,
        "frechet": exact,
        "closed": False,
        "lower_bound": 2,
        "exact": exact,
        "rule": f"{old['method']}, as written by schema 1",
    }
    value = {**smoothing["value"], "simplified": new}
    results = {**results, "smoothing": {**smoothing, "value": value}}
    return {**manifest, "session": {**manifest["session"], "results": results}}


# MIGRATIONS[n] turns a manifest of schema n into one of schema n + 1.
MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {1: _simplified_path_2}


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
