"""Size limits for files from outside: what a file claims is checked first.

Unpacking goes in steps and is counted, so that a small file cannot fill the memory.
"""

import io
import lzma
import stat
import struct
import zipfile
import zlib
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from rona_core.errors import InvalidInputError

MAX_FILE_BYTES = 512 * 1024**2
MAX_DIRECTORY_BYTES = 4 * 1024**2  # of a zip: names and sizes of its members
CHUNK = 1 << 20
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
START_OF_ZIP = b"PK\x03\x04"
END_OF_ZIP, END_OF_ZIP_SIZE = b"PK\x05\x06", 22
LOCATOR_64, LOCATOR_64_SIZE = b"PK\x06\x07", 20
LONGEST_COMMENT = 65_536
# whatever zipfile throws at damaged files; InvalidInputError, a ValueError, is let through first
DAMAGED = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    OSError,
    RuntimeError,
    ValueError,
    LookupError,
    OverflowError,
)


def read_file(path: Path, expected: str, most_bytes: int = MAX_FILE_BYTES) -> bytes:
    """Return the contents of a plain file; pipes and devices are not opened, they may never end.

    Args:
        path: Of the file.
        expected: What the file should be, for the message.
        most_bytes: Largest file that is read.

    Raises:
        InvalidInputError: it is not there, a folder, a pipe or a device, or too large.
    """
    with open_file(path, expected, most_bytes) as file:
        return file.read(most_bytes)


@contextmanager
def open_file(path: Path, expected: str, most_bytes: int = MAX_FILE_BYTES) -> Generator[BinaryIO]:
    """Open a plain file for reading; arguments and errors as in ``read_file``."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            what = "is a folder" if stat.S_ISDIR(status.st_mode) else "is a pipe or a device"
            raise InvalidInputError(f"{path} {what}: expected {expected}")
        if status.st_size > most_bytes:
            raise InvalidInputError(
                f"{path} has {status.st_size / 1e6:.0f} MB: at most {most_bytes / 1e6:.0f} are read"
            )
        opened = path.open("rb")
    except (FileNotFoundError, NotADirectoryError) as error:
        raise InvalidInputError(f"there is no file {path}: expected {expected}") from error
    except OSError as error:
        raise InvalidInputError(f"{path} cannot be read ({error.strerror})") from error
    with opened as file:
        yield file


def read_up_to(stream: Callable[[int], bytes], most_bytes: int, what: str) -> bytes:
    """Return all that ``stream`` yields, asked for a number of bytes at a time.

    Raises:
        InvalidInputError: more than ``most_bytes`` came; no more were taken.
    """
    parts: list[bytes] = []
    left = most_bytes
    while part := stream(CHUNK):
        left -= len(part)
        if left < 0:
            raise InvalidInputError(
                f"{what} unpacks to more than {most_bytes / 1e6:.0f} MB: refused"
            )
        parts.append(part)
    return b"".join(parts)


@contextmanager
def open_zip(data: bytes, complaint: str) -> Generator[zipfile.ZipFile]:
    """Open a zip and name whatever is wrong with it.

    Args:
        data: Contents of the file.
        complaint: What is said of a damaged one, with its name; the reason is put behind.

    Raises:
        InvalidInputError: not a zip, damaged, packed in another way than deflate, or with more
            members than are taken.
    """
    try:
        if _directory_bytes(data) > MAX_DIRECTORY_BYTES:
            raise InvalidInputError(f"{complaint}: it holds more files than are taken")
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if any(info.compress_type not in PACKINGS for info in archive.infolist()):
                raise InvalidInputError(
                    f"{complaint}: it is packed in a way that is not read, expected a plain zip"
                )
            yield archive
    except InvalidInputError:
        raise
    except DAMAGED as error:
        reason = str(error)[:160] or "it ends too early"
        raise InvalidInputError(f"{complaint}: {reason}") from error


def read_member(archive: zipfile.ZipFile, info: zipfile.ZipInfo, most_bytes: int) -> bytes:
    """Return a member of a zip, unpacked step by step; errors as in ``read_up_to``."""
    with archive.open(info) as member:
        return read_up_to(member.read, most_bytes, info.filename[:120])


def _directory_bytes(data: bytes) -> int:
    """Return the size of a zip's directory as its end states it; 64-bit zips are refused.

    Files of the size that is taken need no 64 bits, and the directory is read as a whole.
    """
    end = len(data) - END_OF_ZIP_SIZE
    if not (data[end:].startswith(END_OF_ZIP) and data.endswith(b"\0\0")):
        end = data.rfind(END_OF_ZIP, max(0, end - LONGEST_COMMENT))
    if end < 0:
        part = "its end is missing" if data.startswith(START_OF_ZIP) else "it is no zip file"
        raise zipfile.BadZipFile(part if data else "it is empty")
    if data[max(0, end - LOCATOR_64_SIZE) : end].startswith(LOCATOR_64):
        raise zipfile.BadZipFile("it is a zip for more than 4 GB, expected a plain one")
    return int.from_bytes(data[end + 12 : end + 16], "little")
