"""Reader of NDI tool definition files (.rom): marker positions and normals.

Little endian, 752 bytes: "NDI"; at byte 4 the sum of all bytes from 6 on, modulo 65536; largest
marker angle at 24, number of markers at 28, least number at 32, largest 3D error at 36 and least
spreads at 40; positions from 72 and normals from 312, three float32 each, twenty of either; maker
at 580 and part number at 592. The layout is not published by its maker: the offsets are those
that the open readers rajkundu/rom-parser and the tool converter of Johns Hopkins University use.
"""

import struct
from dataclasses import dataclass

import numpy as np

from rona_core.devices.marker_geometry import MarkerGeometry
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly

SIZE = 752
MAX_MARKERS, LEAST_MARKERS = 20, 3
MAGIC = b"NDI"
POSITIONS_AT, NORMALS_AT, MAKER_AT, PART_AT = 72, 312, 580, 592
LARGEST_MM = 2000.0  # a coordinate beyond this is none
LEAST_DISTANCE_MM = 1.0  # markers closer than this are one


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


def rom_from_bytes(data: bytes, name: str = "tool file") -> ToolFile:
    """Read the bytes of a .rom file.

    Files of other writers may leave out what follows the positions, the checksum and the least
    number of markers (zero).

    Raises:
        InvalidInputError: not a .rom file, or a damaged one; it says where.
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


def checksum(data: bytes | bytearray) -> int:
    """Return the sum of all bytes after the checksum, modulo 65536."""
    return sum(data[6:]) % 65536


def _vectors(data: bytes, start: int, count: int) -> Floats:
    return np.frombuffer(data, "<f4", 3 * count, start).reshape(count, 3).astype(np.float64) + 0.0


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
