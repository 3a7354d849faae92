"""Whether the values of a message have the types that its fields are annotated with, exactly.

Nothing is taken for something else: no text for a number, no 1 for a switch, no 1.0 for a count. A
whole number may stand for a length, and a list for a tuple, as JSON has no other way to say it.
"""

import dataclasses
import sys
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from numbers import Integral, Real
from typing import Any, Literal, Union, cast

from rona_core.app.declarations.declarations import Message
from rona_core.devices.limits import INNER, limits_of
from rona_core.devices.settings import hidden_characters
from rona_core.errors import InvalidInputError

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
    if not isinstance(value, list | tuple):
        return
    items = cast("list[object]", value)
    least, most = words.get("minItems", 0), words.get("maxItems", len(items))
    if not least <= len(items) <= most:
        yield Misfit(path, "list_length", f"{least} to {most} values, not {len(items)}")
        return
    for number, item in enumerate(items if INNER in words else ()):
        yield from _of_length(item, words[INNER], (*path, number))


def _of_tuple(value: object, arguments: tuple[Any, ...], path: Place) -> Iterator[Misfit]:
    if not isinstance(value, list | tuple):
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
