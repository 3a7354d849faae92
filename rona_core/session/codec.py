"""Turn frozen dataclasses into plain JSON values and named arrays, and back, by their type hints.

Small arrays stay in the JSON; larger ones are collected under the name of their place.
Nothing is ever pickled: only the classes that the type hints name can come back. The fields of a
part that is declared with ``field(metadata={"flatten": True})`` stand among those of its owner.
"""

import dataclasses
import hashlib
import json
import re
import sys
import types
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any, Literal, Protocol, Union

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.limits import BEFORE
from rona_core.errors import SessionFormatError
from rona_core.geometry.arrays import readonly
from rona_core.session.memo import Memo
from rona_core.session.shapes import check_shapes

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


Arrays = dict[str, NDArray[Any]]
INLINE_SIZE = 16  # arrays up to this many values are written as JSON lists
DTYPE = re.compile(r"[<>|=]?[fiub][0-9]{1,2}")
KINDS = "fiub"  # float, int, unsigned, bool: all that a session may hold
STEP = 2.0**-15  # of a converter with 16 bits; coarser ones give multiples of it
AT_ONCE = 64  # rows of an array that are packed together: all of them take much memory
TYPE_KEY = "$type"
MAY_BE_MISSING = {BEFORE, "omit_empty"}  # in the metadata of a field
OMIT_EMPTY = {"omit_empty": True}  # metadata of a field that is left out while it is empty


class OpenType(Protocol):
    """Hint for a dataclass that is allowed by declaration (`allow_type`), not by a type hint."""


_ALLOWED: dict[str, type] = {}


def allow_type(kind: type) -> None:
    """Let files hold a frozen dataclass where the hint is ``OpenType``."""
    _ALLOWED[kind.__name__] = kind


def encode(value: Any, name: str, arrays: Arrays) -> Any:
    """Return ``value`` as plain JSON values; larger arrays go into ``arrays`` under ``name/…``.

    Raises:
        SessionFormatError: a value of a kind that sessions do not hold.
    """
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return _encode_array(value, name, arrays)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {TYPE_KEY: type(value).__name__, **_encode_fields(value, name, arrays)}
    if isinstance(value, (tuple, list)):
        return [encode(item, f"{name}/{i}", arrays) for i, item in enumerate(value)]
    if isinstance(value, Mapping):
        return {str(key): encode(item, f"{name}/{key}", arrays) for key, item in value.items()}
    raise SessionFormatError(f"{name}: a session cannot hold a {type(value).__name__}")


def _encode_fields(value: Any, name: str, arrays: Arrays) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    for f in dataclasses.fields(value):
        part = getattr(value, f.name)
        if f.metadata.get(FLATTEN):
            fields |= _encode_fields(part, name, arrays)
        elif not _left_out(f, part):
            fields[f.name] = encode(part, f"{name}/{f.name}", arrays)
    return fields


def _left_out(f: "dataclasses.Field[Any]", part: Any) -> bool:
    """Return whether a field has the value that it is given where it is missing."""
    if BEFORE in f.metadata:
        return type(part) is type(f.metadata[BEFORE]) and part == f.metadata[BEFORE]
    return bool(f.metadata.get("omit_empty")) and not isinstance(part, np.ndarray) and not part


def _encode_array(array: NDArray[Any], name: str, arrays: Arrays) -> dict[str, Any]:
    if array.dtype.kind not in KINDS:
        raise SessionFormatError(f"{name}: a session cannot hold arrays of {array.dtype}")
    if array.size <= INLINE_SIZE:
        kind = array.dtype.str
        return {"values": array.ravel().tolist(), "shape": list(array.shape), "dtype": kind}
    packed = _packed(array)
    arrays[name] = np.ascontiguousarray(array if packed is None else packed)
    return {"array": name} if packed is None else {"array": name, "step": STEP}


def _packed(array: NDArray[Any]) -> NDArray[np.int16] | None:
    """Return float32 samples of a converter as int16 in its steps, if that loses no bit."""
    if array.dtype != np.float32:
        return None
    packed = np.zeros(array.shape, dtype=np.int16)
    for start in range(0, len(array), AT_ONCE):
        some = array[start : start + AT_ONCE]
        steps = some / np.float32(STEP)
        small = np.abs(steps) < 2**15
        if not small.all() or (steps != np.rint(steps)).any() or np.signbit(some[some == 0]).any():
            return None
        packed[start : start + AT_ONCE] = steps
    return packed


