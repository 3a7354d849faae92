"""Session files: one zip of JSON and arrays, written so that a crash loses nothing.

The same document gives the same bytes. How it is read: ``members``. A temporary file beside each
becomes it once it is whole; a lock distinguishes those that are still being written.
"""

import contextlib
import fcntl
import hashlib
import io
import json
import os
import re
import shutil
import tempfile
import time
import zipfile
from collections.abc import Generator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rona_core import __version__
from rona_core.devices.settings import hidden_characters
from rona_core.errors import NotFoundError, RonaError, SessionFormatError, storing
from rona_core.session.captures import Capture
from rona_core.session.codec import Arrays, decode, encode
from rona_core.session.document import Session
from rona_core.session.members import (
    FORMAT,
    LOG,
    MANIFEST,
    MAX_FILE_BYTES,
    SCHEMA,
    Members,
    pack,
    read_members,
    require_room,
    used_bytes,
)

SUFFIX, BACKUP = ".rona", ".bak"
NPY_VERSION = (1, 0)
UNITS = {"length": "mm", "angle": "rad", "time": "s", "ultrasound_time": "us", "force": "N"}
NAMING = "T_a_b is the pose of frame b in frame a; points_a are coordinates in frame a"
TEMPORARY = ".part"
LOCK = ".lock"  # in a folder, of who writes a session file there
WAIT_S = 10.0  # for another program that writes one
Stamp = tuple[int, ...]
MADE = re.compile(r"\..+\.[a-z0-9_]{8}\.part")  # .NAME.RANDOM.part, as they are named here


def session_bytes(session: Session, *, quick: bool = False) -> bytes:
    """Return the bytes of the session file of ``session``.

    With ``quick`` nothing in it is packed: some twice as large, but made in a tenth of the time.

    Raises:
        SessionFormatError: it holds more than a file may hold.
    """
    arrays: Arrays = {}
    document = encode(session, "session", arrays)
    log = document.pop("log")
    used = used_bytes(document, arrays)
    members: dict[str, bytes] = {}
    first: dict[str, str] = {}  # digest of a member -> its name
    copies: dict[str, str] = {}  # array that equals another -> that other
    recipes: dict[str, Any] = {}  # packed array -> how to unpack it
    for name, array in sorted(arrays.items()):
        blob = _npy(array)
        known = first.setdefault(hashlib.sha256(blob).hexdigest(), name)
        if known != name:
            copies[name] = known
        elif quick or (packing := pack(array)) is None:
            members[f"arrays/{name}.npy"] = blob
        else:
            members[f"packed/{name}.npy"] = _npy(packing[0])
            recipes[name] = encode(packing[1], name, {})
    members[LOG] = "".join(
        json.dumps(entry, sort_keys=True, allow_nan=False) + "\n" for entry in log
    ).encode()
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in members.items()}
    manifest = {
        "format": FORMAT,
        "schema": SCHEMA,
        "app_version": __version__,
        "units": UNITS,
        "naming": NAMING,
        "session": document,
        "sha256": digests,
        "copies": copies,
        "packed": recipes,
    }
    text = json.dumps(manifest, sort_keys=True, allow_nan=False).encode()
    texts = {MANIFEST: len(text), LOG: len(members[LOG])}
    stored = sum(map(len, members.values())) - texts[LOG]
    require_room(stored, used, texts, f"the session {session.name!r}")
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name, data in [(MANIFEST, text), *members.items()]:
            info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_STORED if quick else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return buffer.getvalue()


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, version=NPY_VERSION, allow_pickle=False)
    return buffer.getvalue()


def save_session(session: Session, path: Path | str) -> Path:
    """Write ``session`` to ``path`` atomically; the file that was there becomes ``.bak``."""
    return write_whole(Path(path), session_bytes(session), backup=True)


def write_whole(path: Path, data: bytes, *, backup: bool = False) -> Path:
    """Write ``data`` to ``path`` atomically; with ``backup`` what was there becomes ``.bak``.

    Raises:
        StorageError: the file system refused; the file is whole, old or new.
    """
    with storing(path):
        return _write_whole(path, data, backup=backup)


