"""Keep the results of an older file valid: what they were computed from has not changed.

A result names its inputs by digests. Where a migration gives an input new fields, its digest is
another one although nothing was measured or computed anew; so each digest is exchanged for the
one that the same content has now. What was stale before stays stale.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session

Stored = Mapping[str, NDArray[Any]]
CAPTURES = ("tool", "pointer", "path", "scan")  # and the strokes over the surface, a tuple


def stored_digests(document: Mapping[str, Any], arrays: Stored) -> dict[str, str]:
    """Return the digest of each result and capture of a document as its own schema had it.

    Args:
        document: The plain values of a session as stored, before any migration.
        arrays: Its arrays by name.
    """
    found: dict[str, str] = {}
    for name, derived in document["results"].items():
        if isinstance(derived, dict):
            where = f"session/results/{name}/value"
            found[f"results/{name}"] = _digest(derived["value"], where, arrays)
    captures = document["captures"]
    for name in CAPTURES:
        if captures[name] is not None:
            where = f"session/captures/{name}"
            found[f"captures/{name}"] = _digest(captures[name], where, arrays)
    strokes = [
        _digest(stroke, f"session/captures/surface/{i}", arrays)
        for i, stroke in enumerate(captures["surface"])
    ]
    found["captures/surface"] = digest(strokes)
    return found


def carry_digests(session: Session, before: Mapping[str, str]) -> Session:
    """Return ``session`` with the digests ``before`` its migration exchanged for those of now."""
    now: dict[str, str] = {}
    for key, old in before.items():
        kind, name = key.split("/")
        value = getattr(getattr(session, kind), name)
        if isinstance(value, Derived):
            now[old] = digest(value.value)
        elif isinstance(value, tuple):
            now[old] = digest([digest(item) for item in value])
        elif value is not None:
            now[old] = digest(value)
    renewed: dict[str, Any] = {}
    for field in fields(session.results):
        derived = getattr(session.results, field.name)
        if derived is not None:
            inputs = {name: now.get(old, old) for name, old in derived.inputs.items()}
            renewed[field.name] = replace(derived, inputs=inputs)
    return replace(session, results=replace(session.results, **renewed))


def _digest(plain: Any, where: str, arrays: Stored) -> str:
    """Return what ``codec.digest`` gave for a value that is stored under the name ``where``."""
    used: dict[str, str] = {}  # name within the value -> name within the file

    def renamed(node: Any) -> Any:
        if isinstance(node, dict):
            if isinstance(node.get("array"), str):
                used[node["array"].removeprefix(where)] = node["array"]
                return {**node, "array": node["array"].removeprefix(where)}
            return {key: renamed(item) for key, item in node.items()}
        return [renamed(item) for item in node] if isinstance(node, list) else node

    text = json.dumps(renamed(plain), sort_keys=True, allow_nan=False)
    hasher = hashlib.sha256(text.encode())
    for name in sorted(used):
        array = np.asarray(arrays[used[name]])
        hasher.update(f"{name}{array.dtype.str}{array.shape}".encode())
        hasher.update(array.tobytes())
    return hasher.hexdigest()
