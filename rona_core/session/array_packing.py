"""Pack arrays for the file without losing a bit: what the neighbours foretell is not written.

A value is foretold as the one before it along an axis. The remainders are small integers: their
sign moves into the lowest bit, and equal bytes of all values come to lie side by side, where
deflate finds them.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.errors import SessionFormatError

Integers = NDArray[Any]
SMALLEST_BYTES = 512  # smaller arrays are left as they are
AT_ONCE = 65536  # values whose bits are counted at once
DTYPES = tuple(f"<{kind}{size}" for kind in "fiu" for size in (2, 4, 8))


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to unpack an array."""

    dtype: str
    shape: tuple[int, ...]
    axis: int | None = None  # along which differences stand, None for values as they are


def pack(array: NDArray[Any]) -> tuple[NDArray[np.uint8], Recipe] | None:
    """Return the bytes of ``array``, (bytes a value, values), and the recipe that unpacks them.

    None: small arrays and those of single bytes are better left as they are.
    """
    kind = array.dtype.str
    if kind not in DTYPES or array.nbytes < SMALLEST_BYTES:
        return None
    bits = array.view(f"<i{array.itemsize}")
    rest, axis = bits, _best_axis(bits)
    if axis is not None:
        rest = np.diff(bits, axis=axis, prepend=np.zeros_like(bits.take([0], axis=axis)))
    folded = _folded(rest)
    planes = np.ascontiguousarray(folded.reshape(-1, 1).view(np.uint8).T)
    return planes, Recipe(kind, array.shape, axis)


def unpack(stored: NDArray[Any], recipe: Recipe, where: str) -> NDArray[Any]:
    """Return the array that ``pack`` was given, to the bit.

    Raises:
        SessionFormatError: recipe and bytes do not belong together.
    """
    if not _fits(stored, recipe):
        raise SessionFormatError(f"{where}: its bytes are not packed in the way that is said")
    folded = np.array(stored.T, order="C").view(f"<u{recipe.dtype[2]}")
    rest = _unfolded(folded.reshape(recipe.shape))
    if recipe.axis is not None:
        np.add.accumulate(rest, axis=recipe.axis, out=rest)
    return rest.view(recipe.dtype)


def _best_axis(bits: Integers) -> int | None:
    """Return the axis along which differences need the fewest bits, None for no difference."""
    need: dict[int | None, float] = {None: _bits(bits)}
    for axis in range(bits.ndim):
        if bits.shape[axis] > 1:
            need[axis] = _bits(np.diff(bits, axis=axis))
    return min(need, key=lambda axis: need[axis])


def _bits(values: Integers) -> float:
    folded, total = _folded(values).ravel(), 0.0
    for start in range(0, folded.size, AT_ONCE):
        need = folded[start : start + AT_ONCE].astype(np.float64)
        need += 1.0
        total += float(np.log2(need, out=need).sum())
    return total / folded.size


def _folded(values: Integers) -> Integers:
    """Return integers as unsigned ones, sign in the lowest bit: 0, -1, 1, -2 give 0, 1, 2, 3."""
    unsigned = values.dtype.str.replace("i", "u")
    return ((values << 1) ^ (values >> (8 * values.itemsize - 1))).view(unsigned)


def _unfolded(folded: Integers) -> Integers:
    """Return what was folded, in the memory of the folded values."""
    signed = folded.dtype.str.replace("u", "i")
    flips = (folded & 1).view(signed)
    np.negative(flips, out=flips)
    folded >>= 1
    values: Integers = folded.view(signed)
    values ^= flips
    return values


def _fits(stored: NDArray[Any], recipe: Recipe) -> bool:
    shape = recipe.shape
    if recipe.dtype not in DTYPES or not shape or min(shape) < 0:
        return False
    if stored.dtype != np.uint8 or stored.shape != (int(recipe.dtype[2]), math.prod(shape)):
        return False
    return recipe.axis is None or 0 <= recipe.axis < len(shape)
