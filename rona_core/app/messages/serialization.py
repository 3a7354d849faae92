"""Messages as plain values, for the log and for replay."""

import dataclasses
from typing import Any

from rona_core.app.messages.registry import ACTIVITIES, COMMANDS
from rona_core.errors import InvalidInputError
from rona_core.session.codec import decode, digest, encode


def plain_arguments(message: Any) -> dict[str, object]:
    """Return the fields of a message as JSON values; of an outcome, what tells it apart."""
    if type(message).__name__ in COMMANDS or type(message).__name__ in ACTIVITIES:
        plain = encode(message, "", {})
        plain.pop("$type")
        return plain
    result: dict[str, object] = {}
    for field in dataclasses.fields(message):
        value = getattr(message, field.name)
        if isinstance(value, bool | int | float | str):
            result[field.name] = value
        elif hasattr(value, "ordinal"):
            result[field.name] = {"ordinal": value.ordinal, "digest": digest(value)}
        elif dataclasses.is_dataclass(value):
            result[field.name] = {"digest": digest(value)}
    return result


def message_from(name: str, arguments: dict[str, Any]) -> Any:
    """Return the command or activity of that name with these plain fields.

    A field that is missing has its default: older logs do not know newer fields.

    Raises:
        InvalidInputError: no such message.
        SessionFormatError: a field that it does not know, one without default that is missing, or
            a value that does not fit.
    """
    kind = COMMANDS.get(name) or ACTIVITIES.get(name)
    if kind is None:
        raise InvalidInputError(f"there is no message {name!r}")
    defaults = {
        field.name: encode(field.default, "", {})
        for field in dataclasses.fields(kind)
        if field.default is not dataclasses.MISSING
    }
    return decode({"$type": name, **defaults, **arguments}, kind, {}, name)
