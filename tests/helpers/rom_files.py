"""Writer of NDI tool definition files (.rom), the counterpart of the product's reader."""

import struct
from dataclasses import dataclass

import numpy as np

from rona_core.devices.files.ndi_rom import MAGIC, POSITIONS_AT, SIZE, checksum

NORMALS_AT, MAKER_AT, PART_AT = 312, 580, 592
FACES_AT, GROUPS_AT = 613, 633
FIXED = {8: 1, 12: 2, 576: 9, 612: 9, 653: 128, 655: 41}  # as present files have them
LEDS_AT, NO_LED = range(572, 576), 31


@dataclass(frozen=True)
class ToolFile:
    """What a .rom file says of a tool."""

    positions_marker: np.ndarray  # (m, 3)
    normals_marker: np.ndarray  # (m, 3) unit, or zero where a marker is seen from every side
    min_markers: int = 3
    max_angle_deg: int = 90
    max_3d_error_mm: float = 2.0
    min_spread_mm: tuple = (0.0, 0.0, 0.0)
    maker: str = ""
    part: str = ""


def tool_file_of(geometry):
    """Return what a .rom file would say of one of the known tools."""
    facing = geometry.facing_marker
    return ToolFile(
        geometry.positions_marker,
        np.tile(facing, (len(geometry.positions_marker), 1)),
        max_angle_deg=60 if facing.any() else 180,
        maker="RONA",
        part=geometry.tool,
    )


def rom_bytes(tool):
    """Return the bytes of a .rom file; coordinates are rounded to float32."""
    count = len(tool.positions_marker)
    data = bytearray(SIZE)
    data[:3] = MAGIC
    for place, value in FIXED.items():
        data[place] = value
    for place in LEDS_AT:
        data[place] = NO_LED
    data[24], data[28], data[32] = tool.max_angle_deg, count, tool.min_markers
    struct.pack_into("<4f", data, 36, tool.max_3d_error_mm, *tool.min_spread_mm)
    for start, vectors in (
        (POSITIONS_AT, tool.positions_marker),
        (NORMALS_AT, tool.normals_marker),
    ):
        blob = vectors.astype("<f4").tobytes()
        data[start : start + len(blob)] = blob
    data[552 : 552 + count] = bytes(range(count))
    data[FACES_AT : FACES_AT + count] = bytes([1] * count)
    data[GROUPS_AT : GROUPS_AT + count] = bytes([1] * count)
    for text, place in ((tool.maker, MAKER_AT), (tool.part, PART_AT)):
        data[place : place + len(text)] = text.encode("ascii")
    struct.pack_into("<H", data, 4, checksum(data))
    return bytes(data)
