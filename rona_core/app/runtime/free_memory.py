"""Memory that was freed goes back to the system, before a step that takes much of it."""

import ctypes
import sys
from functools import cache
from typing import Any


def release_memory() -> None:
    """Give what Python has freed back to the system, where its C library can.

    It lies in pieces between what is held, too small for large arrays: without this a process
    grows by them. It takes some milliseconds, and using the memory again some more.
    """
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim() -> Any:
    """Return ``malloc_trim`` of the C library (glibc), None where there is none."""
    return getattr(ctypes.CDLL(None), "malloc_trim", None) if sys.platform == "linux" else None
