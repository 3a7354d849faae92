"""Skulls that were scanned in a head holder or on a table, and centres that are looked up."""

from dataclasses import replace
from functools import cache

import nibabel
import numpy as np
import pytest
import trimesh

from rona_core.errors import InvalidInputError
from rona_core.virtual.specimen.build_specimen import build_specimen
from rona_core.virtual.specimen.import_skull import import_skull
from rona_core.virtual.specimen.imported.holder_removal import without_holder
from rona_core.virtual.specimen.imported.mesh_reader import inside, read_mesh
from rona_core.virtual.specimen.imported.volume_reader import BoneVolume, read_volume
from tests.core.virtual.specimen.test_import_skull import SHARED

VOXEL_MM, HALF = 2.0, 75  # of the grid: 300 mm wide
RADII_MM = np.array((78.0, 92.0, 80.0))  # of the outer surface
BONE_MM = 7.0
SHIFT_MM = np.array((15.0, -8.0, 4.0))


@cache
def places():
    side = VOXEL_MM * np.arange(-HALF, HALF + 1)
    return np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1)


@cache
def head():
    """Return a head that is open below and on the right, so that the left side is chosen."""
    p = places()
    outer = ((p / RADII_MM) ** 2).sum(axis=-1) <= 1.0
    cavity = ((p / (RADII_MM - BONE_MM)) ** 2).sum(axis=-1) < 1.0
    hole = (p[..., 2] < 0) & (np.hypot(p[..., 0], p[..., 1]) < 20.0)
    craniotomy = (p[..., 0] > 0) & (np.hypot(p[..., 1] + 36.0, p[..., 2] - 6.0) < 16.0)
    return outer & ~cavity & ~hole & ~craniotomy


def ring(height_mm):
    p = places()
    r = np.hypot(p[..., 0], p[..., 1])
    return (r > 118.0) & (r < 130.0) & (np.abs(p[..., 2] - height_mm) < 9.0)


def pins(height_mm):
    """Return four pins from the ring at this height into the bone, 8 mm thick."""
    p = places()
    found = np.zeros(p.shape[:3], dtype=bool)
    for degrees in (40.0, 140.0, 220.0, 320.0):
        way = np.array((np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))))
        along, across = p[..., :2] @ way, p[..., :2] @ np.array((-way[1], way[0]))
        thin = np.hypot(across, p[..., 2] - height_mm) <= 4.0
        solid = thin & head() & (along > 0)
        found |= thin & (along >= along[solid].max() - 1.0) & (along < 122.0)
    return found


def table(gap_mm):
    y = places()[..., 1]
    return (y > RADII_MM[1] + gap_mm) & (y < RADII_MM[1] + gap_mm + 24.0)


HOLDERS = {
    "table, ring and pins": lambda: table(-3.0) | ring(45.0) | pins(45.0),
    "ring": lambda: ring(20.0),
    "ring before the region": lambda: ring(-2.0),
    "ring with pins": lambda: ring(45.0) | pins(45.0),
    "table": lambda: table(10.0),
    "table that touches": lambda: table(-3.0),
    "plate beside the head": lambda: (places()[..., 0] > 100.0) & (places()[..., 0] < 112.0),
}


def saved(mask, path):
    affine = np.diag((VOXEL_MM,) * 3 + (1.0,))
    affine[:3, 3] = places()[0, 0, 0] + SHIFT_MM
    nibabel.save(nibabel.Nifti1Image(mask.astype(np.uint8), affine), path)
    return path


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    return saved(head(), tmp_path_factory.mktemp("head") / "head.nii.gz")


def test_a_head_without_a_holder_is_left_as_it_is(alone):
    bone = read_volume(alone, None)
    freed = without_holder(bone)
    assert freed.bone is bone
    assert len(freed.cuts_upright) == 0


