"""Skulls from files: spheres of known thickness, real skulls, files that must be refused."""

import os
from functools import cache
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pytest
import trimesh

from rona_core.errors import CancelledError, InvalidInputError
from rona_core.session.specimen import SimulatedSkull
from rona_core.virtual.specimen.boundaries import SMOOTH, Relief
from rona_core.virtual.specimen.build_specimen import build_specimen
from rona_core.virtual.specimen.import_skull import import_skull
from rona_core.virtual.specimen.imported import distance_grid as distance
from rona_core.virtual.specimen.imported.distance_grid import grid_about
from rona_core.virtual.specimen.imported.imported_skull import LoadedSpecimen
from rona_core.virtual.specimen.imported.volume_reader import BoneVolume
from tests.helpers.sphere_world import boundary_meshes, signed_distance

pytestmark = pytest.mark.slow

OUTER_MM, INNER_MM = 72.0, 66.0
MIDDLE = np.array((10.0, -20.0, 30.0))
SHARED = Path(os.environ.get("RONA_SHARED", Path(__file__).resolve().parents[4].parent / "shared"))


@cache
def load(path, inner=None, threshold=None):
    return import_skull(path, inner=inner, threshold=threshold, radius_mm=12.0)


def radii(voxel_mm=1.0, half=78):
    side = np.arange(-half, half + 1) * voxel_mm
    x, y, z = np.meshgrid(side, side, side, indexing="ij")
    return np.sqrt(x**2 + y**2 + z**2), -half * voxel_mm * np.ones(3) + MIDDLE


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("skulls")
    r, origin = radii()
    shell = ((r <= OUTER_MM) & (r >= INNER_MM)).astype(np.uint8)
    affine = np.eye(4)
    affine[:3, 3] = origin
    nibabel.save(nibabel.Nifti1Image(shell, affine), place / "shell.nii.gz")
    nibabel.save(nibabel.Nifti1Image((r <= OUTER_MM).astype(np.uint8), affine), place / "head.nii")
    nibabel.save(nibabel.Nifti1Image((r < INNER_MM).astype(np.uint8), affine), place / "cave.nii")
    ramp = 3.0 - np.abs(r - 0.5 * (OUTER_MM + INNER_MM))  # 0 on both surfaces
    grey = np.clip(700.0 + 400.0 * ramp, -1000.0, 2000.0).astype(np.int16)
    nibabel.save(nibabel.Nifti1Image(grey, affine), place / "ct.nii.gz")
    # the same shell, axes turned about and one of them reversed, as NRRD
    turned = np.ascontiguousarray(shell.transpose(2, 0, 1)[:, ::-1])
    directions = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    start = origin + np.array((shell.shape[0] - 1.0, 0.0, 0.0))
    header = {
        "space": "left-posterior-superior",
        "space directions": directions,
        "space origin": start,
    }
    nrrd.write(str(place / "shell.nrrd"), turned, header)
    balls = [trimesh.creation.icosphere(5, radius) for radius in (OUTER_MM, INNER_MM)]
    for ball in balls:
        ball.apply_translation(MIDDLE)
    balls[0].export(place / "outer.stl")
    balls[1].export(place / "inner.stl")
    trimesh.util.concatenate(balls).export(place / "both.ply")
    balls[0].export(place / "outer.obj")
    return place


def disc(specimen, rng, n=60, spread_mm=15.0):
    center, normal = specimen.region.center_skull, specimen.region.normal_skull
    across = np.linalg.svd(normal[None])[2][1:]
    o = center + 8.0 * normal + rng.uniform(-spread_mm, spread_mm, (n, 2)) @ across
    return o, -(o - MIDDLE) / np.linalg.norm(o - MIDDLE, axis=1, keepdims=True)


UNEVEN = Relief(0.1, 0.1, 0.25, 3.0)
# name, inner file, threshold, largest error of a boundary in mm: half a voxel, or triangles
SPHERES = [
    ("shell.nii.gz", None, None, 0.5),
    ("shell.nrrd", None, None, 0.5),
    ("head.nii", "cave.nii", None, 0.5),
    ("ct.nii.gz", None, 700.0, 0.5),
    ("both.ply", None, None, 0.03),
    ("outer.stl", "inner.stl", None, 0.03),
]


