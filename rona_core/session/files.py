"""Session files: one zip of JSON and arrays, written so that a crash loses nothing.

The same document gives the same bytes. Reading checks names, sizes and digests before anything is
unpacked into the program.
"""

import hashlib
import io
import json
import math
import os
import re
import shutil
import struct
import tokenize
import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from rona_core import __version__
from rona_core.errors import NotFoundError, SessionFormatError
from rona_core.session.codec import Arrays, decode, encode
from rona_core.session.document import Session
from rona_core.session.migrate import SCHEMA, migrate
from rona_core.session.packing import Recipe, pack, unpack
from rona_core.session.temporary import open_temporary

FORMAT = "rona-session"
SUFFIX = ".rona"
MAX_MEMBERS = 20_000
MAX_TOTAL_BYTES = 2 * 1024**3
MAX_RATIO = 200  # unpacked over packed, for files that unpack to more than FREE_BYTES
FREE_BYTES = 64 * 1024**2
PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
NPY_VERSION = (1, 0)
MEMBER_NAME = re.compile(r"manifest\.json|commands\.jsonl|(arrays|packed)/[\w-]+(/[\w-]+)*\.npy")
UNITS = {"length": "mm", "angle": "rad", "time": "s", "ultrasound_time": "us", "force": "N"}
NAMING = "T_a_b is the pose of frame b in frame a; points_a are coordinates in frame a"


def session_bytes(session: Session, *, quick: bool = False) -> bytes:
    """Return the bytes of the session file of ``session``.

    With ``quick`` nothing in it is packed: some twice as large, but made in a tenth of the time.
    """
    arrays: Arrays = {}
    document = encode(session, "session", arrays)
    log = document.pop("log")
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
    members["commands.jsonl"] = "".join(
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
    text = json.dumps(manifest, sort_keys=True, indent=1, allow_nan=False).encode()
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive:
        for name, data in [("manifest.json", text), *members.items()]:
            info = zipfile.ZipInfo(name, date_time=(1980, 1, 1, 0, 0, 0))
            info.compress_type = zipfile.ZIP_STORED if quick else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, data)
    return buffer.getvalue()


def _npy(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array, version=NPY_VERSION, allow_pickle=False)
    return buffer.getvalue()


def save_session(
    session: Session, path: Path | str, *, backup: bool = True, quick: bool = False
) -> Path:
    """Write ``session`` to ``path`` atomically; the file that was there becomes ``.bak``.

    Without ``backup`` the file that was there goes, once the new one is complete; ``quick`` as in
    `session_bytes`.
    """
    return write_whole(Path(path), session_bytes(session, quick=quick), backup=backup)


def write_whole(path: Path, data: bytes, *, backup: bool = False) -> Path:
    """Write ``data`` to ``path`` atomically; with ``backup`` what was there becomes ``.bak``."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = open_temporary(path)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
            os.chmod(temporary, 0o644)  # as other files are; temporary ones are private
            if backup and path.exists():
                _keep_backup(path)
            os.replace(temporary, path)  # while it is still locked
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    directory = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
    return path


def _keep_backup(path: Path) -> None:
    """Give the present file a second name, so that ``path`` itself never goes missing."""
    link = path.with_name(f".{path.name}.link")
    link.unlink(missing_ok=True)
    try:
        os.link(path, link)
    except OSError:  # a file system without hard links
        shutil.copy2(path, link)
    os.replace(link, path.with_name(path.name + ".bak"))


def load_session(path: Path | str) -> Session:
    """Read a session file.

    Raises:
        NotFoundError: no such file.
        SessionFormatError: not a session file, damaged, too large, or newer than this program.
    """
    path = Path(path)
    if not path.is_file():
        raise NotFoundError(f"there is no session file {path}")
    return session_from_bytes(path.read_bytes(), str(path.name))


def session_from_bytes(data: bytes, name: str = "upload") -> Session:
    """Read a session from the bytes of its file; errors as in ``load_session``."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _check_members(archive, len(data), name)
            contents = {info.filename: archive.read(info) for info in archive.infolist()}
    except (zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, RuntimeError) as error:
        reason = str(error) or "it ends too early"
        raise SessionFormatError(
            f"{name} is not a readable session file: {reason}. Is there a .bak beside it?"
        ) from error
    except ValueError as error:
        raise SessionFormatError(f"{name} is damaged: {error}") from error
    manifest = _manifest(contents.pop("manifest.json"), name)
    _check_digests(manifest, contents, name)
    manifest = migrate(manifest)
    document, copies = manifest.get("session"), manifest.get("copies", {})
    recipes = manifest.get("packed", {})
    if not (isinstance(document, dict) and isinstance(copies, dict) and isinstance(recipes, dict)):
        raise SessionFormatError(f"{name}: its manifest holds no session")
    arrays: Arrays = {}
    for member in contents.keys() - {"commands.jsonl"}:
        folder, _, array = member.removesuffix(".npy").partition("/")
        stored = _load_npy(contents[member], member)
        if folder == "packed":
            stored = unpack(stored, decode(recipes.get(array), Recipe, {}, member), member)
        arrays[array] = stored
    for copy, known in copies.items():
        if not isinstance(known, str) or known not in arrays:
            raise SessionFormatError(f"{name}: the array {known!r} that {copy!r} copies is missing")
        arrays[copy] = arrays[known]
    lines = contents["commands.jsonl"].splitlines()
    log = [_json(line, f"{name}: line {i + 1} of its log") for i, line in enumerate(lines)]
    return decode({**document, "log": log}, Session, arrays)


