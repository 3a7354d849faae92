"""Tool definition files (.rom) of NDI: where the markers of a tool sit, as a tracker is told it.

Little endian, 752 bytes: "NDI"; at byte 4 the sum of all bytes from 6 on, modulo 65536; largest
marker angle at 24, number of markers at 28, least number at 32, largest 3D error at 36 and least
spreads at 40; positions from 72 and normals from 312, three float32 each, twenty of either; maker
at 580 and part number at 592. The layout is not published by its maker: the offsets are those
that the open readers rajkundu/rom-parser and the tool converter of Johns Hopkins University use.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rona_core.devices.marker_geometry import MarkerGeometry
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.geometry.arrays import Floats, as_points, readonly

SIZE = 752
MAX_MARKERS, LEAST_MARKERS = 20, 3
MAGIC = b"NDI"
POSITIONS_AT, NORMALS_AT, MAKER_AT, PART_AT, FACES_AT, GROUPS_AT = 72, 312, 580, 592, 613, 633
LARGEST_MM = 2000.0  # a coordinate beyond this is none
LEAST_DISTANCE_MM = 1.0  # markers closer than this are one
FIXED = {8: 1, 12: 2, 576: 9, 612: 9, 653: 128, 655: 41}  # as present files have them
LEDS_AT, NO_LED = range(572, 576), 31


@dataclass(frozen=True, slots=True, eq=False)
class ToolFile:
    """What a .rom file says of a tool."""

    positions_marker: Floats  # (m, 3)
    normals_marker: Floats  # (m, 3) unit, or zero where a marker is seen from every side
    min_markers: int = 3
    max_angle_deg: int = 90
    max_3d_error_mm: float = 2.0
    min_spread_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    maker: str = ""
    part: str = ""

    def geometry(self, tool: str) -> MarkerGeometry:
        """Return the markers under a tool's name; the file does not know the tip: the origin."""
        centred = self.positions_marker - self.positions_marker.mean(axis=0)
        extents = np.linalg.svd(centred, compute_uv=False)
        facing = self.normals_marker.sum(axis=0)
        length = float(np.linalg.norm(facing))
        return MarkerGeometry(
            tool,
            5 if extents[1] < 0.01 * extents[0] else 6,
            self.positions_marker,
            readonly(facing / length if length > 0.5 else np.zeros(3)),
            readonly(np.zeros(3)),
        )


def tool_file_of(geometry: MarkerGeometry, *, maker: str = "RONA", part: str = "") -> ToolFile:
    """Return what a .rom file would say of one of the known tools."""
    facing = geometry.facing_marker
    return ToolFile(
        geometry.positions_marker,
        readonly(np.tile(facing, (len(geometry.positions_marker), 1))),
        max_angle_deg=60 if facing.any() else 180,
        maker=maker,
        part=part or geometry.tool,
    )


def read_rom(path: Path | str) -> ToolFile:
    """Read a .rom file.

    Raises:
        NotFoundError: no such file.
        InvalidInputError: not a .rom file, or a damaged one; it says where.
    """
    path = Path(path)
    if not path.is_file():
        raise NotFoundError(f"there is no tool file {path}")
    return rom_from_bytes(path.read_bytes(), path.name)


def write_rom(tool: ToolFile, path: Path | str) -> Path:
    """Write a .rom file; coordinates are rounded to float32."""
    path = Path(path)
    path.write_bytes(rom_bytes(tool))
    return path


