"""Names of files that come from outside: plain ones, without a path in them."""

from rona_core.errors import InvalidInputError

MAX_NAME_BYTES = 200  # file systems take 255; temporary and backup files add to a name


def plain_name(name: str) -> str:
    """Return ``name`` if it is a plain file name.

    Raises:
        InvalidInputError: empty, hidden, too long, or with a path or a control character in it.
    """
    control = any(ord(character) < 32 or ord(character) == 127 for character in name)
    if not name or name.startswith(".") or "/" in name or "\\" in name or control:
        raise InvalidInputError(f"expected a plain file name, got {name[:60]!r}")
    if len(name.encode()) > MAX_NAME_BYTES:
        raise InvalidInputError(
            f"a file name may have {MAX_NAME_BYTES} bytes, not {len(name.encode())}: shorten it"
        )
    return name


def stem_of(title: str) -> str:
    """Return a plain file name without suffix that resembles ``title``."""
    kept = "".join(c if c.isalnum() or c in "-_ " else "_" for c in title)
    return kept.encode()[: MAX_NAME_BYTES - 20].decode(errors="ignore").strip() or "untitled"
