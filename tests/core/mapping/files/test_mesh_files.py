"""PLY, STL and VTP of maps: what other readers find in them is what was written."""

import base64
import io
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from rona_core.mapping.files.map_mesh import plate_mesh
from rona_core.mapping.files.mesh_files import ply_bytes, stl_bytes, vtp_bytes
from tests.scenes.map_sheets import dome_sheet


@pytest.fixture(scope="module")
def mesh():
    return plate_mesh(dome_sheet())


def test_ply_holds_points_values_and_triangles_unrounded(mesh):
    data = ply_bytes(mesh)
    read = trimesh.load(io.BytesIO(data), file_type="ply", process=False)
    np.testing.assert_array_equal(read.vertices, mesh.points_base)
    np.testing.assert_array_equal(read.faces, mesh.triangles)
    held = read.metadata["_ply_raw"]["vertex"]["data"]
    for name, values in mesh.values.items():
        np.testing.assert_array_equal(held[name], values)
    assert b"comment RONA frame base, mm, SPACE=LPS" in data[:200]


def test_stl_holds_the_triangles_to_a_tenth_of_a_micrometre(mesh):
    read = trimesh.load(io.BytesIO(stl_bytes(mesh)), file_type="stl", process=False)
    corners = mesh.points_base[mesh.triangles]
    np.testing.assert_allclose(read.triangles, corners, rtol=0.0, atol=1e-4)
    out = trimesh.Trimesh(mesh.points_base, mesh.triangles, process=False).face_normals
    np.testing.assert_allclose(read.face_normals, out, atol=1e-3)


def test_vtp_holds_points_values_and_triangles_unrounded(mesh):
    root = ET.fromstring(vtp_bytes(mesh))  # as the standard says: length, then numbers
    assert (root.get("type"), root.get("header_type")) == ("PolyData", "UInt64")
    kinds = {"Float64": "<f8", "Int64": "<i8", "UInt8": "u1"}
    arrays = {}
    for found in root.iter("DataArray"):
        raw = base64.b64decode(found.text)
        assert np.frombuffer(raw[:8], "<u8")[0] == len(raw) - 8
        arrays[found.get("Name")] = np.frombuffer(raw[8:], kinds[found.get("type")])
    np.testing.assert_array_equal(arrays["points_base"].reshape(-1, 3), mesh.points_base)
    np.testing.assert_array_equal(arrays["connectivity"].reshape(-1, 3), mesh.triangles)
    np.testing.assert_array_equal(arrays["offsets"], 3 * np.arange(1, len(mesh.triangles) + 1))
    for name, values in mesh.values.items():
        np.testing.assert_array_equal(arrays[name], values)
    assert root.find(".//Piece").get("NumberOfPoints") == str(len(mesh.points_base))


def test_vtk_reads_the_vtp(mesh, tmp_path):
    vtk = pytest.importorskip("vtk", reason="vtk is not installed: make viewers")
    from vtk.util.numpy_support import vtk_to_numpy

    (tmp_path / "bone.vtp").write_bytes(vtp_bytes(mesh))
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(str(tmp_path / "bone.vtp"))
    reader.Update()
    data = reader.GetOutput()
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), mesh.points_base)
    triangles = vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3)
    np.testing.assert_array_equal(triangles, mesh.triangles)
    for name, values in mesh.values.items():
        np.testing.assert_array_equal(vtk_to_numpy(data.GetPointData().GetArray(name)), values)
    body = vtk.vtkMassProperties()
    body.SetInputData(data)
    own = trimesh.Trimesh(mesh.points_base, mesh.triangles, process=False).volume
    assert body.GetVolume() == pytest.approx(own, rel=1e-6)


@pytest.mark.parametrize("form", ["ply", "stl"])
def test_vtk_reads_the_other_meshes(mesh, tmp_path, form):
    vtk = pytest.importorskip("vtk", reason="vtk is not installed: make viewers")
    write, kind = {"ply": (ply_bytes, vtk.vtkPLYReader), "stl": (stl_bytes, vtk.vtkSTLReader)}[form]
    (tmp_path / f"bone.{form}").write_bytes(write(mesh))
    reader = kind()
    reader.SetFileName(str(tmp_path / f"bone.{form}"))
    reader.Update()
    found = np.array(reader.GetOutput().GetBounds()).reshape(3, 2).T
    expected = np.stack((mesh.points_base.min(axis=0), mesh.points_base.max(axis=0)))
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert reader.GetOutput().GetNumberOfCells() == len(mesh.triangles)