def rom_from_bytes(data: bytes, name: str = "tool file") -> ToolFile:
    """Read the bytes of a .rom file; errors as in ``read_rom``.

    Files of other writers may leave out what follows the positions, the checksum and the least
    number of markers (zero).
    """
    if data[:3] not in (MAGIC, bytes(3)):
        raise InvalidInputError(f"{name} is no .rom file: it starts with {data[:3]!r}, not b'NDI'")
    if len(data) < POSITIONS_AT:
        raise InvalidInputError(f"{name} has {len(data)} bytes, a .rom file has {SIZE}: cut off?")
    stored, found = struct.unpack_from("<H", data, 4)[0], checksum(data)
    if stored not in (0, found):
        raise InvalidInputError(
            f"{name} is damaged: its checksum is {stored}, its bytes add up to {found}"
        )
    count = data[28]
    least = data[32] or min(LEAST_MARKERS, count)
    if len(data) < POSITIONS_AT + 12 * count:
        raise InvalidInputError(f"{name} has {len(data)} bytes, too few for {count} markers")
    data = data + bytes(max(SIZE - len(data), 0))
    if not LEAST_MARKERS <= count <= MAX_MARKERS:
        raise InvalidInputError(
            f"{name} names {count} markers in byte 28, possible are {LEAST_MARKERS} to "
            f"{MAX_MARKERS}"
        )
    if not 0 < least <= count:
        raise InvalidInputError(f"{name} asks for {least} of {count} markers in byte 32")
    positions = _vectors(data, POSITIONS_AT, count)
    _check_positions(positions, name)
    normals = _vectors(data, NORMALS_AT, count)
    lengths = np.linalg.norm(normals, axis=1)
    if not (np.isfinite(lengths) & ((lengths < 1e-6) | (np.abs(lengths - 1.0) < 0.01))).all():
        raise InvalidInputError(f"{name}: a marker normal has neither length 1 nor length 0")
    units = normals / np.where(lengths > 0.5, lengths, 1.0)[:, None]
    error_mm, *spreads = struct.unpack_from("<4f", data, 36)
    if not np.isfinite([error_mm, *spreads]).all():
        raise InvalidInputError(f"{name}: the limits in bytes 36 to 51 are not finite")
    return ToolFile(
        readonly(positions),
        readonly(units),
        min_markers=least,
        max_angle_deg=data[24],
        max_3d_error_mm=error_mm,
        min_spread_mm=(spreads[0], spreads[1], spreads[2]),
        maker=_text(data, MAKER_AT, 12),
        part=_text(data, PART_AT, 20),
    )


def rom_bytes(tool: ToolFile) -> bytes:
    """Return the bytes of a .rom file.

    Raises:
        InvalidInputError: too few or too many markers, or texts that do not fit.
    """
    positions = as_points(tool.positions_marker, name="positions_marker")
    count = len(positions)
    if not LEAST_MARKERS <= count <= MAX_MARKERS:
        raise InvalidInputError(f"a .rom file holds 3 to 20 markers, not {count}")
    if not LEAST_MARKERS <= tool.min_markers <= count:
        raise InvalidInputError(f"min_markers must be 3 to {count}, not {tool.min_markers}")
    if not 0 <= tool.max_angle_deg <= 180:
        raise InvalidInputError(f"max_angle_deg must be 0 to 180, not {tool.max_angle_deg}")
    _check_positions(positions, "positions_marker")
    data = bytearray(SIZE)
    data[:3] = MAGIC
    for place, value in FIXED.items():
        data[place] = value
    for place in LEDS_AT:
        data[place] = NO_LED
    data[24], data[28], data[32] = tool.max_angle_deg, count, tool.min_markers
    struct.pack_into("<4f", data, 36, tool.max_3d_error_mm, *tool.min_spread_mm)
    _put(data, POSITIONS_AT, positions)
    _put(data, NORMALS_AT, as_points(tool.normals_marker, at_least=count, name="normals_marker"))
    data[552 : 552 + count] = bytes(range(count))
    data[FACES_AT : FACES_AT + count] = bytes([1] * count)
    data[GROUPS_AT : GROUPS_AT + count] = bytes([1] * count)
    for text, place, room in ((tool.maker, MAKER_AT, 12), (tool.part, PART_AT, 20)):
        if len(text) > room or not text.isascii():
            raise InvalidInputError(f"{text!r} must be plain and at most {room} characters long")
        data[place : place + len(text)] = text.encode("ascii")
    struct.pack_into("<H", data, 4, checksum(data))
    return bytes(data)


def checksum(data: bytes | bytearray) -> int:
    """Return the sum of all bytes after the checksum, modulo 65536."""
    return sum(data[6:]) % 65536


def _vectors(data: bytes, start: int, count: int) -> Floats:
    return np.frombuffer(data, "<f4", 3 * count, start).reshape(count, 3).astype(np.float64) + 0.0


def _put(data: bytearray, start: int, vectors: Floats) -> None:
    blob = vectors.astype("<f4").tobytes()
    data[start : start + len(blob)] = blob


def _text(data: bytes, start: int, room: int) -> str:
    return data[start : start + room].split(b"\0")[0].decode("ascii", "replace").strip()


def _check_positions(positions: Floats, name: str) -> None:
    wrong = ~(np.isfinite(positions) & (np.abs(positions) <= LARGEST_MM)).all(axis=1)
    if wrong.any():
        raise InvalidInputError(f"{name}: marker {int(np.argmax(wrong)) + 1} has no place in mm")
    apart = np.linalg.norm(positions[:, None] - positions[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    if apart.min() < LEAST_DISTANCE_MM:
        i, j = np.unravel_index(int(np.argmin(apart)), apart.shape)
        raise InvalidInputError(f"{name}: markers {i + 1} and {j + 1} are in one place")
