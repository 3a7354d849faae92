"""Reader of numpy arrays without pickles, with bounds on what a header may claim."""

import io
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
MAX_HEADER_BYTES = 4096
MAGIC = b"\x93NUMPY"


def array_header(data: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any], int]:
    """Return shape, order, type and begin of the values of an array by what its file begins with.

    Raises:
        ValueError: no such file, or one whose header cannot be meant.
    """
    stream = io.BytesIO(data)
    try:
        read_header = HEADERS[np.lib.format.read_magic(stream)]
        shape, turned, dtype = read_header(stream, max_header_size=MAX_HEADER_BYTES)
    except Exception as error:  # whatever the parsers throw at what is no header
        raise ValueError("it does not begin as an array of numpy") from error
    if any(n < 0 for n in shape):
        raise ValueError("its header claims a negative size")
    return shape, turned, dtype, stream.tell()


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