@pytest.mark.parametrize(("name", "inner", "threshold", "tolerance"), SPHERES)
def test_concentric_spheres_have_their_radii_and_normals(folder, name, inner, threshold, tolerance):
    second = None if inner is None else folder / inner
    skull = load(folder / name, second, threshold)
    specimen = build_specimen(skull, 0, radius_mm=12.0)
    o, d = disc(specimen, np.random.default_rng(0))
    t = specimen.layers(o, d)
    assert np.isfinite(t).all()
    assert (np.diff(t, axis=1) > 0).all()
    distance = np.linalg.norm(o - MIDDLE, axis=1)
    outer, inner_radius = distance - t[:, 0], distance - t[:, 3]
    assert np.abs(outer - OUTER_MM).max() < tolerance
    assert np.abs(inner_radius - INNER_MM).max() < tolerance
    thickness = specimen.thickness(o + t[:, :1] * d, d)
    assert abs(thickness.mean() - (OUTER_MM - INNER_MM)) < 0.3 * tolerance
    assert np.sqrt(np.mean((outer - OUTER_MM) ** 2)) < 0.55 * tolerance
    np.testing.assert_allclose(thickness, t[:, 3] - t[:, 0], atol=1e-6)
    np.testing.assert_allclose(specimen.ray(o, d), t[:, 0], atol=1e-6)
    assert abs(skull.mean_thickness_mm - (OUTER_MM - INNER_MM)) < 0.3 * tolerance
    cosine = np.einsum("ij,ij->i", specimen.normal(o + t[:, :1] * d), -d)
    degrees = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
    assert np.median(degrees) < (0.5 if tolerance < 0.1 else 6.0)
    q = o + (t[:, :1] + 1.0) * d
    foot = specimen.closest(q)
    assert np.abs(np.linalg.norm(foot - MIDDLE, axis=1) - OUTER_MM).max() < tolerance
    along = np.einsum("ij,ij->i", specimen.normal(foot), -d)
    assert along.min() > 0.95  # outward
    off = np.linalg.norm(np.cross(q - foot, specimen.normal(foot)), axis=1)
    assert off.max() < 0.02
    signed = signed_distance(specimen, np.concatenate((o, q)))
    expected = np.linalg.norm(np.concatenate((o, q)) - MIDDLE, axis=1) - OUTER_MM
    assert np.abs(signed - expected).max() < tolerance
    assert len(skull.sha256) == (1 if inner is None else 2)
    assert skull.kind == ("ct" if threshold else "mesh" if tolerance < 0.1 else "mask")


def test_same_shell_on_turned_axes_lies_at_the_same_place(folder):
    center = MIDDLE + OUTER_MM * np.array((-1.0, 0.2, 0.1)) / np.linalg.norm((-1.0, 0.2, 0.1))
    names = ("shell.nii.gz", "shell.nrrd")
    a, b = (
        build_specimen(import_skull(folder / name, center=center, radius_mm=8.0), 0, radius_mm=8.0)
        for name in names
    )
    o, d = disc(a, np.random.default_rng(4))
    np.testing.assert_allclose(a.layers(o, d), b.layers(o, d), atol=0.01)


def test_only_a_format_whose_axes_are_fixed_says_which_way_the_head_lies(folder):
    nifti, nrrd = (load(folder / name) for name in ("shell.nii.gz", "shell.nrrd"))
    np.testing.assert_array_equal(LoadedSpecimen(nifti, radius_mm=12.0).head_axes_skull, np.eye(3))
    assert LoadedSpecimen(nrrd, radius_mm=12.0).head_axes_skull is None


def test_a_gap_in_the_bone_is_bridged_and_a_wide_one_is_not(tmp_path):
    r, origin = radii(1.5, 52)
    affine = np.diag((1.5, 1.5, 1.5, 1.0))
    affine[:3, 3] = origin
    for gap, thickness in ((4.0, 16.0), (9.0, 6.0)):
        wall = (r <= 72.0) & (r >= 66.0) | (r <= 66.0 - gap) & (r >= 60.0 - gap)
        path = tmp_path / "gap.nii"
        nibabel.save(nibabel.Nifti1Image(wall.astype(np.uint8), affine), path)
        skull = import_skull(path, radius_mm=8.0, center=MIDDLE - np.array([72.0, 0.0, 0.0]))
        assert skull.mean_thickness_mm == pytest.approx(thickness, abs=0.75)  # half a voxel


def test_a_pinhole_is_missing_bone_and_the_disc_avoids_a_hole(tmp_path):
    r, origin = radii(1.5, 52)
    affine = np.diag((1.5, 1.5, 1.5, 1.0))
    affine[:3, 3] = origin
    shell = (r <= OUTER_MM) & (r >= INNER_MM)
    shell[:, 52:55, 52:55] = False  # a tunnel along x through both sides
    path = tmp_path / "hole.nii"
    nibabel.save(nibabel.Nifti1Image(shell.astype(np.uint8), affine), path)
    skull = import_skull(path, radius_mm=10.0, center=MIDDLE + np.array([-70.0, 12.0, 12.0]))
    specimen = build_specimen(skull, 0, radius_mm=10.0)
    o = MIDDLE + np.array([[-80.0, 1.5, 1.5]])
    assert np.isinf(specimen.layers(o, np.array([[1.0, 0.0, 0.0]]))).all()
    chosen = import_skull(path, radius_mm=15.0)
    off = np.linalg.norm((chosen.center_skull - MIDDLE - (0.0, 1.5, 1.5))[1:])
    assert off > 15.0