def _write_whole(path: Path, data: bytes, *, backup: bool) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = open_temporary(path)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            if backup and path.exists():
                _keep_backup(path)
            return move_whole(temporary, path)  # while it is still locked
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def move_whole(temporary: Path, path: Path) -> Path:
    """Give a temporary file of the same folder, complete on the disk, the name ``path``.

    Raises:
        StorageError: the file system refused.
    """
    with storing(path):
        return _move_whole(temporary, path)


def _move_whole(temporary: Path, path: Path) -> Path:
    os.chmod(temporary, 0o644)  # as other files are; temporary ones are private
    os.replace(temporary, path)
    sync_folder(path.parent)
    return path


def sync_folder(folder: Path) -> None:
    """Have the disk hold the names in a folder."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _keep_backup(path: Path) -> None:
    """Give the present file a second name, so that ``path`` itself never goes missing."""
    link = path.with_name(f".{path.name}.link")
    link.unlink(missing_ok=True)
    try:
        os.link(path, link)
    except OSError:  # a file system without hard links
        shutil.copy2(path, link)
    os.replace(link, backup_of(path))


def backup_of(path: Path) -> Path:
    """Return where the file that a session file replaced lies."""
    return path.with_name(path.name + BACKUP)


@dataclass(frozen=True, slots=True)
class FileIdentity:
    """By what a file is known again."""

    digest: str  # SHA-256 of its bytes
    stamp: Stamp | None  # see `stamp_of`; None where there was no file


def stamp_of(path: Path) -> Stamp | None:
    """Return what changes with a file: inode, size, times of content and state; None without it."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns


def digest_of(data: bytes) -> str:
    """Return the SHA-256 of the bytes of a file."""
    return hashlib.sha256(data).hexdigest()


