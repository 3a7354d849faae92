"""What every message is: a frozen dataclass of plain values, whose fields state their limits.

Lengths are in millimetres, angles typed by people in degrees, times in seconds.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, TypeVar, dataclass_transform

from rona_core.devices.limits import require_limits
from rona_core.devices.settings import STRICT
from rona_core.session.captures import Capture

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