def test_the_step_from_table_to_diploe_alone_has_relief(folder):
    skull = load(folder / "both.ply", None, None)
    plain, rough = (build_specimen(skull, 0, radius_mm=12.0, relief=r) for r in (SMOOTH, UNEVEN))
    rays = disc(plain, np.random.default_rng(0))
    off = rough.layers(*rays) - plain.layers(*rays)
    assert not off[:, (0, 2, 3)].any()
    assert 0.1 < off[:, 1].std() < 0.4
    other = build_specimen(skull, 1, radius_mm=12.0, relief=UNEVEN)
    assert abs(other.layers(*rays)[:, 1] - rough.layers(*rays)[:, 1]).max() > 0.1


def test_moving_the_centre_within_what_is_stored(folder):
    skull = load(folder / "both.ply", None, None)
    wished = skull.center_skull + np.array([0.0, 6.0, 6.0])
    moved = build_specimen(skull, 0, center_mesh_mm=wished, radius_mm=10.0)
    radius = np.linalg.norm(moved.region.center_skull - MIDDLE)
    assert radius == pytest.approx(OUTER_MM, abs=0.03)
    outward = (moved.region.center_skull - MIDDLE) / radius
    assert moved.region.normal_skull @ outward > 0.999
    with pytest.raises(InvalidInputError, match="load it again with this centre"):
        build_specimen(skull, 0, center_mesh_mm=skull.center_skull + 40.0 * np.eye(3)[1])


def test_the_stored_mesh_is_small_and_lies_on_the_head(folder):
    skull = load(folder / "shell.nii.gz", None, None)
    assert len(skull.mesh_faces) <= 30_000
    radius = np.linalg.norm(skull.mesh_vertices_skull - MIDDLE, axis=1)
    assert np.abs(radius - OUTER_MM).max() < 1.0  # the inside is left out
    assert skull.distance_um.nbytes < 4_000_000
    assert not skull.distance_um.flags.writeable


