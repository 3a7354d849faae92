"""Members of a session file: unpacked one by one within bounds, their digests compared.

What a file says of its size is not believed: bytes are counted while they are unpacked.
"""

import hashlib
import json
import re
import zipfile
from dataclasses import dataclass
from typing import Any

from rona_core.devices.files.npy import MAX_HEADER_BYTES, array_from_npy
from rona_core.devices.files.size_limits import open_zip, read_member
from rona_core.errors import InvalidInputError, SessionFormatError, StepBlockedError
from rona_core.session.array_packing import Recipe, unpack
from rona_core.session.codec import Arrays, decode, encode

FORMAT = "rona-session"
SCHEMA = 6  # of the manifest; raise it with every change that older files do not allow
MANIFEST, LOG = "manifest.json", "commands.jsonl"
MAX_MEMBERS = 20_000
MAX_STORED_BYTES = 192 * 1024**2  # of all arrays of a file
MAX_USED_BYTES = 2 * MAX_STORED_BYTES  # of all arrays of a session: many are there twice
MAX_FILE_BYTES = MAX_STORED_BYTES + 64 * 1024**2
MAX_CAPTURE_BYTES = 64 * 1024**2  # that one more capture may take, with what follows from it
MAX_JSON_BYTES = {MANIFEST: 12 * 1024**2, LOG: 24 * 1024**2}
MAX_DEPTH = 64  # of lists and objects within each other; a session needs a dozen
MEMBER_NAME = re.compile(r"manifest\.json|commands\.jsonl|(arrays|packed)/[\w-]+(/[\w-]+)*\.npy")


@dataclass(frozen=True, slots=True, eq=False)
class Members:
    """What a session file holds, its arrays as they were before they were packed."""

    manifest: dict[str, Any]
    log: list[Any]
    arrays: Arrays


def read_members(data: bytes, name: str) -> Members:
    """Read the members of a session file.

    Raises:
        SessionFormatError: not a session file, damaged, or with more in it than is taken.
    """
    try:
        if len(data) > MAX_FILE_BYTES:
            raise InvalidInputError(f"{name} is too large for a session file: {_mb(len(data))}")
        with open_zip(data, f"{name} is not a readable session file") as archive:
            return _read(archive, name)
    except InvalidInputError as error:
        raise SessionFormatError(f"{error}. Is there a .bak beside it?") from error


def require_room(stored_bytes: int, used_bytes: int, texts: dict[str, int], name: str) -> None:
    """Refuse more than a session file may hold: what cannot be read again must not be written.

    Args:
        stored_bytes: Of all arrays, each once.
        used_bytes: Of all arrays as the session holds them.
        texts: Bytes of manifest and log.
        name: Of the file, for the message.

    Raises:
        SessionFormatError: more than is taken.
    """
    parts = [
        ("arrays", stored_bytes, MAX_STORED_BYTES),
        ("arrays in use", used_bytes, MAX_USED_BYTES),
        *((member, size, MAX_JSON_BYTES[member]) for member, size in texts.items()),
    ]
    for what, size, most in parts:
        if size > most:
            raise SessionFormatError(
                f"{name} holds {_mb(size)} of {what}, a session file holds at most {_mb(most)}: "
                "start another session for further captures"
            )


def require_room_for_capture(archive: tuple[Any, ...]) -> None:
    """Refuse a further capture where the file might not hold it, before anything is measured.

    Args:
        archive: All captures of a session.

    Raises:
        StepBlockedError: there are too many already.
    """
    arrays: Arrays = {}
    encode(archive, "archive", arrays)
    held = sum(array.nbytes for array in arrays.values())
    if held > MAX_STORED_BYTES - MAX_CAPTURE_BYTES:
        raise StepBlockedError(
            f"the session holds {_mb(held)} of recordings, and a session file at most "
            f"{_mb(MAX_STORED_BYTES)}: save it, and begin another session for further ones"
        )


def used_bytes(document: Any, arrays: Arrays) -> int:
    """Return the bytes of all arrays that a document in plain values refers to, each time."""
    total, left = 0, [document]
    while left:
        value = left.pop()
        if isinstance(value, dict):
            array = value.get("array")
            if isinstance(array, str) and array in arrays:
                total += arrays[array].nbytes * (2 if "step" in value else 1)
            left += value.values()
        elif isinstance(value, list):
            left += value
    return total