def decode(data: Any, hint: Any, arrays: Mapping[str, NDArray[Any]], where: str = "session") -> Any:
    """Return the value that ``encode`` wrote, of the type that ``hint`` names.

    A dataclass that stands in ``data`` already made stays as it is.

    Raises:
        SessionFormatError: the data do not fit the type.
    """
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint is object or hint is Any:
        return _decode_plain(data, where)
    if origin in (Union, types.UnionType):
        return _decode_union(data, arguments, arrays, where)
    if origin is Literal:
        return _checked(data in arguments, data, f"one of {arguments}", where)
    if origin is np.ndarray or hint is np.ndarray:
        return _decode_array(data, hint, arrays, where)
    if origin is tuple:
        return _decode_tuple(data, arguments, arrays, where)
    if origin is dict:
        _checked(isinstance(data, dict), data, "an object", where)
        return {k: decode(v, arguments[1], arrays, f"{where}/{k}") for k, v in data.items()}
    if OpenType in getattr(hint, "__mro__", ()):
        named = str(_named(data))
        words = "a type that a step declares (`import rona_core.compose` makes them known)"
        known = _checked(named in _ALLOWED, data, words, where)
        return decode(known, _ALLOWED[named], arrays, where)
    target = origin or hint
    if dataclasses.is_dataclass(target):
        return _decode_dataclass(data, hint, arrays, where)
    if hint is float:
        valid = isinstance(data, int | float) and not isinstance(data, bool)
        _checked(valid and abs(data) <= sys.float_info.max, data, "a finite number", where)
        return float(data)
    if hint is str:
        return _decode_plain(_checked(isinstance(data, str), data, "a text", where), where)
    if hint in (int, bool, type(None)):
        return _checked(type(data) is hint, data, getattr(hint, "__name__", "null"), where)
    raise SessionFormatError(f"{where}: no rule for the type {hint}")


def _named(data: Any) -> Any:
    """Return the name of the class that the data are of; None where they do not tell."""
    made = dataclasses.is_dataclass(data)
    return type(data).__name__ if made else data.get(TYPE_KEY) if isinstance(data, dict) else None


def _checked(valid: bool, data: Any, expected: str, where: str) -> Any:
    if not valid:
        raise SessionFormatError(f"{where}: expected {expected}, found {str(data)[:60]!r}")
    return data


def _decode_plain(data: Any, where: str) -> Any:
    """Return JSON values that any writer of JSON takes: finite numbers, whole characters."""
    if isinstance(data, float):
        _checked(abs(data) <= sys.float_info.max, data, "a finite number", where)
    elif isinstance(data, str):
        whole = not any("\ud800" <= character <= "\udfff" for character in data)
        _checked(whole, ascii(data), "whole Unicode characters", where)
    elif isinstance(data, list):
        for item in data:
            _decode_plain(item, where)
    elif isinstance(data, dict):
        for key, item in data.items():
            _decode_plain(key, where)
            _decode_plain(item, f"{where}/{key}")
    return data


def _decode_union(data: Any, options: tuple[Any, ...], arrays: Any, where: str) -> Any:
    if data is None and type(None) in options:
        return None
    named = _named(data)
    for option in options:
        target = typing.get_origin(option) or option
        if named is not None and getattr(target, "__name__", None) == named:
            return decode(data, option, arrays, where)
    plain = [o for o in options if o is not type(None) and not dataclasses.is_dataclass(o)]
    declared = [o for o in plain if OpenType in getattr(o, "__mro__", ())]
    if declared and named is not None:  # its error says what to import
        return decode(data, declared[0], arrays, where)
    for option in plain:
        try:
            return decode(data, option, arrays, where)
        except SessionFormatError:
            continue
    raise SessionFormatError(f"{where}: expected one of {options}, found {str(data)[:60]!r}")


