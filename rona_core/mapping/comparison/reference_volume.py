"""Reference bone from a volume: the surfaces of a CT or of a mask, where the maps are."""

import numpy as np

from rona_core.devices.files.voxels.voxel_reader import grey_values, open_voxels
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.mesh import Mesh, Reals, surface_nets
from rona_core.mapping.comparison.reference_bone import ReferenceBone

AROUND_MM = 25.0  # of the maps: as deep as bone is thick, and as far as a registration moves it
MOST_VOXELS = 30_000_000  # near the maps


def bone_of_volume(
    data: bytes, name: str, points_mesh: Floats, threshold: float | None = None
) -> ReferenceBone:
    """Return both tables of the bone in a volume, near some points.

    Between voxels the surface lies where the value passes the threshold: of a CT it is finer than
    its voxels, of a mask a third of one off.

    Args:
        data: Contents of an NRRD or NIfTI file, in mm.
        name: Of the file.
        points_mesh: Places (n, 3) near which it is wanted, in the frame of the file.
        threshold: From which a value is bone; a mask, which has two values, needs none.

    Raises:
        InvalidInputError: damaged, foreign, too fine, grey without a threshold, or without bone.
        DegenerateGeometryError: the volume does not reach to the points.
    """
    values, T_mesh_voxel = _near(data, name, points_mesh)
    low, high = float(values.min()), float(values.max())
    binary = bool(((values == low) | (values == high)).all())
    level = 0.5 * (low + high) if binary else threshold
    if level is None:
        raise grey_values(name, low, high)
    places, faces = surface_nets(values - np.float32(level))
    if not len(faces):
        raise InvalidInputError(
            f"{name} has no surface of bone near the maps: its values there are {low:g} to "
            f"{high:g}; check the threshold ({level:g}), or register by points"
        )
    if np.linalg.det(T_mesh_voxel[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    mesh = Mesh(places @ T_mesh_voxel[:3, :3].T + T_mesh_voxel[:3, 3], faces)
    return ReferenceBone(mesh, mesh)


def _near(data: bytes, name: str, points_mesh: Floats) -> tuple[Reals, Floats]:
    """Return the voxels around some points, and the pose of their indices (4, 4) in the file."""
    with open_voxels(data, name) as voxels:
        T = voxels.T_mesh_voxel
        edges = np.linalg.norm(T[:3, :3], axis=0)
        indices = np.linalg.solve(T[:3, :3], (points_mesh - T[:3, 3]).T).T
        margin = AROUND_MM / edges
        low = np.maximum(np.floor(indices.min(axis=0) - margin), 0).astype(np.int64)
        high = np.ceil(indices.max(axis=0) + margin).astype(np.int64) + 1
        high = np.minimum(high, voxels.shape)
        if (high - low < 2).any():
            raise DegenerateGeometryError(
                f"{name} holds nothing within {AROUND_MM:g} mm of the maps: is it in the frame of "
                "the robot's base? If not, register it by points"
            )
        size = high - low
        if size.prod() > MOST_VOXELS:
            raise InvalidInputError(
                f"{name} has {size.prod() / 1e6:.0f} million voxels near the maps: at most "
                f"{MOST_VOXELS / 1e6:.0f}; resample it to larger voxels"
            )
        values = np.zeros(size, dtype=np.float32)
        first = 0
        for slab in voxels.slabs:  # to the end: whether the file is whole shows only there
            end = first + slab.shape[2]
            a, b = max(first, int(low[2])), min(end, int(high[2]))
            if a < b:
                part = slab[low[0] : high[0], low[1] : high[1], a - first : b - first]
                values[:, :, a - low[2] : b - low[2]] = part
            first = end
    if not np.isfinite(values).all():
        raise InvalidInputError(f"{name} holds values that are not finite: repair the file")
    shifted = T.copy()
    shifted[:3, 3] += T[:3, :3] @ low
    return values, shifted
