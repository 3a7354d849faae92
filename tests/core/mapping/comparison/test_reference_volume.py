"""A reference from a volume: concentric spheres as CT and as mask, and what is refused."""

import nibabel
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.mapping.comparison import reference_volume
from rona_core.mapping.comparison.reference_volume import bone_of_volume

OUTER, INNER, VOXEL = 70.0, 64.0, 0.6
MIDDLE = np.array((5.0, -3.0, 8.0))
POINTS = MIDDLE + OUTER * np.array(((0.0, 0.0, 1.0), (0.1, 0.0, 0.995), (0.0, -0.1, 0.995)))


def nifti(values, affine):
    image = nibabel.Nifti1Image(values, affine)
    image.header.set_xyzt_units("mm")
    return image.to_bytes()


def shell(mirrored=False):
    """Return CT numbers (a, b, c) of a shell of bone, blurred over a voxel, and its affine."""
    turned = Rotation.from_rotvec((0.2, -0.1, 0.4)).as_matrix()
    affine = np.eye(4)
    affine[:3, :3] = VOXEL * turned @ np.diag((-1.0 if mirrored else 1.0, 1.0, 1.0))
    half = np.array((60, 60, 70))
    affine[:3, 3] = MIDDLE + (0.0, 0.0, 50.0) - affine[:3, :3] @ half
    index = np.stack(np.meshgrid(*(np.arange(2 * n) for n in half), indexing="ij"), axis=-1)
    radius = np.linalg.norm(index @ affine[:3, :3].T + affine[:3, 3] - MIDDLE, axis=-1)
    bone = np.clip((OUTER - radius) / VOXEL + 0.5, 0.0, 1.0)
    bone *= np.clip((radius - INNER) / VOXEL + 0.5, 0.0, 1.0)
    return (-1000.0 + 2000.0 * bone).astype(np.float32), affine


def radii(bone):
    return np.linalg.norm(bone.outer.vertices - MIDDLE, axis=1)


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_ct_has_both_tables_finer_than_its_voxels_and_facing_out_of_the_bone(mirrored):
    bone = bone_of_volume(nifti(*shell(mirrored)), "ct.nii", POINTS, 0.0)
    assert bone.inner is bone.outer
    outer = radii(bone) > 0.5 * (OUTER + INNER)
    np.testing.assert_allclose(radii(bone)[outer], OUTER, atol=0.05)
    np.testing.assert_allclose(radii(bone)[~outer], INNER, atol=0.05)
    corners = bone.outer.vertices[bone.outer.faces] - MIDDLE
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = np.einsum("ni,ni->n", normals, corners.mean(axis=1)) > 0.0
    np.testing.assert_array_equal(outward, outer[bone.outer.faces[:, 0]])


def test_a_mask_needs_no_threshold_and_is_within_a_voxel():
    values, affine = shell()
    bone = bone_of_volume(nifti((values > 0.0).astype(np.uint8), affine), "mask.nii", POINTS)
    off = np.minimum(np.abs(radii(bone) - OUTER), np.abs(radii(bone) - INNER))
    assert np.sqrt(np.mean(off**2)) < 0.35 * VOXEL


def test_only_what_is_near_the_maps_is_kept():
    bone = bone_of_volume(nifti(*shell()), "ct.nii", POINTS[:1], 0.0)
    away = np.linalg.norm(bone.outer.vertices - POINTS[0], axis=1)
    assert away.max() < 1.8 * reference_volume.AROUND_MM


def test_what_cannot_be_used_is_refused_by_name(monkeypatch):
    data = nifti(*shell())
    with pytest.raises(InvalidInputError, match=r"ct\.nii holds grey values.*give the threshold"):
        bone_of_volume(data, "ct.nii", POINTS)
    with pytest.raises(InvalidInputError, match=r"no surface of bone near the maps.*threshold"):
        bone_of_volume(data, "ct.nii", POINTS, 5000.0)
    with pytest.raises(DegenerateGeometryError, match="register it by points"):
        bone_of_volume(data, "ct.nii", POINTS + 500.0, 0.0)
    with pytest.raises(InvalidInputError, match=r"short\.nii could not be read"):
        bone_of_volume(data[: len(data) // 2], "short.nii", POINTS, 0.0)
    values, affine = shell()
    values[60, 60, 120] = np.nan
    with pytest.raises(InvalidInputError, match="not finite"):
        bone_of_volume(nifti(values, affine), "ct.nii", POINTS, 0.0)
    monkeypatch.setattr(reference_volume, "MOST_VOXELS", 1000)
    with pytest.raises(InvalidInputError, match="resample"):
        bone_of_volume(data, "ct.nii", POINTS, 0.0)