def test_progress_grows_to_one_and_cancel_stops(folder):
    told: list[float] = []
    import_skull(folder / "shell.nii.gz", radius_mm=8.0, progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0
    with pytest.raises(CancelledError):
        import_skull(folder / "shell.nii.gz", cancel=lambda: True)


REFUSED = [
    ("ct.nii.gz", {}, "give the threshold"),
    ("missing.nrrd", {}, "there is no file"),
    ("notes.txt", {}, "expected a volume"),
    ("broken.nrrd", {}, "could not be read as NRRD"),
    ("broken.nii.gz", {}, "could not be read as NIfTI"),
    ("cut.nii.gz", {}, "could not be read as NIfTI"),
    ("broken.ply", {}, "could not be read as PLY"),
    ("empty.nii", {}, "only the value 0"),
    ("flat.nii", {}, "one volume of at least 8"),
    ("dust.nii", {}, "cm3 of bone"),
    ("metres.nii", {}, "in another unit, as metres"),
    ("open.stl", {}, "is not closed"),
    ("tiny.stl", {}, "it looks like metres"),
    ("outer.stl", {"threshold": 3.0}, "leave threshold and label out"),
    ("inner.stl", {"inner": "outer.stl"}, "lies outside the outer one"),
    ("cave.nii", {"inner": "head.nii"}, "lies outside the outer one"),
    ("outer.stl", {"inner": "cave.nii"}, "both files alike"),
    ("shell.nii.gz", {"radius_mm": 500.0}, "radius_mm must be"),
    ("shell.nii.gz", {"center": (500.0, 0.0, 0.0)}, "must lie on the outer surface"),
    ("shell.nii.gz", {"center": (np.nan, 0.0, 0.0)}, "center must be finite"),
]


@pytest.mark.parametrize(("name", "arguments", "message"), REFUSED)
def test_what_does_not_fit_is_refused_by_name(folder, name, arguments, message):
    eye = np.eye(4)
    write = {
        "notes.txt": lambda p: p.write_text("hello"),
        "broken.nrrd": lambda p: p.write_bytes(
            b"NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nsizes: 9 9 9\n"
            b"space directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n"
            b"encoding: gzip\n\nrubbish"
        ),
        "broken.nii.gz": lambda p: p.write_bytes(b"\x1f\x8b rubbish"),
        "cut.nii.gz": lambda p: p.write_bytes((folder / "shell.nii.gz").read_bytes()[:9000]),
        "broken.ply": lambda p: p.write_bytes(b"ply\nformat ascii 1.0\nelement vert"),
        "empty.nii": lambda p: nibabel.save(nibabel.Nifti1Image(np.zeros((20,) * 3), eye), p),
        "flat.nii": lambda p: nibabel.save(nibabel.Nifti1Image(np.ones((20, 20, 1)), eye), p),
        "dust.nii": lambda p: nibabel.save(
            nibabel.Nifti1Image(np.pad(np.ones((3, 3, 3)), 20), eye), p
        ),
        "metres.nii": lambda p: nibabel.save(
            nibabel.Nifti1Image(np.pad(np.ones((9, 9, 9)), 9), np.diag((1e-3, 1e-3, 1e-3, 1))), p
        ),
        "open.stl": lambda p: trimesh.Trimesh(
            *(lambda b: (b.vertices, b.faces[:-40]))(trimesh.creation.icosphere(3, 70.0))
        ).export(p),
        "tiny.stl": lambda p: trimesh.creation.icosphere(2, 0.07).export(p),
    }
    if name in write:
        write[name](folder / name)
    if "inner" in arguments:
        arguments = {**arguments, "inner": folder / arguments["inner"]}
    with pytest.raises(InvalidInputError, match=message):
        import_skull(folder / name, **arguments)


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("skull_c_mask.nrrd", 4.2, 7.0), ("skull_d_mask.nii.gz", 4.2, 7.5)],
)
def test_real_skulls_have_a_whole_region_of_plausible_thickness(name, low, high):
    path = SHARED / "data" / name
    if not path.is_file():
        pytest.skip(f"{name} is not there: set RONA_SHARED to the folder that holds data/")
    skull = import_skull(path)
    specimen = build_specimen(skull, 0)
    assert low < skull.mean_thickness_mm < high
    assert len(skull.mesh_faces) <= 30_000
    normal = specimen.region.normal_skull
    assert abs(normal[0]) > 0.6  # the side of the head
    across = np.linalg.svd(normal[None])[2][1:]
    lattice = np.stack(np.meshgrid(*2 * [np.arange(-17.0, 18.0, 2.0)]), axis=-1).reshape(-1, 2)
    o = specimen.region.center_skull + lattice @ across + 10.0 * normal
    t = specimen.layers(o, np.repeat(-normal[None], len(o), axis=0))
    assert np.isfinite(t).all()
    assert (np.diff(t, axis=1) > 0).all()
    assert 1.0 < (t[:, 3] - t[:, 0]).min()
    assert (t[:, 3] - t[:, 0]).max() < 15.0


def test_a_simulated_skull_saved_as_a_mesh_keeps_its_thickness(tmp_path):
    truth = build_specimen(SimulatedSkull(), 0)
    path = tmp_path / "saved.ply"
    trimesh.util.concatenate(boundary_meshes(truth, 2.0)).export(path)
    loaded = build_specimen(
        import_skull(path, center=truth.region.center_skull, radius_mm=10.0), 0, radius_mm=10.0
    )
    rng = np.random.default_rng(0)
    across = np.linalg.svd(truth.region.normal_skull[None])[2][1:]
    o = truth.region.center_skull + rng.uniform(-15, 15, (200, 2)) @ across
    o = o + 8.0 * truth.region.normal_skull
    d = np.repeat(-truth.region.normal_skull[None], len(o), axis=0)
    error = loaded.layers(o, d)[:, (0, 3)] - truth.layers(o, d)[:, (0, 3)]
    assert np.sqrt(np.mean(error**2)) < 0.06  # triangles of 2 mm cut off what is between
    assert np.abs(error).max() < 0.4


def capped_shell(folder, name, above):
    """Return a file with a hollow ball about 0, and more bone outside it."""
    side = np.arange(-115.0, 116.0)
    points = np.stack(np.meshgrid(side, side, side, indexing="ij"), axis=-1).astype(np.float32)
    r = np.linalg.norm(points, axis=-1)
    bone = ((r <= OUTER_MM) & (r >= INNER_MM)) | above(points)
    affine = np.eye(4)
    affine[:3, 3] = side[0]
    nibabel.save(nibabel.Nifti1Image(bone.astype(np.uint8), affine), folder / name)
    return import_skull(folder / name, center=(0.0, 0.0, OUTER_MM), radius_mm=12.0)


