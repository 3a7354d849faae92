"""NRRD of an echo volume, read by pynrrd: a known echo is where it is in space."""

import io

import nrrd
import numpy as np
import pytest

from rona_core.mapping.volume.echo_volume import volume_nrrd
from rona_core.mapping.volume.reconstruction import reconstruct_volume
from tests.scenes.volume_lines import PROBE, T_BASE_MAP, plate


@pytest.fixture(scope="module")
def file():
    lines, outer = plate(6.0)
    lines.profiles.level[115] *= 0.0  # the A-scan at the origin of the map
    lines.profiles.level[115, 145:156] = 7.0 - np.abs(np.arange(-5, 6))  # about 3 us, 4.05 mm deep
    volume = reconstruct_volume(lines, outer, PROBE)
    data = volume_nrrd(volume, {"probe": "2.25MHz"})
    read = io.BytesIO(data)
    header = nrrd.read_header(read)
    return volume, nrrd.read_data(header, read), header, data


def test_pynrrd_reads_the_amplitudes_bit_by_bit(file):
    volume, values, header, data = file
    assert data.startswith(b"NRRD000")
    np.testing.assert_array_equal(values, volume.amplitude)
    assert header["type"] == "float"
    assert list(header["kinds"]) == ["space"] * 3
    assert list(header["space units"]) == ["mm"] * 3
    assert header["frame"] == "base"
    assert header["probe"] == "2.25MHz"
    assert header["content"].startswith("echo amplitude")


def test_a_known_echo_is_where_it_is_in_space(file):
    _, values, header, _ = file
    index = np.array(np.unravel_index(np.argmax(values), values.shape))
    place = header["space origin"] + index @ header["space directions"]
    known = T_BASE_MAP @ np.array([[0.0, 0.0, -4.05]])
    assert np.linalg.norm(place - known[0]) < 0.15  # a voxel is 0.25 mm high


def test_directions_are_the_axes_of_the_map_in_voxels(file):
    volume, _, header, _ = file
    directions = header["space directions"]
    np.testing.assert_allclose(
        directions, np.diag((1.0, 1.0, 0.25)) @ T_BASE_MAP.rotation.T, atol=1e-12
    )
    out = T_BASE_MAP.rotate(np.array([[0.0, 0.0, 1.0]]))[0]
    assert directions[2] @ out > 0.0  # z counts out of the bone
    corner = volume.outer.u_mm[0], volume.outer.v_mm[0], volume.z_mm[0]
    np.testing.assert_allclose(header["space origin"], (T_BASE_MAP @ np.array([corner]))[0])
