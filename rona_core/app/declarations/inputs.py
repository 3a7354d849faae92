"""Inputs of results: what is read of a session, and the classes of values that derivations take.

Only a declaration reads the session. A derivation takes a class of values (`inputs`), each of which
is present, fresh and usable; an optional one may be None or ().
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType, NoneType
from typing import (
    Generic,
    TypeVar,
    dataclass_transform,
    get_args,
    get_origin,
    get_type_hints,
)

from rona_core.errors import InvalidInputError
from rona_core.session.document import Session

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)
_GIVEN, _PARTS = "given", "__input_parts__"


@dataclass(frozen=True, slots=True)
class Input(Generic[T_co]):
    """One thing that a result is computed from, or a message needs."""

    read: Callable[[Session], T_co | None]  # None or () while it is missing, or not usable
    wanted: str | None  # what to do to get it; None: as the result or capture declares
    upstream: str | None = None  # the result or capture ("capture scan") that may itself be stale
    optional: bool = False  # the result can do without it
    takes_bad: bool = False  # a bad one will do, as long as ``read`` finds a value
    # what is digested where that is not the value: what is held, though it is not usable now
    counts: Callable[[Session], object] | None = None
    title: str = ""  # "the scan speed (step 1)"; "": that of ``upstream`` or ``part``
    part: str = ""  # the result or capture that is read, where it is not ``upstream``

    def counted(self, session: Session) -> object:
        """Return what is digested of it."""
        return (self.counts or self.read)(session)


def is_missing(value: object) -> bool:
    """Return whether a value that was read is missing: None or an empty tuple."""
    return value is None or (isinstance(value, tuple) and not value)


@dataclass(frozen=True, slots=True)
class Quantity(Generic[T_co]):
    """A value computed from inputs wherever it is read, and never stored.

    What is computed from it is computed from its inputs: each counts under its key.
    """

    compute: Callable[..., T_co | None]  # pure; takes the parts in their order
    parts: "Mapping[str, Input[object] | Quantity[object]]"
    optional: bool = False  # None is an answer, too

    def read(self, session: Session) -> T_co | None:
        """Return the value; None while an input that it needs is missing."""
        values: list[object] = []
        for part in self.parts.values():
            values.append(part.read(session))
            if is_missing(values[-1]) and not part.optional:
                return None
        return self.compute(*values)

    def inputs(self) -> "dict[str, Input[object]]":
        """Return the inputs that it is computed from, by key, those of its quantities too."""
        found: dict[str, Input[object]] = {}
        for key, part in self.parts.items():
            _add(found, {key: part} if isinstance(part, Input) else part.inputs())
        return found


def _add(found: "dict[str, Input[object]]", more: "Mapping[str, Input[object]]") -> None:
    """Add inputs by key; raise InvalidInputError for two under one key, or one under two."""
    for key, item in more.items():
        keys = [k for k, held in found.items() if held is item and k != key]
        if keys or found.setdefault(key, item) is not item:
            raise InvalidInputError(f"two inputs under the key {key!r}, or one under {keys}")


@dataclass(frozen=True, slots=True)
class _Given:
    """Declaration of a field of a class of inputs."""

    item: Input[object] | Quantity[object]
    key: str
    renamed: Mapping[str, str]

    def inputs(self) -> dict[str, Input[object]]:
        if isinstance(self.item, Input):
            return {self.key: self.item}
        return {self.renamed.get(key, key): item for key, item in self.item.inputs().items()}


def given(
    item: Input[T] | Quantity[T],
    key: str = "",
    renamed: Mapping[str, str] = MappingProxyType({}),
) -> T:
    """Declare a field of a class of inputs.

    Args:
        item: What the field holds. An optional one may be None or ().
        key: Under which an input is digested. The inputs of a quantity have their own.
        renamed: Other keys for inputs of a quantity.
    """
    return field(metadata={_GIVEN: _Given(item, key, renamed)})


@dataclass_transform(frozen_default=True, field_specifiers=(given,))
def inputs(
    *, implied: tuple[str, ...] = (), free: tuple[str, ...] = ()
) -> Callable[[type[T]], type[T]]:
    """Make a class the values that a derivation takes, each declared by `given`.

    Every input is digested, but for two kinds.

    Args:
        implied: Keys of inputs that cannot change without a digested one, or what it rests on.
        free: Keys of inputs whose change leaves the result as it counts.

    Raises:
        InvalidInputError: two inputs under one key, or a key that no input has.
    """

    def declare(kind: type[T]) -> type[T]:
        made = dataclass(frozen=True, slots=True, eq=False)(kind)
        found: dict[str, Input[object]] = {}
        hints = get_type_hints(made)
        for name, part in _given_fields(made).items():
            _add(found, part.inputs())
            if part.item.optional and not _may_be_missing(hints[name]):
                raise InvalidInputError(f"{kind.__name__}.{name} may be missing, its type says not")
        if unknown := {*implied, *free} - found.keys():
            raise InvalidInputError(f"{kind.__name__} has no inputs {sorted(unknown)}")
        if "" in found:
            raise InvalidInputError(f"{kind.__name__} has an input without a key")
        counted = {k: item for k, item in found.items() if k not in (*implied, *free)}
        parts = InputParts(counted, {k: found[k] for k in implied}, {k: found[k] for k in free})
        setattr(made, _PARTS, parts)
        return made

    return declare


def _given_fields(kind: type) -> dict[str, _Given]:
    return {part.name: part.metadata[_GIVEN] for part in fields(kind)}


def _may_be_missing(hint: object) -> bool:
    return get_origin(hint) is tuple or NoneType in get_args(hint)


@dataclass(frozen=True, slots=True)
class InputParts:
    """The inputs of a class of inputs, by key."""

    counted: Mapping[str, Input[object]]  # digested
    implied: Mapping[str, Input[object]]
    free: Mapping[str, Input[object]]


def input_parts(kind: type) -> InputParts:
    """Return the inputs of a class of inputs.

    Raises:
        InvalidInputError: it is none.
    """
    found = getattr(kind, _PARTS, None)
    if found is None:
        raise InvalidInputError(f"a derivation takes a class of inputs, not {kind.__name__}")
    return found


def handed_items(kind: type) -> dict[str, "Input[object] | Quantity[object]"]:
    """Return what each field of a class of inputs is read from."""
    return {name: part.item for name, part in _given_fields(kind).items()}