def _mb(size: int) -> str:
    return f"{size / 1e6:.0f} MB"


def _read(archive: zipfile.ZipFile, name: str) -> Members:
    infos = {info.filename: info for info in archive.infolist()}
    _check_names(archive.namelist(), name)
    texts = {
        member: read_member(archive, infos.pop(member), most)
        for member, most in MAX_JSON_BYTES.items()
    }
    manifest = _manifest(texts.pop(MANIFEST), name)
    digests, recipes = manifest["sha256"], manifest.get("packed", {})
    if set(digests) != {*infos, LOG} or not isinstance(recipes, dict):
        raise SessionFormatError(f"{name}: its members are not the ones its manifest lists")
    _check_digest(texts[LOG], LOG, digests, name)
    arrays: Arrays = {}
    left = MAX_STORED_BYTES
    for member, info in infos.items():
        blob = read_member(archive, info, left + MAX_HEADER_BYTES)
        _check_digest(blob, member, digests, name)
        folder, _, array = member.removesuffix(".npy").partition("/")
        try:
            stored = array_from_npy(blob)
        except ValueError as error:
            raise SessionFormatError(f"{member} is not a plain array: {error}") from error
        if folder == "packed":
            stored = unpack(stored, decode(recipes.get(array), Recipe, {}, member), member)
        left -= stored.nbytes
        stored.setflags(write=False)
        arrays[array] = stored
    lines = texts[LOG].splitlines()
    log = [parsed(line, f"{name}: line {i + 1} of its log") for i, line in enumerate(lines)]
    return Members(manifest, log, arrays)


def _check_names(names: list[str], name: str) -> None:
    foreign = [n for n in names if not MEMBER_NAME.fullmatch(n)]
    if foreign or not {MANIFEST, LOG} <= set(names):
        what = f"it holds {foreign[0][:120]!r}" if foreign else "manifest or log is missing"
        raise SessionFormatError(f"{name} is a zip, but not a session file of RONA: {what}")
    if len(set(names)) != len(names) or len(names) > MAX_MEMBERS:
        raise SessionFormatError(f"{name} has doubled names or more than {MAX_MEMBERS} members")


def parsed(text: bytes, what: str) -> Any:
    """Return what a JSON text says.

    Raises:
        SessionFormatError: not JSON, numbers that are none (NaN, Infinity), or nested too deep.
    """

    def refuse(number: str) -> None:
        raise ValueError(f"{number} is not a number")

    try:
        value = json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise SessionFormatError(f"{what} is not readable: {error}") from error
    level = [value]
    for _ in range(MAX_DEPTH):
        level = [inner for outer in level for inner in _inside(outer)]
        if not level:
            return value
    raise SessionFormatError(f"{what} is nested deeper than {MAX_DEPTH}: refused")


def _inside(value: Any) -> list[Any]:
    """Return the lists and objects right inside of a plain value."""
    inner = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return [item for item in inner if isinstance(item, dict | list)]


def _manifest(text: bytes, name: str) -> dict[str, Any]:
    manifest = parsed(text, f"{name}: its manifest")
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise SessionFormatError(f"{name} is a zip, but not a session file of RONA")
    if not isinstance(manifest.get("sha256"), dict):
        raise SessionFormatError(f"{name}: its manifest lists no members")
    _check_schema(manifest.get("schema"), str(manifest.get("app_version", "unknown"))[:40], name)
    return manifest


def _check_schema(schema: Any, version: str, name: str) -> None:
    if type(schema) is int and schema > SCHEMA:
        raise SessionFormatError(
            f"{name} has schema {str(schema)[:40]}, this program reads {SCHEMA}: it was saved by a "
            f"newer RONA ({version}); update first"
        )
    if type(schema) is not int or schema != SCHEMA:
        raise SessionFormatError(
            f"{name} has schema {str(schema)[:40]!r}, this program reads {SCHEMA}: it was saved "
            "before the first release, or is no session file; record it again"
        )


def _check_digest(data: bytes, member: str, digests: dict[str, Any], name: str) -> None:
    if hashlib.sha256(data).hexdigest() != digests[member]:
        raise SessionFormatError(f"{name}: {member} is damaged (its digest does not match)")
