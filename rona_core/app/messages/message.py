"""What every message is, and messages as plain values, for the log and for replay.

What every message is: a frozen dataclass of plain values, whose fields state their limits. Lengths
are in millimetres, angles typed by people in degrees, times in seconds.
"""

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar, dataclass_transform

from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.devices.limits import require_limits
from rona_core.devices.settings import STRICT
from rona_core.errors import InvalidInputError
from rona_core.session.captures import Capture
from rona_core.session.codec import decode, digest, encode

T = TypeVar("T")
Point = tuple[float, float, float]


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def message(kind: type[T]) -> type[T]:
    """Make a class a message: frozen, its limits checked first, unknown fields refused in JSON."""
    further: Callable[[T], None] | None = getattr(kind, "__post_init__", None)

    def check(self: T) -> None:
        require_limits(self)
        if further is not None:
            further(self)

    setattr(kind, "__post_init__", check)  # noqa: B010
    setattr(kind, "__pydantic_config__", STRICT)  # noqa: B010
    return dataclass(frozen=True, slots=True)(kind)


def copy_as(kind: type[T], source: object) -> T:
    """Return a value of a dataclass with the values that ``source`` has for its fields."""
    return kind(**values_of(source, kind))


def values_of(source: object, kind: type) -> dict[str, Any]:
    """Return the values that ``source`` has for the fields of a dataclass, by their names."""
    return {part.name: getattr(source, part.name) for part in fields(kind)}


@dataclass(frozen=True, slots=True, eq=False)
class StoreCapture:
    """Something was recorded; it replaces what was recorded before, or is added to it."""

    kind: str  # the name of the capture, as its step declares it
    capture: Capture
    append: bool = False
    file: str | None = None  # name of the one that it came out of


@dataclass(frozen=True, slots=True, eq=False)
class StoreResult:
    """Something was computed: one result or several, each may depend on those before."""

    message: str  # name of the activity that asked for it
    values: Mapping[str, object | None]  # result -> value; None: there is none
    arguments: dict[str, object]  # of that activity
    inputs: Mapping[str, dict[str, str]]  # result -> digests of what it was computed from


@dataclass(frozen=True, slots=True)
class Answer:
    """What an activity found, for who asked; the session does not hold it."""

    value: object


def serialize_arguments(message: Message) -> dict[str, object]:
    """Return the fields of a message as JSON values; of an outcome, what identifies it."""
    if type(message).__name__ in REGISTRY.messages:
        plain = encode(message, "", {})
        plain.pop("$type")
        return plain
    result: dict[str, object] = {}
    for one in dataclasses.fields(message):
        value = getattr(message, one.name)
        if isinstance(value, Mapping):
            held = {name: _identity(item) for name, item in value.items()}
            value = {name: item for name, item in held.items() if item is not None}
            if one.name == "values":
                result[one.name] = value
        elif (plain := _identity(value)) is not None:
            result[one.name] = plain
    return result


def _identity(value: object) -> object:
    """Return what identifies a value: itself, or its digest; None where nothing does."""
    if isinstance(value, bool | int | float | str):
        return value
    if not dataclasses.is_dataclass(value):
        return None
    ordinal = {"ordinal": getattr(value, "ordinal")} if hasattr(value, "ordinal") else {}  # noqa: B009
    return {**ordinal, "digest": digest(value)}


def message_from(name: str, arguments: Mapping[str, object]) -> Message:
    """Return the command or activity of that name with these plain fields.

    A field that is missing has its default: older logs do not know newer fields.

    Raises:
        InvalidInputError: no such message.
        SessionFormatError: a field that it does not know, one without default that is missing, or
            a value that does not fit.
    """
    kind = REGISTRY.messages.get(name)
    if kind is None:
        raise InvalidInputError(f"there is no message {name!r}")
    defaults = {
        one.name: encode(one.default, "", {})
        for one in dataclasses.fields(kind)
        if one.default is not dataclasses.MISSING
    }
    return decode({"$type": name, **defaults, **arguments}, kind, {}, name)
