"""Header of ``.mha`` sequence files: fields, and fields of each frame. Pixels are passed over."""

import math
import re
from dataclasses import dataclass
from typing import TypeVar

from rona_core.errors import InvalidInputError

Number = TypeVar("Number", int, float)
END = re.compile(rb"^ElementDataFile[ \t]*=[ \t]*([^\r\n]*?)[ \t]*(?:\r?\n|\Z)", re.MULTILINE)
FRAME_FIELD = re.compile(r"Seq_Frame([0-9]{1,9})_(\w+)")
MAX_HEADER_BYTES = 48 * 1024**2
MOST_DIGITS = 15  # of a whole number; exact as a float too


@dataclass(frozen=True, slots=True, eq=False)
class Header:
    """Fields of the file, and those of every frame from 0 on."""

    name: str  # of the file, for messages
    fields: dict[str, str]
    frames: tuple[dict[str, str], ...]

    @property
    def n_frames(self) -> int:
        """How many frames there are."""
        return len(self.frames)

    def names_with(self, ending: str) -> tuple[str, ...]:
        """Return what stands before ``ending`` in fields of frames, in order of appearance."""
        found: dict[str, None] = {}
        for frame in self.frames:
            for field in frame:
                if field.endswith(ending) and field != ending:
                    found[field.removesuffix(ending)] = None
        return tuple(found)

    def whole(self, field: str) -> int:
        """Return a field of the file that is a whole number, 0 or more.

        Raises:
            InvalidInputError: it is missing, or something else.
        """
        value = self.fields.get(field, "missing")
        if not _is_whole(value):
            raise InvalidInputError(
                f"{self.name}, {field}: expected a whole number, got {value[:40]!r}"
            )
        return int(value)

    def text(self, frame: int, field: str) -> str:
        """Return a field of a frame.

        Raises:
            InvalidInputError: it is missing.
        """
        if field not in self.frames[frame]:
            raise InvalidInputError(f"{self.name}, frame {frame}: {field} is missing")
        return self.frames[frame][field]

    def number(self, frame: int, field: str, kind: type[Number]) -> Number:
        """Return a field of a frame as a finite number; errors as in ``text``, or another value."""
        value = self.text(frame, field)
        try:
            result = kind(value) if kind is float or _is_whole(value.removeprefix("-")) else None
        except ValueError:
            result = None
        if result is None or not math.isfinite(result):
            words = "a whole number" if kind is int else "a finite number"
            raise InvalidInputError(
                f"{self.name}, frame {frame}, {field}: expected {words}, got {value[:40]!r}"
            )
        return result

    def column(
        self, field: str, kind: type[Number], *, optional: bool = False
    ) -> list[Number] | None:
        """Return a number of every frame; None if it is optional and no frame has it."""
        if optional and not any(field in frame for frame in self.frames):
            return None
        return [self.number(i, field, kind) for i in range(self.n_frames)]

    def matrix(self, frame: int, field: str) -> list[float]:
        """Return the sixteen numbers of a transform; errors as in ``number``."""
        words = self.text(frame, field).split()
        try:
            values = [float(word) for word in words]
        except ValueError:
            values = []
        if len(values) != 16:
            got = f"{len(words)} words" if len(words) != 16 else "other words"
            raise InvalidInputError(
                f"{self.name}, frame {frame}, {field}: expected 16 numbers, got {got}"
            )
        return values


