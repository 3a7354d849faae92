"""Meshes of maps: where they lie, which way they face, and that the bone is a body."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.mapping.files.map_mesh import boundary_mesh, plate_mesh
from rona_core.mapping.files.map_sheet import BOUNDARIES, MapSheet
from tests.scenes.map_sheets import CELL_U_MM, CELL_V_MM, RADIUS_MM, T_BASE_MAP, dome_sheet


def solid(mesh):
    return trimesh.Trimesh(mesh.points_base, mesh.triangles, process=False)


@pytest.mark.parametrize("name", BOUNDARIES)
def test_corners_lie_on_the_boundary_and_normals_point_out_of_the_bone(name):
    sheet = dome_sheet()
    mesh = boundary_mesh(sheet, name)
    assert len(mesh.points_base) == sheet.boundary(name).ok.sum()
    up = T_BASE_MAP.rotation[:, 2]
    assert (solid(mesh).face_normals @ up > 0.9).all()
    if name != "inner":
        centre_base = T_BASE_MAP @ np.array([[0.0, 0.0, -RADIUS_MM]])
        np.testing.assert_allclose(
            np.linalg.norm(mesh.points_base - centre_base, axis=1), RADIUS_MM, atol=1e-9
        )


def test_the_bone_is_closed_and_as_large_as_thickness_over_area():
    sheet = dome_sheet()
    body = solid(plate_mesh(sheet))
    assert body.is_watertight
    assert body.is_winding_consistent
    thickness, ok = sheet.thickness_mm(), sheet.thickness_ok()
    squares = np.stack([ok[i : ok.shape[0] - 1 + i, j : ok.shape[1] - 1 + j] for i, j in CORNERS])
    whole = squares.all(axis=0)
    # the plane through three corners of a triangle: a third of each, over half a square
    low, right, left, high = (
        thickness[i : thickness.shape[0] - 1 + i, j : thickness.shape[1] - 1 + j]
        for i, j in CORNERS
    )
    columns = (2.0 * low + 2.0 * high + right + left) / 6.0
    triangles = (low + right + high) / 6.0, (low + left + high) / 6.0
    lone = [squares[[0, 1, 3]].all(axis=0) & ~whole, squares[[0, 2, 3]].all(axis=0) & ~whole]
    expected = columns[whole].sum() + sum(
        part[one].sum() for part, one in zip(triangles, lone, strict=True)
    )
    assert body.volume == pytest.approx(expected * CELL_U_MM * CELL_V_MM, rel=1e-9)


CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))


@pytest.mark.parametrize("seed", range(5))
def test_the_bone_is_closed_whatever_cells_are_missing(seed):
    sheet = dome_sheet(hole=False)
    random = np.random.default_rng(seed).random(sheet.maps.inner.ok.shape) < 0.7
    maps = replace(sheet.maps, inner=replace(sheet.maps.inner, ok=random))
    body = solid(plate_mesh(MapSheet(maps, sheet.sigmas)))
    assert body.is_watertight
    assert body.is_winding_consistent
    assert body.volume > 0.0


def test_values_belong_to_their_corners():
    sheet = dome_sheet()
    mesh, n = plate_mesh(sheet), len(plate_mesh(sheet).points_base) // 2
    np.testing.assert_allclose(mesh.values["sigma_mm"][n:], 2.0 * mesh.values["sigma_mm"][:n])
    along = T_BASE_MAP.rotation[:, 2]
    apart = (mesh.points_base[:n] - mesh.points_base[n:]) @ along
    np.testing.assert_allclose(mesh.values["thickness_mm"][:n], apart, atol=1e-9)


def test_what_is_not_known_is_no_number():
    sheet = MapSheet(dome_sheet().maps, {})
    mesh = boundary_mesh(sheet, "fused")
    assert np.isnan(mesh.values["sigma_mm"]).all()
    assert 0 < np.isnan(mesh.values["thickness_mm"]).sum() < len(mesh.points_base)


def test_maps_without_an_area_and_of_several_grids_are_refused():
    sheet = dome_sheet()
    line = np.zeros_like(sheet.maps.outer.ok)
    line[3] = True
    outer = replace(sheet.maps.outer, ok=line)
    with pytest.raises(DegenerateGeometryError, match="17 cells are mapped, and no three"):
        boundary_mesh(MapSheet(replace(sheet.maps, outer=outer), {}), "outer")
    small = replace(sheet.maps.inner, ok=line[:5])
    with pytest.raises(InvalidInputError, match="one grid"):
        MapSheet(replace(sheet.maps, inner=small), {})
