"""Declarations of fields: what each may hold, and what people read about it, as its metadata.

From a declaration follow the check (``require_limits``), the row of a form, the range, title and
description in the REST schema, the option of the command line and the row of ``docs/settings.md``.
The words are those of JSON Schema for validation, with ours: ``label``, ``unit``, ``hint``,
``step`` (of a form; it is not checked), ``labels`` (of the values of a choice), ``offered``
(numbers that a form offers as a choice), ``none`` (what null means), ``percent`` (forms show a
share in per cent), ``above`` (name of another field, and by how much this one lies above it) and
``rule``, words for what needs several fields and is checked elsewhere.
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, field, fields
from numbers import Real
from typing import Any, cast

from rona_core.errors import InvalidInputError

OF_NUMBERS = ("minimum", "maximum")  # of every number in the field, however deep; None may be
OF_LISTS = ("minItems", "maxItems", "uniqueItems")  # of the outermost list
INNER = "items"  # the same words for the lists in that list
OF_TEXTS = ("minLength", "maxLength", "pattern", "enum")  # of every text in the field
OF_PEOPLE = ("label", "unit", "hint", "step", "labels", "offered", "none", "percent")
OUR_OWN = (*OF_PEOPLE, "above", "rule")
WORDS = frozenset((*OF_NUMBERS, *OF_LISTS, INNER, *OF_TEXTS, *OUR_OWN))
LIMITS = "limits"  # under which the words are in the metadata of a field
BEFORE = "before"  # likewise, the value that the field has in session files without it
ROW = (0, 999_999)  # least and largest number of a thing that is counted from 0
PLACE_MM = (-1e5, 1e5)  # of a coordinate: 100 m, so that nothing overflows


def require(condition: bool, message: str) -> None:
    """Raise InvalidInputError with ``message`` unless ``condition`` holds."""
    if not condition:
        raise InvalidInputError(message)


def require_within(name: str, value: float, low: float, high: float) -> None:
    """Raise InvalidInputError unless ``value`` lies between ``low`` and ``high``, both allowed."""
    asked = " to ".join(str(part) if isinstance(part, int) else f"{part:g}" for part in (low, high))
    given = value if isinstance(value, int) else f"{value:g}"
    require(low <= value <= high, f"{name} must be {asked}, not {given}")


def require_unit(name: str, wxyz: Sequence[float]) -> None:
    """Raise InvalidInputError unless a quaternion (4,) has length 1."""
    length = math.hypot(*wxyz)
    require(abs(length - 1.0) <= 1e-3, f"{name} must have length 1, not {length:.4g}")


def limited(default: Any = MISSING, *, before: Any = MISSING, **words: Any) -> Any:
    """Declare a field of a frozen dataclass with what it may hold.

    Args:
        default: Of the field; without it a value must be given.
        before: Value of the field in session files that were saved before it was added.
        words: Those of ``WORDS``.

    Raises:
        TypeError: no such word.
    """
    if strange := words.keys() - WORDS:
        raise TypeError(f"a field has no {', '.join(sorted(strange))}: {', '.join(sorted(WORDS))}")
    added = {} if before is MISSING else {BEFORE: before}
    return field(default=default, metadata={LIMITS: words, **added})


def number(
    default: Any,
    label: str,
    unit: str,
    minimum: float,
    maximum: float,
    step: float,
    **words: Any,
) -> Any:
    """Declare a number with its limits, both allowed.

    Args:
        default: Of the field; ``MISSING`` if a value must be given.
        label: What people call it.
        unit: As people write it; empty for a share or a count.
        minimum: Smallest value, of each number where the field has several.
        maximum: Largest value.
        step: From one value to the next in a form.
        words: Further ones of ``WORDS``, as ``hint``: what it means, beyond its label; and
            ``before`` of ``limited``.
    """
    words = {"hint": "", "minimum": minimum, "maximum": maximum, "step": step, **words}
    return limited(default, label=label, unit=unit, **words)


def quaternion(default: Any, label: str, rule: str = "") -> Any:
    """Declare a unit quaternion wxyz, whose length ``require_unit`` checks."""
    words = {"rule": "; ".join(filter(None, ("of length 1, to 0.001", rule)))}
    return number(default, label, "", -1.001, 1.001, 0.001, **words)


def choice(
    default: Any, label: str, labels: Mapping[Any, str], hint: str = "", **words: Any
) -> Any:
    """Declare a text that is one of several.

    Args:
        default: Of the field; ``MISSING`` if a value must be given.
        label: What people call it.
        labels: What people call each value, in the order of a form.
        hint: What it means, beyond its label.
        words: Further ones of ``WORDS``, as ``none``.
    """
    words = {"hint": hint, "labels": labels, "enum": tuple(labels), **words}
    return limited(default, label=label, **words)


def switch(default: bool, label: str, hint: str = "") -> Any:
    """Declare a truth value by what people call it, and what it means where it is true."""
    return limited(default, label=label, hint=hint)


def like(kind: Any, name: str, *, required: bool = False) -> Any:
    """Declare a field as another dataclass does; with its default, unless a value is required."""
    part = next(part for part in fields(kind) if part.name == name)
    return field(default=MISSING if required else part.default, metadata=part.metadata)


def limits_of(kind: Any) -> dict[str, Mapping[str, Any]]:
    """Return the words that the fields of a dataclass were declared with, by name of the field."""
    return {part.name: part.metadata.get(LIMITS, {}) for part in fields(kind)}


def heading(words: Mapping[str, Any]) -> str:
    """Return what people call a declared field, with its unit where it is a number."""
    unit = "%" if words.get("percent") else words.get("unit")
    return f"{words['label']} ({unit})" if unit and "offered" not in words else words["label"]


def meaning(words: Mapping[str, Any]) -> str:
    """Return what a declared field means, and what it must hold beyond its range, in sentences."""
    said = [words.get("hint", "")]
    if "none" in words:
        said.append(f"Null: {words['none']}")
    if "above" in words:
        other, gap = words["above"]
        said.append(f"At least {gap:g} above `{other}`")
    said.append(words.get("rule", ""))
    return ". ".join(part[:1].upper() + part[1:] for part in said if part)


def label_of_value(source: object, name: str) -> str:
    """Return what people call the value of a choice that a dataclass holds."""
    return limits_of(type(source))[name]["labels"][getattr(source, name)]


def range_of(kind: Any, name: str) -> tuple[float, float]:
    """Return the smallest and the largest value that a field of a dataclass may have."""
    words = limits_of(kind)[name]
    return words["minimum"], words["maximum"]


def require_limits(value: Any) -> None:
    """Raise InvalidInputError unless every field of a dataclass holds what it was declared with.

    What is of another type is left to who looks at types.
    """
    for name, words in limits_of(value).items():
        held = getattr(value, name)
        if isinstance(held, tuple):
            _require_length(name, cast("tuple[object, ...]", held), words)
        for leaf in _leaves(held) if words else ():
            if isinstance(leaf, str):
                _require_text(name, leaf, words)
            elif "minimum" in words and isinstance(leaf, bool):
                raise InvalidInputError(f"{name} must be a number, not {leaf}")
            elif "minimum" in words and isinstance(leaf, Real):
                _require_number(name, cast("float", leaf), words, value)


def _leaves(held: object) -> Iterator[object]:
    """Yield what a field holds; of a tuple what is in it, however deep. None is nothing."""
    if isinstance(held, tuple):
        for item in cast("tuple[object, ...]", held):
            yield from _leaves(item)
    elif held is not None:
        yield held


def _require_length(name: str, held: tuple[object, ...], words: Mapping[str, Any]) -> None:
    least, most = words.get("minItems", 0), words.get("maxItems", len(held))
    asked = f"at most {most}" if least == 0 else f"{least} to {most}"
    require(least <= len(held) <= most, f"{name} must have {asked} values, not {len(held)}")
    if words.get("uniqueItems"):
        require(len(set(held)) == len(held), f"{name} must have each value once only")
    for item in held if INNER in words else ():
        _require_length(f"each of {name}", cast("tuple[object, ...]", item), words[INNER])


def _require_number(name: str, held: float, words: Mapping[str, Any], whole: Any) -> None:
    low, high = words["minimum"], words["maximum"]
    if "above" in words:
        other, gap = words["above"]
        low = max(low, getattr(whole, other) + gap)
    require_within(name, held, low, high)


def _require_text(name: str, held: str, words: Mapping[str, Any]) -> None:
    least, most = words.get("minLength", 0), words.get("maxLength", len(held))
    fits = least <= len(held) <= most and re.fullmatch(words.get("pattern", r"[\s\S]*"), held)
    asked = words.get("rule", f"text of {least} to {most} characters")
    if "enum" in words:
        fits, asked = held in words["enum"], f"one of {', '.join(words['enum'])}"
    require(bool(fits), f"{name} must be {asked}, not {held[:60]!r}")
