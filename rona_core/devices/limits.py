"""What a field may hold, declared once, as metadata of the field.

The check follows from it, and whatever else must say it (a REST schema, a form) reads it here. The
words are those of JSON Schema for validation, with five of our own: ``label``, ``unit``,
``step`` (of a form; it is not checked), ``above`` (name of another field, and by how much this one
lies above it) and ``rule``, words for what needs several fields and is checked elsewhere.
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
OUR_OWN = ("label", "unit", "step", "above", "rule")
WORDS = frozenset((*OF_NUMBERS, *OF_LISTS, INNER, *OF_TEXTS, *OUR_OWN))
LIMITS = "limits"  # under which the words are in the metadata of a field
ROW = {"minimum": 0, "maximum": 999_999}  # number of a thing that is counted from 0
PLACE = {"minimum": -1e5, "maximum": 1e5}  # coordinate in mm: 100 m, so that nothing overflows

UNIT_QUATERNION = {"minimum": -1.001, "maximum": 1.001, "rule": "of length 1, to 0.001"}


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


def limited(default: Any = MISSING, **words: Any) -> Any:
    """Declare a field of a frozen dataclass with what it may hold.

    Args:
        default: Of the field; without it a value must be given.
        words: Those of ``WORDS``.

    Raises:
        TypeError: no such word.
    """
    if strange := words.keys() - WORDS:
        raise TypeError(f"a field has no {', '.join(sorted(strange))}: {', '.join(sorted(WORDS))}")
    return field(default=default, metadata={LIMITS: words})


def number(
    default: Any,
    label: str,
    unit: str,
    minimum: float,
    maximum: float,
    step: float,
    **words: Any,
) -> Any:
    """Declare a number of the settings as people see it, with its limits, both allowed.

    Args:
        default: Of the field; ``MISSING`` if a value must be given.
        label: What people call it.
        unit: As people write it; empty for a share.
        minimum: Smallest value, of each number where the field has several.
        maximum: Largest value.
        step: From one value to the next in a form.
        words: Further ones of ``WORDS``.
    """
    words |= {"minimum": minimum, "maximum": maximum}
    return limited(default, label=label, unit=unit, step=step, **words)


def like(kind: Any, name: str) -> Any:
    """Declare a field as another dataclass does: the same default, the same limits."""
    part = next(part for part in fields(kind) if part.name == name)
    return field(default=part.default, metadata=part.metadata)


def limits_of(kind: Any) -> dict[str, Mapping[str, Any]]:
    """Return the words that the fields of a dataclass were declared with, by name of the field."""
    return {part.name: part.metadata.get(LIMITS, {}) for part in fields(kind)}


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
            elif "minimum" in words and not isinstance(leaf, bool) and isinstance(leaf, Real):
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
