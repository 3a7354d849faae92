"""Captures that came out of files: they name the digest of the file in place of a set-up."""

import hashlib
from collections.abc import Iterable

from rona_core.session.captures import Capture

IMPORTED = "imported:"


def imported_digest(contents: Iterable[bytes]) -> str:
    """Return what an imported capture holds as the digest of its set-up."""
    hasher = hashlib.sha256()
    for data in contents:
        hasher.update(hashlib.sha256(data).digest())
    return IMPORTED + hasher.hexdigest()


def is_imported(capture: Capture | None) -> bool:
    """Return whether a capture came out of a file: no virtual device knows its truth."""
    return capture is not None and capture.setup_digest.startswith(IMPORTED)