@pytest.mark.sweep(1)
@pytest.mark.parametrize("name", HOLDERS)
def test_a_holder_is_taken_away_and_the_head_is_not(name, tmp_path):
    holder = HOLDERS[name]() & ~head()
    freed = without_holder(read_volume(saved(head() | holder, tmp_path / "held.nii"), None))
    assert (freed.bone.mask & head()).sum() == head().sum()
    left = freed.bone.mask & holder
    assert left.sum() < 0.03 * holder.sum()
    # what is left lies against the head, where something was cut off
    cuts = freed.bone.T_skull_upright @ freed.cuts_upright
    apart = places()[left] + SHIFT_MM
    for place in apart[:: max(1, len(apart) // 50)]:
        assert np.linalg.norm(cuts - place, axis=1).min() < 40.0


@pytest.fixture(scope="module")
def expected(alone):
    return import_skull(alone, radius_mm=18.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", HOLDERS)
def test_the_same_region_is_chosen_as_without_the_holder(name, expected, tmp_path):
    held = saved(head() | HOLDERS[name](), tmp_path / "held.nii")
    found = import_skull(held, radius_mm=18.0)
    np.testing.assert_allclose(found.center_skull, expected.center_skull, atol=0.05)
    other = np.abs(found.distance_um - expected.distance_um.astype(float)) > 10.0
    assert other.mean() < 0.01  # pins are cut off a little outside the bone
    assert found.mean_thickness_mm == pytest.approx(expected.mean_thickness_mm, abs=1e-3)


@pytest.mark.slow
def test_a_given_centre_is_found_behind_the_holder(tmp_path):
    way = np.array((-1.0, 0.1, 0.15))
    way /= np.linalg.norm(way)
    center = way / np.linalg.norm(way / RADII_MM) + SHIFT_MM
    held = saved(head() | ring(12.0), tmp_path / "held.nii")
    skull = import_skull(held, center=center, radius_mm=15.0)
    assert np.linalg.norm(skull.center_skull - center) < 2.0
    assert skull.mean_thickness_mm == pytest.approx(BONE_MM, abs=0.6)


def test_a_disc_where_the_head_was_held_is_refused(tmp_path):
    held = saved(head() | table(-3.0), tmp_path / "held.nii")
    center = np.array((0.0, RADII_MM[1], 0.0)) + SHIFT_MM
    with pytest.raises(InvalidInputError, match="reaches to where the head was held"):
        import_skull(held, center=center, radius_mm=15.0)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("off_mm", [6.0, 12.0, -11.0, -30.0])
def test_a_centre_off_the_bone_is_refused_with_its_distance(alone, off_mm):
    center = np.array((-RADII_MM[0] - off_mm, 0.0, 0.0)) + SHIFT_MM
    away = off_mm if off_mm > 0 else -off_mm - BONE_MM
    with pytest.raises(InvalidInputError, match="from the nearest bone") as caught:
        import_skull(alone, center=center, radius_mm=15.0)
    told = float(str(caught.value).split("but it is ")[1].split(" mm")[0])
    assert told == pytest.approx(away, abs=1.5 * VOXEL_MM)


@pytest.mark.slow
def test_a_centre_of_a_loaded_skull_off_its_bone_is_refused_with_its_distance(alone):
    skull = import_skull(alone, radius_mm=10.0)
    lifted = skull.center_skull + 6.0 * skull.normal_skull
    with pytest.raises(InvalidInputError, match=r"6\.\d mm above it"):
        build_specimen(skull, 0, center_mesh_mm=lifted, radius_mm=10.0)
    near = skull.center_skull + 1.0 * skull.normal_skull
    assert build_specimen(skull, 0, center_mesh_mm=near, radius_mm=10.0).region is not None


def tilted(degrees):
    """Return the turn of a head about x."""
    cosine, sine = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.eye(4)
    turn[1:3, 1:3] = ((cosine, -sine), (sine, cosine))
    return turn


def face():
    """Return a face below the forehead, in front, as much before the head as real ones are."""
    x, y, z = np.moveaxis(places(), -1, 0)
    reach = ((places() / (RADII_MM + 42.0)) ** 2).sum(axis=-1) <= 1.0
    return reach & (np.abs(x) < 40.0) & (y > -100.0) & (y < -60.0) & (z > -104.0) & (z < -24.0)


TILTS = (-25.0, -15.0, 0.0, 15.0, 25.0, 90.0)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("degrees", [*TILTS, -90.0])
def test_the_face_of_a_tilted_head_is_no_holder(degrees):
    affine = tilted(degrees) @ np.diag((VOXEL_MM,) * 3 + (1.0,))
    bone = BoneVolume(head() | face(), affine, 0, False)
    assert without_holder(bone).bone is bone


@pytest.mark.sweep(1)
@pytest.mark.skipif(not SHARED.is_dir(), reason="the real skulls are not here")
@pytest.mark.parametrize("degrees", TILTS)
@pytest.mark.parametrize("name", ["skull_c_mask.nrrd", "skull_d_mask.nii.gz"])
def test_real_skulls_have_no_holder(name, degrees):
    bone = read_volume(SHARED / "data" / name, None)
    bone = replace(bone, T_upright_voxel=tilted(degrees) @ bone.T_upright_voxel)
    assert without_holder(bone).bone is bone


@pytest.mark.sweep(1)
@pytest.mark.parametrize("radius_mm", [146.0, 150.0, 165.0])
def test_a_ball_that_is_no_head_is_left_as_it_is(radius_mm):
    side = 4.0 * np.arange(-43, 44)
    r = np.linalg.norm(np.meshgrid(side, side, side, indexing="ij"), axis=0)
    bone = BoneVolume((r <= radius_mm) & (r > radius_mm - 12.0), np.diag((4, 4, 4, 1.0)), 0, False)
    assert without_holder(bone).bone is bone


def test_a_plate_about_a_ball_that_is_no_head_is_no_error():
    side = 4.0 * np.arange(-60, 61)
    grid = np.meshgrid(side, side, side, indexing="ij")
    r = np.linalg.norm(grid, axis=0)
    shell = (r <= 165.0) & (r > 153.0)
    bone = BoneVolume(shell | (grid[0] > 200.0), np.diag((4, 4, 4, 1.0)), 0, False)
    assert (without_holder(bone).bone.mask & shell).sum() == shell.sum()


def touching_balls():
    """Return a hollow ball, and a wedge that touches it along one edge of its surface."""
    outer, inner = (trimesh.creation.icosphere(4, radius) for radius in (72.0, 66.0))
    ball = trimesh.util.concatenate((outer, inner))
    a, b = outer.vertices[outer.edges_unique[0]]
    out = (a + b) / np.linalg.norm(a + b)
    side = np.cross(b - a, out)
    side /= np.linalg.norm(side)
    corners = np.array((a, b, a + 12.0 * out + 6.0 * side, a + 12.0 * out - 6.0 * side))
    wedge = trimesh.convex.convex_hull(corners)
    return trimesh.util.concatenate((ball, wedge)), corners.mean(axis=0)


@pytest.mark.slow
def test_sheets_that_touch_along_an_edge_are_loaded(tmp_path):
    mesh, within = touching_balls()
    mesh.export(tmp_path / "touching.ply")
    read = read_mesh(tmp_path / "touching.ply")
    sides = np.sort(read.faces[:, (0, 1, 1, 2, 2, 0)].reshape(-1, 2), axis=1)
    assert np.unique(sides, axis=0, return_counts=True)[1].max() == 4
    points = np.array((within, (0.0, 69.0, 0.0), (0.0, 60.0, 0.0), (90.0, 0.0, 0.0), -within))
    solid = inside(read, points, np.array((0.0, 0.0, 0.5)), 1)[:, 0]
    assert solid.tolist() == [True, True, False, False, False]
    skull = import_skull(tmp_path / "touching.ply", center=(0.0, -72.0, 0.0), radius_mm=8.0)
    assert skull.mean_thickness_mm == pytest.approx(6.0, abs=0.1)