def test_bone_that_rises_beside_the_disc_is_felt_where_it_is(tmp_path):
    top, hill_mm = np.array((32.0, 0.0, 74.0)), 15.0  # a ball that stands on the shell
    skull = capped_shell(
        tmp_path, "hill.nii.gz", lambda at: np.linalg.norm(at - top, axis=-1) <= hill_mm
    )
    specimen = LoadedSpecimen(skull, radius_mm=12.0)
    above = top + np.array([(0.0, 0.0, 40.0), (-6.0, 0.0, 40.0), (0.0, 6.0, 40.0)])
    t = specimen.ray(above, np.repeat([(0.0, 0.0, -1.0)], len(above), axis=0))
    felt = above - t[:, None] * np.array((0.0, 0.0, 1.0))
    np.testing.assert_allclose(np.linalg.norm(felt - top, axis=1), hill_mm, atol=0.5)
    assert np.linalg.norm(specimen.closest(felt) - felt, axis=1).max() < 0.02


def test_bone_high_above_the_disc_is_not_its_surface_and_dust_takes_no_room(tmp_path):
    def plate(at):
        return (
            (np.abs(at[..., 0]) < 25.0)
            & (np.abs(at[..., 1]) < 25.0)
            & (np.abs(at[..., 2] - 98) < 8)
        )

    def speck(at):
        return np.linalg.norm(at - np.array((5.0, 5.0, 105.0)), axis=-1) <= 3.0

    arched = capped_shell(tmp_path, "plate.nii.gz", plate)
    dusty = capped_shell(tmp_path, "speck.nii.gz", speck)
    for skull in (arched, dusty):
        np.testing.assert_allclose(skull.center_skull, (0.0, 0.0, OUTER_MM), atol=0.5)
        assert skull.mean_thickness_mm == pytest.approx(OUTER_MM - INNER_MM, abs=0.3)
    low, high = dusty.distance_um.shape[2], arched.distance_um.shape[2]
    assert (high - low) * arched.spacing_mm == pytest.approx(106.0 - OUTER_MM + 6.0 - 12.0, abs=2.0)


def slanted_shell(voxel_mm, axes):
    """Return a hollow ball in a box, as fine as a cone beam sees it, and a grid about its top."""
    outward = axes[:, 2]
    half = round(88.0 / voxel_mm)
    squares = (voxel_mm * np.arange(-half, half + 1, dtype=np.float32)) ** 2
    mask = np.zeros((len(squares),) * 3, dtype=np.bool_)
    for i, square in enumerate(squares):
        r2 = square + squares[:, None] + squares
        mask[i] = (r2 <= OUTER_MM**2) & (r2 >= INNER_MM**2)
    affine = np.diag((voxel_mm,) * 3 + (1.0,))
    affine[:3, 3] = -half * voxel_mm
    return BoneVolume(mask, affine, 0, False), OUTER_MM * outward


def test_cubes_of_the_distance_are_as_one(monkeypatch):
    axes = np.linalg.qr(np.array(((1.0, 0.2, 0.5), (0.3, 1.0, 0.6), (-0.4, -0.5, 0.7))))[0]
    bone, center = slanted_shell(1.0, axes)
    grid = grid_about(center, axes[:, 2], 12.0)
    whole, _ = distance.distance_from_volume(bone, grid)
    monkeypatch.setattr(distance, "MOST_CUBE_VOXELS", 120_000)
    monkeypatch.setattr(distance, "MOST_LABELLED", 200_000)
    cubes, _ = distance.distance_from_volume(bone, grid)
    assert (
        np.abs(distance.as_micrometres(whole).astype(int) - distance.as_micrometres(cubes)).max()
        <= 1
    )


@pytest.mark.parametrize(("voxel_mm", "radius_mm"), [(0.5, 15.0), (0.6, 30.0)])
def test_a_slanted_disc_in_fine_voxels_has_its_distance(voxel_mm, radius_mm):
    axes = np.linalg.qr(np.array(((1.0, 0.2, 0.5), (0.3, 1.0, 0.6), (-0.4, -0.5, 0.7))))[0]
    bone, center = slanted_shell(voxel_mm, axes)
    grid = grid_about(center, axes[:, 2], radius_mm)
    found, smoothing_mm = distance.distance_from_volume(bone, grid)
    assert smoothing_mm == pytest.approx(voxel_mm)
    r = np.linalg.norm(grid.nodes(), axis=1).reshape(grid.shape)
    near = np.abs(r - OUTER_MM) < 2.0
    assert np.abs(found - (r - OUTER_MM))[near].max() < 0.75 * voxel_mm
