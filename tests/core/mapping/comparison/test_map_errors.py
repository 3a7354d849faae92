"""Maps of concentric spheres against meshes of spheres: errors known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.mapping.comparison.map_errors import NAMES, MapErrors, compare_with_bone, figures_of
from rona_core.mapping.comparison.reference_bone import (
    ReferenceBone,
    bone_of_mesh,
    check_extent,
    place_reference,
)
from rona_core.mapping.files.map_mesh import plate_mesh
from rona_core.mapping.files.map_sheet import MapSheet

T_BASE_MAP = Pose.from_rotvec((0.4, -0.7, 1.9), (612.3, -48.1, 255.5))
OUTER_MM, INNER_MM = 80.0, 74.0
CENTRE_MAP = np.array((0.0, 0.0, -OUTER_MM))
FACETS_MM = 0.006  # by which a facet lies inside of its sphere
OFF = Pose.from_rotvec((0.02, -0.03, 0.04), (2.0, -1.0, 1.5))


def maps_of_spheres():
    u, v = np.arange(-20.0, 20.5, 1.0), np.arange(-16.0, 16.5, 1.0)
    square = u[:, None] ** 2 + v[None, :] ** 2
    heights = [np.sqrt(r**2 - square) - OUTER_MM for r in (OUTER_MM, INNER_MM)]
    ok = np.ones(square.shape, dtype=bool)
    ok[:2], ok[:, :1] = False, False
    outer, inner = (BoundaryMap(T_BASE_MAP, u, v, height, ok) for height in heights)
    none, nobody = np.zeros((0, 3)), np.zeros(0, dtype=bool)
    return Maps(none, none, nobody, nobody, outer, inner, outer, None)


def ball(radius_mm, *, inside_out=False, in_base=True):
    found = trimesh.creation.icosphere(subdivisions=6, radius=radius_mm)
    faces = found.faces[:, ::-1] if inside_out else found.faces
    centre = T_BASE_MAP @ CENTRE_MAP if in_base else CENTRE_MAP
    return Mesh(np.asarray(found.vertices) + centre, np.asarray(faces, dtype=np.int64))


def shell(outer_mm, inner_mm):
    a, b = ball(outer_mm), ball(inner_mm, inside_out=True)
    faces = np.vstack((a.faces, b.faces + len(a.vertices)))
    return bone_of_mesh(Mesh(np.vstack((a.vertices, b.vertices)), faces))


def cap(mesh, keep):
    """Return an open piece of a mesh: triangles whose centres are kept."""
    centres = T_BASE_MAP.inv() @ mesh.vertices[mesh.faces].mean(axis=1)
    return Mesh(mesh.vertices, mesh.faces[keep(centres)])


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("outer_mm", "inner_mm"), [(80.4, 73.8), (79.7, 74.0), (80.0, 74.0)])
def test_errors_are_the_differences_of_the_radii(outer_mm, inner_mm):
    maps = maps_of_spheres()
    found = compare_with_bone(maps, shell(outer_mm, inner_mm))
    assert set(found.errors_mm) == set(NAMES)
    ok = maps.outer.ok
    wanted = {
        "outer": OUTER_MM - outer_mm,
        "fused": OUTER_MM - outer_mm,
        "inner": INNER_MM - inner_mm,
        "thickness": (OUTER_MM - INNER_MM) - (outer_mm - inner_mm),
    }
    for name, error_mm in wanted.items():
        values = found.errors_mm[name]
        assert np.isnan(values[~ok]).all()
        known = np.isfinite(values[ok])
        assert known.mean() > 0.9  # the thickness of the map itself ends at its rim
        np.testing.assert_allclose(values[ok][known], error_mm, atol=0.02)  # slopes by differences
    rows = {row.name: row for row in figures_of(maps, found, {"outer": np.full(ok.shape, 0.25)})}
    assert rows["outer"].coverage == 1.0
    assert rows["outer"].bias_mm == pytest.approx(wanted["outer"], abs=FACETS_MM)
    assert rows["outer"].stated_mm == pytest.approx(0.25)
    assert rows["inner"].stated_mm is None
    assert rows["thickness_nearest"].bias_mm == pytest.approx(wanted["thickness"], abs=0.02)


def test_figures_are_those_of_the_cells_that_the_reference_knows():
    maps = maps_of_spheres()
    rng = np.random.default_rng(3)
    errors = rng.normal(0.1, 0.2, maps.outer.ok.shape)
    errors[5:9] = np.nan
    (row,) = figures_of(maps, MapErrors({"outer": errors}))
    known = errors[maps.outer.ok & np.isfinite(errors)]
    assert row.cells == maps.outer.ok.sum()
    assert row.coverage == pytest.approx(len(known) / row.cells)
    assert row.bias_mm == pytest.approx(known.mean())
    assert row.rms_mm == pytest.approx(np.hypot(row.bias_mm, row.spread_mm))
    assert row.p95_mm == pytest.approx(np.quantile(np.abs(known), 0.95))
    (nothing,) = figures_of(maps, MapErrors({"outer": np.full(errors.shape, np.nan)}))
    assert (nothing.coverage, nothing.rms_mm) == (0.0, None)


@pytest.mark.parametrize("inside_out", [False, True])
def test_an_open_sheet_is_the_outer_table_as_far_as_it_goes(inside_out):
    maps = maps_of_spheres()
    half = cap(ball(OUTER_MM, inside_out=inside_out), lambda c: (c[:, 0] > 0.0) & (c[:, 2] > -30.0))
    bone = bone_of_mesh(half)
    assert bone.inner is None
    found = compare_with_bone(maps, bone)
    assert set(found.errors_mm) == {"outer", "fused"}
    known = np.isfinite(found.errors_mm["outer"])
    assert known[maps.outer.u_mm > 1.0].sum() == maps.outer.ok[maps.outer.u_mm > 1.0].sum()
    assert not known[maps.outer.u_mm < -1.5].any()


def test_side_walls_of_a_plate_are_no_table():
    maps = maps_of_spheres()
    held = replace(maps.inner, ok=maps.inner.ok & (np.abs(maps.inner.u_mm)[:, None] < 12.0))
    plate = plate_mesh(MapSheet(replace(maps, inner=held), {}))
    bone = bone_of_mesh(Mesh(plate.points_base, plate.triangles))
    assert bone.inner is bone.outer
    errors = compare_with_bone(maps, bone).errors_mm
    for name in ("outer", "inner", "thickness"):
        values = errors[name][np.isfinite(errors[name])]
        assert len(values) > 500
        assert np.abs(values).max() < 0.05


@pytest.mark.sweep(1)
@pytest.mark.parametrize("how", ["points", "surface", "both"])
def test_a_reference_in_another_frame_is_laid_under_the_map(how):
    """A sphere says nothing of turns about its centre: an ellipsoid does."""
    maps = maps_of_spheres()
    u, v = np.meshgrid(maps.outer.u_mm, maps.outer.v_mm, indexing="ij")
    waves = 0.8 * np.sin(u / 6.0) * np.cos(v / 5.0)
    outer = replace(maps.outer, height_mm=maps.outer.height_mm + waves)
    maps = replace(maps, outer=outer, fused=outer)
    plate = plate_mesh(MapSheet(maps, {}))
    there = bone_of_mesh(Mesh(plate.points_base, plate.triangles)).moved(
        OFF if how == "surface" else OFF @ T_BASE_MAP.inv()
    )
    named = T_BASE_MAP @ np.array(((0.0, 0.0, 0.0), (20.0, 3.0, 1.0), (-4.0, 15.0, 2.0)))
    pairs = (OFF @ T_BASE_MAP.inv() @ named, named)
    place = place_reference(there, maps, how, None if how == "surface" else pairs)
    assert (place.points_rms_mm is None) == (how == "surface")
    assert (place.surface is None) == (how == "points")
    (outer_row, *_) = figures_of(maps, compare_with_bone(maps, there.moved(place.T_base_mesh)))
    assert outer_row.rms_mm < 0.02
    assert outer_row.coverage > 0.9


def test_what_cannot_be_compared_is_refused_by_name():
    maps, bone = maps_of_spheres(), shell(OUTER_MM, INNER_MM)
    with pytest.raises(InvalidInputError, match="points in both frames"):
        place_reference(bone, maps, "points")
    two = T_BASE_MAP @ np.array(((0.0, 0.0, 0.0), (20.0, 3.0, 1.0)))
    with pytest.raises((InvalidInputError, DegenerateGeometryError)):
        place_reference(bone, maps, "points", (two, two))
    away = bone.moved(Pose.from_translation((0.0, 900.0, 0.0)))
    with pytest.raises(DegenerateGeometryError, match="in the frame of the robot's base"):
        compare_with_bone(maps, away)
    with pytest.raises(DegenerateGeometryError, match="register by points first"):
        place_reference(away, maps, "surface")
    with pytest.raises(InvalidInputError, match="check the unit"):
        check_extent(Mesh(bone.outer.vertices / 1000.0, bone.outer.faces), "metres.stl")
    with pytest.raises(InvalidInputError, match="no triangles"):
        check_extent(Mesh(bone.outer.vertices, np.zeros((0, 3), dtype=np.int64)), "empty.stl")
    both = ReferenceBone(bone.outer, bone.inner)
    assert compare_with_bone(maps, both).errors_mm["outer"].shape == maps.outer.ok.shape
