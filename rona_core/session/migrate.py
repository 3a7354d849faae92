"""Bring the manifest of an older file to the present schema, one pure function per step."""

from collections.abc import Callable
from typing import Any

from rona_core.errors import SessionFormatError

SCHEMA = 2  # raise it with every change of the document, and add the step below


def _normals_with_reasons(manifest: dict[str, Any]) -> dict[str, Any]:
    """Schema 1 to 2: a smoothed path says why normals were refused and where they stand.

    Schema 1 kept only paths whose normals were all good, at their kept points alone.
    """
    results = manifest["session"]["results"]
    smoothing = results["smoothing"]
    if smoothing is None:
        return {**manifest, "schema": 2}
    path = smoothing["value"]
    normals = {**path["normals"], "refused": {}, "radii_mm": None, "choice": None}
    smoothing = {
        **smoothing,
        "arguments": {**smoothing["arguments"], "normal_step_mm": 0.0},
        "value": {**path, "normals": normals, "way_points_base": None},
    }
    session = {**manifest["session"], "results": {**results, "smoothing": smoothing}}
    return {**manifest, "schema": 2, "session": session}


# MIGRATIONS[n] turns a manifest of schema n into one of schema n + 1.
MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {1: _normals_with_reasons}


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
