"""Memory of this process: what was freed is the system's again, not kept for later."""

import ctypes


def return_freed_memory() -> None:
    """Return to the system what was freed between what is still held. It takes milliseconds.

    Where the C library is not glibc nothing happens.
    """
    try:
        trim = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):  # another C library, or another system
        return
    trim(0)
