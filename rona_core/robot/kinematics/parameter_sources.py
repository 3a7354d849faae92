"""Where each figure of a robot model comes from, how far to trust it, and how to override it.

A table of rows: the page, the interface and the tests read the same one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats

SAME_TYPE_MM = 3.0  # arms of one type differ by tenths of a millimetre, types by centimetres

Trust = Literal["drawing", "two sources", "one source", "description", "assumed", "given"]


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a model and its origin; joint figures in degrees, joint 1 first."""

    name: str
    key: str  # by which it is overridden; empty where only another description file can
    values: tuple[float, ...]
    unit: str
    trust: Trust
    source: str

    @property
    def sourced(self) -> bool:
        """Whether this figure has a published source."""
        return self.trust not in ("assumed", "given")

    @property
    def override(self) -> str:
        """How to put in another value."""
        if not self.key:
            return "another URDF file"
        shape = "a number" if len(self.values) == 1 else f"{len(self.values)} numbers"
        return f"`{self.key}`: {shape}"


def overridden(
    figures: Sequence[Figure], overrides: Mapping[str, object] | None
) -> tuple[Figure, ...]:
    """Return the figures with given values in place of the defaults.

    Args:
        figures: Rows of the table.
        overrides: A number, or as many numbers as the row has, by the key of the row.

    Raises:
        InvalidInputError: an unknown key, a wrong count, or values that are not finite numbers.
    """
    given = dict(overrides or {})
    known = [figure.key for figure in figures if figure.key]
    unknown = sorted(set(given) - set(known))
    if unknown:
        raise InvalidInputError(
            f"there is no figure {unknown[0]!r} to override; known are {', '.join(known)}"
        )
    return tuple(
        replace(f, values=_numbers(f, given[f.key]), trust="given", source="override")
        if f.key in given
        else f
        for f in figures
    )


def of_one_type(lengths_mm: Sequence[float], others_mm: Sequence[float]) -> bool:
    """Return whether two arms of one build, by their lengths, are of the same type."""
    pairs = zip(lengths_mm, others_mm, strict=True)
    return all(abs(length - other) <= SAME_TYPE_MM for length, other in pairs)


def arrays_of(figures: Sequence[Figure]) -> dict[str, Floats]:
    """Return the values of all figures that have a key, as arrays by key."""
    return {figure.key: np.array(figure.values) for figure in figures if figure.key}


def _numbers(figure: Figure, value: object) -> tuple[float, ...]:
    row = value if isinstance(value, (Sequence, np.ndarray)) else [value]
    if isinstance(row, str) or any(isinstance(number, bool | str) for number in row):
        raise InvalidInputError(f"{figure.key} must be given as {_shape(figure)}, not {value!r}")
    numbers = as_floats(row, name=figure.key)  # type: ignore[arg-type]
    if numbers.shape != (len(figure.values),):
        raise InvalidInputError(
            f"{figure.key} must be given as {_shape(figure)}, not {numbers.size} numbers"
        )
    return tuple(float(number) for number in numbers)


def _shape(figure: Figure) -> str:
    count = len(figure.values)
    return f"a number in {figure.unit}" if count == 1 else f"{count} numbers in {figure.unit}"
