"""Serialization: messages as plain values, for the log and for replay."""

import dataclasses
from collections.abc import Mapping

from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.errors import InvalidInputError
from rona_core.session.codec import decode, digest, encode


def serialize_arguments(message: Message) -> dict[str, object]:
    """Return the fields of a message as JSON values; of an outcome, what identifies it."""
    if type(message).__name__ in REGISTRY.messages:
        plain = encode(message, "", {})
        plain.pop("$type")
        return plain
    result: dict[str, object] = {}
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, Mapping):
            held = {name: _identity(item) for name, item in value.items()}
            value = {name: item for name, item in held.items() if item is not None}
            if field.name == "values":
                result[field.name] = value
        elif (plain := _identity(value)) is not None:
            result[field.name] = plain
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
        field.name: encode(field.default, "", {})
        for field in dataclasses.fields(kind)
        if field.default is not dataclasses.MISSING
    }
    return decode({"$type": name, **defaults, **arguments}, kind, {}, name)