def read_header(data: bytes, name: str) -> Header:
    """Read the header of a sequence file.

    Raises:
        InvalidInputError: not a sequence file, damaged, or one whose pixels are in another file.
    """
    if not data:
        raise InvalidInputError(f"{name} is empty: expected a sequence file (.igs.mha)")
    if not re.match(rb"ObjectType[ \t]*=[ \t]*Image\b", data):
        raise InvalidInputError(
            f"{name}: expected a sequence file that begins with 'ObjectType = Image', "
            f"got {data[:24]!r}"
        )
    end = END.search(data, 0, MAX_HEADER_BYTES)
    if end is None and len(data) > MAX_HEADER_BYTES:
        raise InvalidInputError(
            f"{name}: no 'ElementDataFile = LOCAL' in its first {MAX_HEADER_BYTES / 1e6:.0f} MB: "
            "its header is longer than what is read; cut the recording into parts"
        )
    if end is None:
        raise InvalidInputError(
            f"{name} is cut off: expected 'ElementDataFile = LOCAL' at the end of its header"
        )
    where = end.group(1).decode("ascii", "replace")
    if where != "LOCAL":
        raise InvalidInputError(
            f"{name}: expected its pixels in the same file (ElementDataFile = LOCAL), got "
            f"{where!r}: save it as .igs.mha"
        )
    header = _parsed(data[: end.start()], name)
    stated, there = _least_pixel_bytes(header), len(data) - end.end()
    if there < stated:
        raise InvalidInputError(
            f"{name} is damaged: expected at least {stated} bytes of pixels, got {there}"
        )
    return header


def _least_pixel_bytes(header: Header) -> int:
    """Return how many bytes of pixels must follow; fewer tell that the file was cut off."""
    if header.fields.get("CompressedData", "False").lower() == "true":
        return header.whole("CompressedDataSize") if "CompressedDataSize" in header.fields else 0
    if header.fields.get("ElementType") in ("MET_OTHER", "MET_NONE"):
        return 0  # what PLUS writes where there is no image
    return math.prod(int(word) for word in header.fields["DimSize"].split())


def _parsed(text: bytes, name: str) -> Header:
    try:
        lines = text.decode("utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise InvalidInputError(f"{name}: its header is not text ({error})") from error
    fields: dict[str, str] = {}
    frames: dict[int, dict[str, str]] = {}
    for number, line in enumerate(lines, start=1):
        key, equals, value = line.partition("=")
        key = key.strip()
        if not equals:
            if key:
                raise InvalidInputError(
                    f"{name}, line {number}: expected 'name = value', got {line[:40]!r}"
                )
            continue
        match = FRAME_FIELD.fullmatch(key)
        if key.startswith("Seq_Frame") and match is None:
            raise InvalidInputError(
                f"{name}, line {number}: expected a field like Seq_Frame0000_Timestamp, "
                f"got {key[:60]!r}"
            )
        held, field = fields, key
        if match is not None:
            held, field = frames.setdefault(int(match[1]), {}), match[2]
        if field in held:
            raise InvalidInputError(f"{name}, line {number}: {key} stands there twice")
        held[field] = value.strip()
    header = Header(name, fields, tuple(frames[i] for i in sorted(frames)))
    _check_frames(header, sorted(frames))
    return header


def _is_whole(word: str) -> bool:
    return word.isascii() and word.isdigit() and len(word) <= MOST_DIGITS


def _check_frames(header: Header, indices: list[int]) -> None:
    words = header.fields.get("DimSize", "missing").split()
    if not words or not all(_is_whole(word) for word in words):
        raise InvalidInputError(
            f"{header.name}, DimSize: expected whole numbers, got {' '.join(words)[:40]!r}"
        )
    sizes = [int(word) for word in words]
    if header.whole("NDims") != len(sizes):
        raise InvalidInputError(
            f"{header.name}: NDims says {header.fields['NDims']}, DimSize has {len(sizes)} numbers"
        )
    kinds = header.fields.get("Kinds", "").lower().split()
    along = [k for k, kind in enumerate(kinds) if kind in ("list", "time") and k < len(sizes)]
    expected = sizes[along[-1]] if along else sizes[-1]
    if not indices:
        raise InvalidInputError(
            f"{header.name}: expected fields like Seq_Frame0000_Timestamp, got an image without any"
        )
    gap = next((i for i, index in enumerate(indices) if i != index), None)
    if gap is not None:
        raise InvalidInputError(
            f"{header.name}: frame {gap} is missing, frame {indices[gap]} is there"
        )
    if len(indices) != expected:
        raise InvalidInputError(
            f"{header.name}: DimSize says {expected} frames, there are fields of {len(indices)}"
        )
