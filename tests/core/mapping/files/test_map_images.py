"""NRRD of maps: places, units and signs in two readers, and a round trip."""

import io

import nrrd
import numpy as np
import pytest

from rona_core.errors import InvalidInputError
from rona_core.mapping.files.map_images import (
    CHANNELS,
    STEP_MM,
    bone_labels,
    bone_seg_nrrd,
    maps_nrrd,
)
from rona_core.mapping.files.map_sheet import BOUNDARIES, MapSheet
from tests.oracles.maps_nrrd import read_maps_nrrd
from tests.scenes.map_sheets import (
    CELL_U_MM,
    CELL_V_MM,
    RADIUS_MM,
    T_BASE_MAP,
    THICKNESS_MM,
    dome_sheet,
)

UM = 1e-3  # a micrometre


@pytest.fixture(scope="module")
def sheet():
    return dome_sheet()


def opened(data):
    file = io.BytesIO(data)
    header = nrrd.read_header(file)
    return header, nrrd.read_data(header, file)


def test_a_round_trip_changes_nothing_beyond_a_micrometre(sheet):
    read = read_maps_nrrd(maps_nrrd(sheet))
    assert set(read) == set(BOUNDARIES)
    for name, boundary in read.items():
        own = sheet.boundary(name)
        np.testing.assert_array_equal(boundary.ok, own.ok)
        np.testing.assert_allclose(boundary.points_base(), own.points_base(), rtol=0.0, atol=UM)


def test_channels_are_what_they_are_called(sheet):
    header, values = opened(maps_nrrd(sheet))
    assert header["channels"].split() == list(CHANNELS)
    assert header["space units"] == ["mm", "mm", "mm"]
    channel = dict(zip(CHANNELS, values[..., 0], strict=True))
    np.testing.assert_array_equal(channel["thickness"], sheet.thickness_mm())
    for name in (*BOUNDARIES, "thickness"):
        np.testing.assert_array_equal(channel[f"sigma_{name}"], sheet.sigma_mm(name)["total"])
    assert np.isnan(channel["inner"]).sum() == (~sheet.maps.inner.ok).sum()


def test_voxels_of_the_bone_lie_between_the_boundaries(sheet):
    header, labels = opened(bone_seg_nrrd(sheet))
    assert (header["space"], header["Segment0_LabelValue"]) == ("left-posterior-superior", "1")
    i, j, k = np.nonzero(labels)
    places = header["space origin"] + np.column_stack((i, j, k)) @ header["space directions"]
    u, v, z = (T_BASE_MAP.inv() @ places).T
    top = RADIUS_MM * (np.sqrt(1.0 - (u**2 + v**2) / RADIUS_MM**2) - 1.0)
    assert (z <= top + 1e-9).all()
    assert (z >= top - THICKNESS_MM - 0.05 * u - 1e-9).all()
    voxel = CELL_U_MM * CELL_V_MM * STEP_MM
    bone = np.nansum(sheet.thickness_mm()) * CELL_U_MM * CELL_V_MM
    assert labels.sum() * voxel == pytest.approx(bone, rel=0.02)
    held = labels.any(axis=2)
    np.testing.assert_array_equal(held, sheet.thickness_ok())


def test_maps_without_inner_boundary_and_too_fine_voxels_are_refused(sheet):
    maps = sheet.maps
    hollow = type(maps)(
        *(getattr(maps, name) for name in maps.__slots__[:5]),
        type(maps.inner)(
            T_BASE_MAP,
            maps.inner.u_mm,
            maps.inner.v_mm,
            maps.inner.height_mm,
            np.zeros_like(maps.inner.ok),
        ),
        maps.fused,
        None,
    )
    with pytest.raises(InvalidInputError, match="both boundaries in some cells, got none"):
        bone_seg_nrrd(MapSheet(hollow, {}))
    with pytest.raises(InvalidInputError, match="voxels"):
        bone_labels(sheet, 1e-5)


def test_simpleitk_finds_the_same_places_and_values(sheet, tmp_path):
    itk = pytest.importorskip("SimpleITK", reason="SimpleITK is not installed: make viewers")
    (tmp_path / "bone.seg.nrrd").write_bytes(bone_seg_nrrd(sheet))
    image = itk.ReadImage(str(tmp_path / "bone.seg.nrrd"))
    _, labels = opened(bone_seg_nrrd(sheet))
    np.testing.assert_array_equal(itk.GetArrayFromImage(image).transpose(2, 1, 0), labels)
    np.testing.assert_allclose(image.GetSpacing(), (CELL_U_MM, CELL_V_MM, STEP_MM))
    cell = (4, 7, 3)
    _, low = bone_labels(sheet, STEP_MM)
    outer = sheet.maps.outer
    place_map = np.array([[outer.u_mm[4], outer.v_mm[7], low + 3 * STEP_MM]])
    np.testing.assert_allclose(
        image.TransformIndexToPhysicalPoint(cell), (T_BASE_MAP @ place_map)[0], atol=UM
    )
    (tmp_path / "maps.nrrd").write_bytes(maps_nrrd(sheet))
    maps = itk.ReadImage(str(tmp_path / "maps.nrrd"))
    assert maps.GetNumberOfComponentsPerPixel() == len(CHANNELS)
    values = itk.GetArrayFromImage(maps)[0].transpose(1, 0, 2)
    np.testing.assert_array_equal(values[..., CHANNELS.index("thickness")], sheet.thickness_mm())
