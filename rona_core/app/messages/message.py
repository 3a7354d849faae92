"""What every message is, its exact types, and messages as plain values for log and replay.

A message is a frozen dataclass of plain values, whose fields state their limits. Lengths are in
millimetres, angles typed by people in degrees, times in seconds. Types are exact: no text for a
number, no 1 for a switch, no 1.0 for a count; but a whole number may stand for a length, and a
list for a tuple, as JSON has no other way to say it.
"""

import dataclasses
import sys
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from numbers import Integral, Real
from typing import Any, Literal, TypeVar, Union, cast, dataclass_transform

from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.registry import REGISTRY
from rona_core.devices.limits import INNER, limits_of, require_limits
from rona_core.devices.settings import STRICT, hidden_characters
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


Place = tuple[str | int, ...]


@dataclasses.dataclass(frozen=True, slots=True)
class Misfit:
    """A place where a value has another type than its field."""

    path: Place  # names of fields and indices of tuples
    code: str  # stable, as the web layer names such errors
    expected: str


def misfits(value: object, hint: Any, path: Place = ()) -> Iterator[Misfit]:
    """Yield where ``value`` does not have the type ``hint``.

    Args:
        value: A message, or the JSON object that it is made from; a field may be missing there.
        hint: A frozen dataclass, or what its fields are annotated with.
        path: Where ``value`` stands.
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (Union, types.UnionType):
        tried = [tuple(misfits(value, option, path)) for option in arguments]
        if all(tried):  # the first option is meant, None is for what is left out
            yield from tried[0]
    elif origin is Literal:
        if not any(type(value) is type(option) and value == option for option in arguments):
            yield Misfit(path, "literal_error", f"one of {', '.join(map(repr, arguments))}")
    elif origin is tuple:
        yield from _of_tuple(value, arguments, path)
    elif dataclasses.is_dataclass(hint):
        yield from _of_fields(value, cast("type", hint), path)
    elif hint is str:
        yield from _of_text(value, path)
    elif hint in _SIMPLE:
        code, expected, fits = _SIMPLE[hint]
        if not fits(value):
            yield Misfit(path, code, expected)
        elif hint is float and not abs(cast("float", value)) <= sys.float_info.max:
            yield Misfit(path, "finite_number", "a finite number")
    else:
        raise TypeError(f"{'/'.join(map(str, path))}: there is no rule for {hint}")


def _is_number(value: object, kind: type) -> bool:
    return isinstance(value, kind) and not isinstance(value, bool)


_SIMPLE: dict[Any, tuple[str, str, Callable[[object], bool]]] = {
    bool: ("bool_type", "true or false", lambda value: isinstance(value, bool)),
    int: ("int_type", "a whole number", lambda value: _is_number(value, Integral)),
    float: ("float_type", "a number", lambda value: _is_number(value, Real)),
    type(None): ("none_required", "nothing", lambda value: value is None),
}


def _of_length(value: object, words: Mapping[str, Any], path: Place) -> Iterator[Misfit]:
    """Yield lists that are longer or shorter than their field may be."""
    if not isinstance(value, (list, tuple)):
        return
    items = cast("list[object]", value)
    least, most = words.get("minItems", 0), words.get("maxItems", len(items))
    if not least <= len(items) <= most:
        yield Misfit(path, "list_length", f"{least} to {most} values, not {len(items)}")
        return
    for number, item in enumerate(items if INNER in words else ()):
        yield from _of_length(item, words[INNER], (*path, number))


def _of_tuple(value: object, arguments: tuple[Any, ...], path: Place) -> Iterator[Misfit]:
    if not isinstance(value, (list, tuple)):
        yield Misfit(path, "tuple_type", "a list")
        return
    items = cast("list[object]", value)
    kinds = arguments
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        kinds = (arguments[0],) * len(items)
    if len(items) != len(kinds):
        yield Misfit(path, "tuple_length", f"{len(kinds)} values, not {len(items)}")
        return
    for number, (item, kind) in enumerate(zip(items, kinds, strict=True)):
        yield from misfits(item, kind, (*path, number))


@cache
def _hints(kind: type) -> dict[str, Any]:
    hints = typing.get_type_hints(kind)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


def _of_fields(value: object, kind: type, path: Place) -> Iterator[Misfit]:
    if isinstance(value, kind):
        held = {name: getattr(value, name) for name in _hints(kind)}
    elif isinstance(value, Mapping):
        held = cast("Mapping[str, object]", value)
    else:
        yield Misfit(path, "dataclass_type", "an object with the fields of " + kind.__name__)
        return
    for name, item in held.items():
        hint = _hints(kind).get(name)
        if hint is None:
            yield Misfit((*path, name), "extra_forbidden", f"no such field of {kind.__name__}")
            continue
        lengths = tuple(_of_length(item, limits_of(kind)[name], (*path, name)))
        yield from lengths or misfits(item, hint, (*path, name))


def _of_text(value: object, path: Place) -> Iterator[Misfit]:
    if not isinstance(value, str):
        yield Misfit(path, "string_type", "text")
    elif hidden := hidden_characters(value):
        codes = ", ".join(sorted(f"U+{ord(character):04X}" for character in hidden))
        yield Misfit(path, "string_hidden", f"text without the hidden characters {codes}")


def require_exact(message: Message) -> None:
    """Raise InvalidInputError unless every field of a message has exactly its type."""
    for found in misfits(message, type(message)):
        where = "".join(f"/{part}" for part in found.path)
        raise InvalidInputError(f"{type(message).__name__} {where}: expected {found.expected}")