def _decode_array(
    data: Any, hint: Any, arrays: Mapping[str, NDArray[Any]], where: str
) -> NDArray[Any]:
    _checked(isinstance(data, dict), data, "an array", where)
    if "array" in data:
        name = data["array"]
        if not isinstance(name, str) or name not in arrays:
            raise SessionFormatError(f"{where}: the array {str(name)[:120]!r} is missing")
        array = arrays[name]
        if "step" in data:
            _checked(data["step"] == STEP, data["step"], f"the step {STEP}", where)
            _checked(array.dtype.kind in KINDS, array.dtype, "a numeric array", where)
            array = array.astype(np.float32) * np.float32(STEP)
    else:
        array = _inline(data, where)
    kinds = [typing.get_args(part)[0] for part in typing.get_args(hint)[1:]] or [None]
    wanted = KINDS if kinds[0] is None else np.dtype(kinds[0]).kind
    _checked(array.dtype.kind in wanted, array.dtype, f"an array of kind {wanted}", where)
    return readonly(array) if array.flags.writeable else array


def _inline(data: dict[str, Any], where: str) -> NDArray[Any]:
    """Return a small array that stands in the JSON."""
    kind = data.get("dtype")
    plain = isinstance(kind, str) and DTYPE.fullmatch(kind) is not None
    _checked(plain, kind, "a numeric array", where)
    try:
        return np.array(data["values"], dtype=kind).reshape(data["shape"])
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise SessionFormatError(f"{where}: not an array ({str(error)[:120]})") from error


def _decode_tuple(data: Any, arguments: tuple[Any, ...], arrays: Any, where: str) -> Any:
    _checked(isinstance(data, list), data, "a list", where)
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        hints: tuple[Any, ...] = (arguments[0],) * len(data)
    else:
        hints = arguments
        _checked(len(data) == len(hints), data, f"{len(hints)} values", where)
    pairs = zip(data, hints, strict=True)
    return tuple(decode(d, h, arrays, f"{where}/{i}") for i, (d, h) in enumerate(pairs))


def _decode_dataclass(data: Any, hint: Any, arrays: Any, where: str) -> Any:
    target = typing.get_origin(hint) or hint
    if isinstance(data, target):
        return data
    _checked(isinstance(data, dict), data, target.__name__, where)
    _checked(_named(data) == target.__name__, _named(data), target.__name__, f"{where}/{TYPE_KEY}")
    bound = dict(zip(getattr(target, "__parameters__", ()), typing.get_args(hint), strict=False))
    omitted = {f.name for f in dataclasses.fields(target) if f.metadata.keys() & MAY_BE_MISSING}
    expected = stored_names(target)
    missing, extra = expected - omitted - data.keys(), data.keys() - expected - {TYPE_KEY}
    if missing or extra:
        lacks = f"lacks {', '.join(sorted(missing))}" if missing else ""
        knows = f"does not know {', '.join(sorted(extra))}" if extra else ""
        raise SessionFormatError(
            f"{where}: {target.__name__} {' and '.join(part for part in (lacks, knows) if part)}"
        )
    return _decode_fields(data, target, bound, arrays, where)


def _decode_fields(
    data: dict[str, Any], target: Any, bound: dict[Any, Any], arrays: Any, where: str
) -> Any:
    """Return a dataclass made of the fields of ``data`` that it has, flattened parts included."""
    parts = flattened(target)
    values = {
        f.name: f.metadata[BEFORE] for f in dataclasses.fields(target) if BEFORE in f.metadata
    }
    values |= {
        name: _decode_fields(data, kind, {}, arrays, where)
        if name in parts
        else decode(data[name], bound.get(kind, kind), arrays, f"{where}/{name}")
        for name, kind in field_hints(target).items()
        if name in parts or name in data  # what was left out has its default
    }
    try:
        made = target(**values)
    except ValueError as error:  # InvalidInputError of a __post_init__ among them
        raise SessionFormatError(f"{where}: {error}") from error
    check_shapes(made, where)
    return made


_DIGESTS: Memo[str] = Memo(256)


def digest(value: Any) -> str:
    """Return a sha-256 over every bit of ``value``: equal digests mean equal content.

    Immutable values are hashed once and remembered by identity.
    """
    if dataclasses.is_dataclass(value):
        return _DIGESTS.get((value,), lambda: _digest(value))
    return _digest(value)


def _digest(value: Any) -> str:
    arrays: Arrays = {}
    plain = encode(value, "", arrays)
    hasher = hashlib.sha256(json.dumps(plain, sort_keys=True, allow_nan=False).encode())
    for name in sorted(arrays):
        array = arrays[name]
        hasher.update(f"{name}{array.dtype.str}{array.shape}".encode())
        hasher.update(array.data)
    return hasher.hexdigest()
