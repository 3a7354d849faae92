"""Reader of numpy arrays without pickles, with bounds on what a header may claim."""

import ast
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"\x93NUMPY"
LENGTHS = {b"\x01\x00": 2, b"\x02\x00": 4}  # version -> bytes that tell the length of the header
MAX_HEADER_BYTES = 4096
KEYS = {"descr", "fortran_order", "shape"}


def array_header(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Return shape, order, type and begin of the values of an array by what its file begins with.

    Raises:
        ValueError: no such file, or one whose header cannot be meant.
    """
    width = LENGTHS.get(bytes(data[6:8]))
    if not data.startswith(MAGIC) or width is None:
        raise ValueError("it does not begin as an array of numpy")
    start = 8 + width
    length = int.from_bytes(data[8:start], "little")
    if length > MAX_HEADER_BYTES or len(data) < start + length:
        raise ValueError("its header is cut off or too long")
    try:
        claimed: Any = ast.literal_eval(data[start : start + length].decode("latin-1").strip())
        shape, turned, descr = claimed["shape"], claimed["fortran_order"], claimed["descr"]
        dtype = np.lib.format.descr_to_dtype(descr)
    except Exception as error:  # whatever the parsers throw at what is no header
        raise ValueError("its header is no plain one") from error
    whole = isinstance(shape, tuple) and all(type(n) is int and n >= 0 for n in shape)
    if set(claimed) != KEYS or not whole or not isinstance(turned, bool):
        raise ValueError("its header is no plain one")
    return shape, turned, dtype, start + length


def array_from_npy(data: bytes) -> NDArray[Any]:
    """Return the array of a file, row by row in memory of its own.

    Its size is compared before memory is taken for it.

    Raises:
        ValueError: damaged, or an array of Python objects.
    """
    shape, turned, dtype, start = array_header(data)
    if dtype.hasobject:
        raise ValueError("it holds Python objects, and allow_pickle is off")
    available, claimed = len(data) - start, math.prod(shape) * dtype.itemsize
    if available != claimed:
        raise ValueError(f"{available} bytes of values instead of {claimed}")
    values = np.frombuffer(data, dtype, offset=start) if claimed else np.zeros(0, dtype)
    return np.array(values.reshape(shape, order="F" if turned else "C"), order="C")
