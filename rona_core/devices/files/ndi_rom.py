"""Reader of NDI tool definition files (.rom): marker positions.

Little endian, 752 bytes: "NDI"; at byte 4 the sum of all bytes from 6 on, modulo 65536; the number
of markers at 28; positions from 72, three float32 each, twenty at most. The layout is not published
by its maker: the offsets are those that the open readers rajkundu/rom-parser and the tool converter
of Johns Hopkins University use.
"""

import struct

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, readonly

SIZE = 752
MAX_MARKERS, LEAST_MARKERS = 20, 3
MAGIC = b"NDI"
POSITIONS_AT = 72
LARGEST_MM = 2000.0  # a coordinate beyond this is none


def rom_positions(data: bytes, name: str = "tool file") -> Floats:
    """Return the marker positions (m, 3) in mm of the bytes of a .rom file.

    Files of other writers may leave out what follows the positions, and the checksum.

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
    if len(data) < POSITIONS_AT + 12 * count:
        raise InvalidInputError(f"{name} has {len(data)} bytes, too few for {count} markers")
    if not LEAST_MARKERS <= count <= MAX_MARKERS:
        raise InvalidInputError(
            f"{name} names {count} markers in byte 28, possible are {LEAST_MARKERS} to "
            f"{MAX_MARKERS}"
        )
    packed = np.frombuffer(data, "<f4", 3 * count, POSITIONS_AT)
    positions = packed.reshape(count, 3).astype(np.float64) + 0.0  # adding zero turns -0 into 0
    _check_positions(positions, name)
    return readonly(positions)


def checksum(data: bytes | bytearray) -> int:
    """Return the sum of all bytes after the checksum, modulo 65536."""
    return sum(data[6:]) % 65536


def _check_positions(positions: Floats, name: str) -> None:
    wrong = ~(np.isfinite(positions) & (np.abs(positions) <= LARGEST_MM)).all(axis=1)
    if wrong.any():
        raise InvalidInputError(f"{name}: marker {int(np.argmax(wrong)) + 1} has no place in mm")
