"""Members of a session file: unpacked one by one within bounds, their digests compared.

What a file says of its size is not believed: bytes are counted while they are unpacked.

Pack arrays for the file without losing a bit: what the neighbours foretell is not written. A value
is foretold as the one before it along an axis. The remainders are small integers: their sign moves
into the lowest bit, and equal bytes of all values come to lie side by side, where deflate finds
them.
"""

import hashlib
import json
import math
import re
import zipfile
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.files.npy import MAX_HEADER_BYTES, array_from_npy
from rona_core.devices.files.size_limits import open_zip, read_member
from rona_core.errors import InvalidInputError, SessionFormatError, StepBlockedError
from rona_core.session.codec import Arrays, decode, encode

Integers = NDArray[Any]
SMALLEST_BYTES = 512  # smaller arrays are left as they are
AT_ONCE = 65536  # values whose bits are counted at once
DTYPES = tuple(f"<{kind}{size}" for kind in "fiu" for size in (2, 4, 8))


@dataclass(frozen=True, slots=True)
class Recipe:
    """How to unpack an array."""

    dtype: str
    shape: tuple[int, ...]
    axis: int | None = None  # along which differences stand, None for values as they are


def pack(array: NDArray[Any]) -> tuple[NDArray[np.uint8], Recipe] | None:
    """Return the bytes of ``array``, (bytes a value, values), and the recipe that unpacks them.

    None: small arrays and those of single bytes are better left as they are.
    """
    kind = array.dtype.str
    if kind not in DTYPES or array.nbytes < SMALLEST_BYTES:
        return None
    bits = array.view(f"<i{array.itemsize}")
    rest, axis = bits, _best_axis(bits)
    if axis is not None:
        rest = np.diff(bits, axis=axis, prepend=np.zeros_like(bits.take([0], axis=axis)))
    folded = _folded(rest)
    planes = np.ascontiguousarray(folded.reshape(-1, 1).view(np.uint8).T)
    return planes, Recipe(kind, array.shape, axis)


def unpack(stored: NDArray[Any], recipe: Recipe, where: str) -> NDArray[Any]:
    """Return the array that ``pack`` was given, to the bit.

    Raises:
        SessionFormatError: recipe and bytes do not belong together.
    """
    if not _fits(stored, recipe):
        raise SessionFormatError(f"{where}: its bytes are not packed in the way that is said")
    folded = np.array(stored.T, order="C").view(f"<u{recipe.dtype[2]}")
    rest = _unfolded(folded.reshape(recipe.shape))
    if recipe.axis is not None:
        np.add.accumulate(rest, axis=recipe.axis, out=rest)
    return rest.view(recipe.dtype)


def _best_axis(bits: Integers) -> int | None:
    """Return the axis along which differences need the fewest bits, None for no difference."""
    need: dict[int | None, float] = {None: _bits(bits)}
    for axis in range(bits.ndim):
        if bits.shape[axis] > 1:
            need[axis] = _bits(np.diff(bits, axis=axis))
    return min(need, key=lambda axis: need[axis])


def _bits(values: Integers) -> float:
    folded, total = _folded(values).ravel(), 0.0
    for start in range(0, folded.size, AT_ONCE):
        need = folded[start : start + AT_ONCE].astype(np.float64)
        need += 1.0
        total += float(np.log2(need, out=need).sum())
    return total / folded.size


def _folded(values: Integers) -> Integers:
    """Return integers as unsigned ones, sign in the lowest bit: 0, -1, 1, -2 give 0, 1, 2, 3."""
    unsigned = values.dtype.str.replace("i", "u")
    return ((values << 1) ^ (values >> (8 * values.itemsize - 1))).view(unsigned)


def _unfolded(folded: Integers) -> Integers:
    """Return what was folded, in the memory of the folded values."""
    signed = folded.dtype.str.replace("u", "i")
    flips = (folded & 1).view(signed)
    np.negative(flips, out=flips)
    folded >>= 1
    values: Integers = folded.view(signed)
    values ^= flips
    return values


def _fits(stored: NDArray[Any], recipe: Recipe) -> bool:
    shape = recipe.shape
    if recipe.dtype not in DTYPES or not shape or min(shape) < 0:
        return False
    if stored.dtype != np.uint8 or stored.shape != (int(recipe.dtype[2]), math.prod(shape)):
        return False
    return recipe.axis is None or 0 <= recipe.axis < len(shape)


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
        with open_zip(data, f"{name}: the file is damaged") as archive:
            return _read(archive, name)
    except InvalidInputError as error:
        raise SessionFormatError(str(error)) from error


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
        raise SessionFormatError(
            f"{name}: the file is damaged: its members are not the ones its manifest lists"
        )
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
    return [item for item in inner if isinstance(item, (dict, list))]


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
        raise SessionFormatError(
            f"{name}: the file is damaged: the digest of {member} does not match"
        )