def _check_members(archive: zipfile.ZipFile, packed: int, name: str) -> None:
    infos = archive.infolist()
    names = [info.filename for info in infos]
    total = sum(info.file_size for info in infos)
    foreign = [n for n in names if not MEMBER_NAME.fullmatch(n)]
    if foreign or not {"manifest.json", "commands.jsonl"} <= set(names):
        what = f"it holds {foreign[0]!r}" if foreign else "manifest or command log is missing"
        raise SessionFormatError(f"{name} is a zip, but not a session file of RONA: {what}")
    if any(info.compress_type not in PACKINGS for info in infos):
        raise SessionFormatError(f"{name} is packed in a way that RONA does not use: refused")
    if len(set(names)) != len(names) or len(names) > MAX_MEMBERS:
        raise SessionFormatError(f"{name} has doubled names or more than {MAX_MEMBERS} members")
    if total > MAX_TOTAL_BYTES or (total > FREE_BYTES and total > MAX_RATIO * packed):
        raise SessionFormatError(
            f"{name} would unpack to {total / 1e6:.0f} MB from {packed / 1e6:.1f} MB: refused"
        )


def _json(text: bytes, what: str) -> Any:
    """Return what a JSON text says; numbers that are none (NaN, Infinity) are refused."""

    def refuse(number: str) -> None:
        raise ValueError(f"{number} is not a number")

    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise SessionFormatError(f"{what} is not readable: {error}") from error


def _manifest(text: bytes, name: str) -> dict[str, Any]:
    manifest = _json(text, f"{name}: its manifest")
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise SessionFormatError(f"{name} is a zip, but not a session file of RONA")
    return manifest


def _check_digests(manifest: dict[str, Any], contents: dict[str, bytes], name: str) -> None:
    expected = manifest.get("sha256")
    if not isinstance(expected, dict) or set(expected) != set(contents):
        raise SessionFormatError(f"{name}: its members are not the ones its manifest lists")
    for member, data in contents.items():
        if hashlib.sha256(data).hexdigest() != expected[member]:
            raise SessionFormatError(f"{name}: {member} is damaged (its digest does not match)")


def _load_npy(blob: bytes, member: str) -> np.ndarray:
    """Return the array of a member; its size is compared before memory is taken for it."""
    file = io.BytesIO(blob)
    try:
        if np.lib.format.read_magic(file) != NPY_VERSION:
            raise ValueError("its version is not 1.0")
        shape, _, dtype = np.lib.format.read_array_header_1_0(file)
        there, told = len(blob) - file.tell(), math.prod(shape) * dtype.itemsize
        if there != told:
            raise ValueError(f"{there} bytes of values instead of {told}")
        file.seek(0)
        return np.load(file, allow_pickle=False)
    except (ValueError, TypeError, EOFError, tokenize.TokenError) as error:
        raise SessionFormatError(f"{member} is not a plain array: {error}") from error