@contextlib.contextmanager
def alone_in(folder: Path) -> Generator[None, None, None]:
    """Be the only program that writes session files in a folder, for a moment.

    Raises:
        RonaError: another one has been writing for long.
        OSError: no right to write.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    ends_s = time.monotonic() + WAIT_S
    try:
        while True:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as error:
                if time.monotonic() > ends_s:
                    text = f"another program has been writing in {folder} for {WAIT_S:.0f} s"
                    raise RonaError(f"{text}: end it, or save again when it is done") from error
                time.sleep(0.02)
            except OSError:  # a file system without locks is no reason not to write
                break
        yield
    finally:
        os.close(descriptor)


def load_session(path: Path | str, name: str | None = None) -> Session:
    """Read a session file; messages call it ``name``, or by its own name.

    Raises:
        NotFoundError: no such file.
        SessionFormatError: not a session file, damaged, too large, or newer than this program.
    """
    return load_identified(Path(path), name)[0]


def load_identified(path: Path, name: str | None = None) -> tuple[Session, FileIdentity]:
    """Read a session file; return its identity too; errors as in `load_session`.

    Of a file that cannot be read, the error has the name of its last good copy as ``backup``, where
    there is one.
    """
    if not path.is_file():
        raise NotFoundError(f"there is no session file {path}")
    name = path.name if name is None else name
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise SessionFormatError(
            f"{name} has {size / 1e6:.0f} MB: a session file has at most {MAX_FILE_BYTES / 1e6:.0f}"
        )
    stamp = stamp_of(path)  # first: what is written meanwhile has another one
    data = path.read_bytes()
    try:
        return session_from_bytes(data, name), FileIdentity(digest_of(data), stamp)
    except SessionFormatError as error:
        backup = backup_of(path)
        if not _is_readable(backup):
            raise
        words = f"{error}. Its last good copy is {backup.name}"
        raise SessionFormatError(words, backup=backup.name) from error


def _is_readable(path: Path) -> bool:
    """Return whether a session can be read from a file."""
    try:
        load_session(path)
    except (RonaError, OSError):
        return False
    return True


def session_from_bytes(data: bytes, name: str = "upload") -> Session:
    """Read a session from the bytes of its file; errors as in ``load_session``.

    Hidden characters in its name become ``�``, which can be seen.
    """
    try:
        members = read_members(data, name)
        manifest, arrays = _with_log(members), members.arrays
        document, copies = manifest.get("session"), manifest.get("copies", {})
        if not (isinstance(document, dict) and isinstance(copies, dict)):
            raise SessionFormatError(f"{name}: its manifest holds no session")
        for copy, known in copies.items():
            if not isinstance(known, str) or known not in arrays:
                raise SessionFormatError(
                    f"{name}: the array {str(known)[:120]!r} that {copy!r} copies is missing"
                )
            arrays[copy] = arrays[known]
        require_room(0, used_bytes(document, arrays), {}, name)
        for part in ("captures", "archive"):
            _name_once(document.get(part), copies)
        session = decode(_with_archive(document, arrays), Session, arrays)
        hidden = hidden_characters(session.name)
        if not hidden:
            return session
        return replace(session, name="".join("�" if c in hidden else c for c in session.name))
    except MemoryError as error:
        raise SessionFormatError(f"{name} needs more memory than there is: refused") from error


def _name_once(value: Any, copies: dict[str, str]) -> None:
    """Give the arrays below a plain value that equal others the names of those, in place."""
    if isinstance(value, dict):
        if isinstance(value.get("array"), str):
            value["array"] = copies.get(value["array"], value["array"])
        value = list(value.values())
    if isinstance(value, list):
        for part in value:
            _name_once(part, copies)


def _with_archive(document: dict[str, Any], arrays: Arrays) -> dict[str, Any]:
    """Return a document with its archive decoded, and captures that are in it taken from there."""
    stored: Any = document.get("archive")
    archive = decode(stored, tuple[Capture, ...], arrays, "session/archive")
    pairs = list(zip(stored, archive, strict=True))

    def held(value: Any) -> Any:
        """Return what captures hold: one, several, or those below ``more``."""
        if isinstance(value, list):
            return [held(part) for part in value]
        if not isinstance(value, dict):
            return value
        if "ordinal" not in value:
            return {name: held(part) for name, part in value.items()}
        return next((capture for data, capture in pairs if data == value), value)

    return {**document, "archive": list(archive), "captures": held(document.get("captures"))}


def _with_log(members: Members) -> dict[str, Any]:
    """Return the manifest with the log inside its session, as the document has it."""
    document = members.manifest.get("session")
    if not isinstance(document, dict):
        return members.manifest
    return {**members.manifest, "session": {**document, "log": members.log}}


def lock_file(descriptor: int, *, wait: bool = False) -> bool:
    """Lock an open file until it is closed; False where another holds it, unless ``wait``.

    The system lets go when the process ends, however it ends.
    """
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except OSError:
        return False
    return True


def open_temporary(path: Path) -> tuple[int, Path]:
    """Return descriptor and path of a new, locked file beside ``path`` that may become it."""
    while True:
        descriptor, name = tempfile.mkstemp(TEMPORARY, f".{path.name}.", path.parent)
        lock_file(descriptor)  # a file system without locks is no reason not to write
        if os.path.exists(name):  # else it was taken for a stale one before it was locked
            return descriptor, Path(name)
        os.close(descriptor)


def remove_stale_temporaries(folder: Path) -> int:
    """Remove what programs that were killed left half written in ``folder``; return how many.

    Folders below it are not searched, and files of other names stay.
    """
    removed = 0
    for path in folder.glob(".*"):
        if not MADE.fullmatch(path.name) or not path.is_file() or path.is_symlink():
            continue
        with contextlib.suppress(OSError):  # one that cannot be removed does no harm
            descriptor = os.open(path, os.O_RDWR)
            try:
                if lock_file(descriptor):  # not being written
                    path.unlink()
                    removed += 1
            finally:
                os.close(descriptor)
    return removed
