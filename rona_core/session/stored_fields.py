"""Fields of a dataclass as a session file has them: their types, and the names they stand under."""

import dataclasses
import sys
import typing
from functools import cache
from typing import Any

# in the metadata of a field:
FLATTEN = "flatten"
LEAST = "least"  # bound of an estimate: a value there resolves nothing, and is shown as none


@cache
def field_hints(target: Any) -> dict[str, Any]:
    """Return the type of every field of a dataclass that is given when it is made."""
    hints = typing.get_type_hints(target, vars(sys.modules[target.__module__]))
    return {f.name: hints[f.name] for f in dataclasses.fields(target) if f.init}


def flattened(target: Any) -> set[str]:
    """Return the fields whose own fields stand among those of their owner."""
    return {f.name for f in dataclasses.fields(target) if f.metadata.get(FLATTEN)}


def stored_names(target: Any) -> set[str]:
    """Return the names of the fields under which a dataclass and its flattened parts stand."""
    hints, parts = field_hints(target), flattened(target)
    return (hints.keys() - parts).union(*(stored_names(hints[name]) for name in parts))
