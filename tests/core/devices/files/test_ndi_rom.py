"""Tool files: what is written is read back, and damage is named."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.files.ndi_rom import SIZE, checksum, rom_positions
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from tests.helpers.rom_files import ToolFile, rom_bytes, tool_file_of

seeds = st.integers(0, 2**32 - 1)
BODY = tool_file_of(GEOMETRIES["toolmarker"])


def changed(at, fmt, *values, tool=BODY, mend=True):
    data = bytearray(rom_bytes(tool))
    struct.pack_into(fmt, data, at, *values)
    if mend:
        struct.pack_into("<H", data, 4, checksum(data))
    return bytes(data)


@settings(max_examples=40)
@given(seeds)
def test_what_is_written_is_read_back(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 21))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals[rng.random(count) < 0.3] = 0.0
    tool = ToolFile(
        rng.uniform(-200, 200, (count, 3)),
        normals,
        min_markers=int(rng.integers(3, count + 1)),
        max_angle_deg=int(rng.integers(0, 181)),
        max_3d_error_mm=float(np.float32(rng.uniform(0.1, 10))),
        min_spread_mm=(1.0, 0.5, 0.25),
        maker="Somebody",
        part="Part 00-7",
    )
    back = rom_positions(rom_bytes(tool))
    np.testing.assert_array_equal(back, tool.positions_marker.astype(np.float32))


def test_the_bytes_are_where_other_readers_look():
    data = rom_bytes(BODY)
    assert len(data) == SIZE
    assert data[:3] == b"NDI"
    assert data[28] == 4
    positions = [struct.unpack_from("<3f", data, 72 + 12 * k) for k in range(4)]
    np.testing.assert_array_equal(positions, GEOMETRIES["toolmarker"].positions_marker)
    assert struct.unpack_from("<H", data, 4)[0] == sum(data[6:]) % 65536
    assert struct.unpack_from("<f", data, 36)[0] == 2.0


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "no .rom file"),
        (b"PNG" + bytes(749), "no .rom file"),
        (rom_bytes(BODY)[:60], "60 bytes"),
        (bytearray(28) + b"\4" + bytes(60), "89 bytes, too few for 4"),
        (rom_bytes(BODY)[:400], "checksum"),
        (changed(80, "<f", 5.0, mend=False), "checksum"),
        (changed(28, "B", 2), "2 markers"),
        (changed(28, "B", 21), "21 markers"),
        (changed(84, "<f", float("nan")), "marker 2 has no place"),
        (changed(76, "<f", 1e9), "marker 1 has no place"),
    ],
)
def test_damage_is_named(data, words):
    with pytest.raises(InvalidInputError, match=words):
        rom_positions(data)


def test_a_file_with_positions_alone_is_enough():
    data = bytearray(72 + 12 * len(BODY.positions_marker))
    data[:3], data[28] = b"NDI", len(BODY.positions_marker)
    data[72:] = BODY.positions_marker.astype("<f4").tobytes()
    np.testing.assert_array_equal(rom_positions(bytes(data)), BODY.positions_marker)


def test_every_flipped_bit_is_noticed():
    data = rom_bytes(BODY)
    rng = np.random.default_rng(3)
    for at in rng.choice(SIZE, 200, replace=False):
        spoiled = bytearray(data)
        spoiled[at] ^= 1 << int(rng.integers(8))
        if at == 3:
            continue  # between the name and the checksum, a byte without meaning
        with pytest.raises(InvalidInputError):
            rom_positions(bytes(spoiled))
