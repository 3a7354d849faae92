"""Tool files: what is written is read back, and damage is named."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.files.ndi_rom import (
    SIZE,
    ToolFile,
    checksum,
    rom_from_bytes,
)
from rona_core.devices.marker_geometry import GEOMETRIES
from rona_core.errors import InvalidInputError
from tests.helpers.rom_files import rom_bytes, tool_file_of

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
    data = rom_bytes(tool)
    back = rom_from_bytes(data)
    np.testing.assert_array_equal(back.positions_marker, tool.positions_marker.astype(np.float32))
    np.testing.assert_allclose(back.normals_marker, tool.normals_marker, atol=1e-6)
    for name in ("min_markers", "max_angle_deg", "max_3d_error_mm", "min_spread_mm", "maker"):
        assert getattr(back, name) == getattr(tool, name)
    assert back.part == tool.part
    exact = ToolFile(**{n: getattr(back, n) for n in ToolFile.__slots__})
    assert rom_from_bytes(rom_bytes(exact)).positions_marker.tobytes() == (
        back.positions_marker.tobytes()
    )


@pytest.mark.parametrize("name", GEOMETRIES)
def test_the_tools_survive_as_files(name):
    geometry = GEOMETRIES[name]
    back = rom_from_bytes(rom_bytes(tool_file_of(geometry))).geometry(name)
    assert (back.tool, back.dof) == (geometry.tool, geometry.dof)
    np.testing.assert_array_equal(back.positions_marker, geometry.positions_marker)
    np.testing.assert_allclose(back.facing_marker, geometry.facing_marker, atol=1e-6)


def test_a_tilted_line_of_markers_has_five_degrees_of_freedom():
    along = np.array((0.3, -0.5, 0.8)) / np.linalg.norm((0.3, -0.5, 0.8))
    points = np.array((0.0, 60.0, 130.0))[:, None] * along
    assert ToolFile(points, np.zeros((3, 3))).geometry("x").dof == 5


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
        (changed(32, "B", 5), "5 of 4"),
        (changed(84, "<f", float("nan")), "marker 2 has no place"),
        (changed(76, "<f", 1e9), "marker 1 has no place"),
        (changed(72, "<6f", *[7.0] * 6), "markers 1 and 2 are in one place"),
        (changed(312, "<3f", 0.5, 0.5, 0.0), "normal"),
        (changed(36, "<f", float("inf")), "limits"),
    ],
)
def test_damage_is_named(data, words):
    with pytest.raises(InvalidInputError, match=words):
        rom_from_bytes(data)


def test_a_file_with_positions_alone_is_enough():
    data = bytearray(72 + 12 * len(BODY.positions_marker))
    data[:3], data[28] = b"NDI", len(BODY.positions_marker)
    data[72:] = BODY.positions_marker.astype("<f4").tobytes()
    found = rom_from_bytes(bytes(data))
    np.testing.assert_array_equal(found.positions_marker, BODY.positions_marker)
    assert found.min_markers == 3
    assert not found.normals_marker.any()


def test_every_flipped_bit_is_noticed():
    data = rom_bytes(BODY)
    rng = np.random.default_rng(3)
    for at in rng.choice(SIZE, 200, replace=False):
        spoiled = bytearray(data)
        spoiled[at] ^= 1 << int(rng.integers(8))
        if at == 3:
            continue  # between the name and the checksum, a byte without meaning
        with pytest.raises(InvalidInputError):
            rom_from_bytes(bytes(spoiled))
