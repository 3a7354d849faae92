"""Coarse display mesh of an imported skull, small enough for a session file and a browser."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.mesh import Mesh
from rona_core.geometry.surface.raycast import MeshRaycaster
from rona_core.geometry.surface_nets import surface_nets
from rona_core.virtual.specimen.imported.region_choice import CoarseBone

MOST_FACES = 30_000
TRIAL_MM = 6.0  # edge of the cells of a first mesh, from which the size of the final one follows
FINEST_MM, COARSER = 2.5, 1.04  # its least edge, and the growth until the mesh is small enough
MOST_VOXELS, MOST_CELLS = 20_000_000, 4_000_000  # smoothed, and looked through, at once
VIEWS = 40  # directions from which the mesh is looked at
LIFT_MM = 0.3  # a ray starts this far above its face


def display_mesh(bone: CoarseBone) -> tuple[Floats, Ints]:
    """Return vertices (n, 3) in ``skull`` and at most 30 000 faces of what can be seen of the bone.

    Faces that no far viewer sees, such as the inside of the braincase, are left out.
    """
    bone = _thinned(bone)
    extent = np.array(bone.mask.shape) * bone.voxel_mm
    finest = max(FINEST_MM, float(np.cbrt(np.prod(extent) / MOST_CELLS)))
    _, trial = _visible(*_nets(bone, TRIAL_MM))
    edge = max(finest, COARSER * TRIAL_MM * float(np.sqrt(len(trial) / MOST_FACES)))
    while True:
        vertices, faces = _visible(*_nets(bone, edge))
        if len(faces) <= MOST_FACES:
            return vertices, faces
        edge *= COARSER


def _thinned(bone: CoarseBone) -> CoarseBone:
    """Return fewer voxels of a volume that is much larger than a head."""
    stride = max(1, int(np.ceil(np.cbrt(bone.mask.size / MOST_VOXELS))))
    mask = bone.mask[::stride, ::stride, ::stride]
    return CoarseBone(mask, bone.origin_skull, bone.voxel_mm * stride, bone.back)


def _nets(bone: CoarseBone, edge_mm: float) -> tuple[Floats, Ints]:
    soft = gaussian_filter(bone.mask, 0.4 * edge_mm / bone.voxel_mm, output=np.float32)
    extent = np.array(bone.mask.shape) * bone.voxel_mm
    axes = [np.arange(-2.0 * edge_mm, size + 2.0 * edge_mm, edge_mm) for size in extent]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=0)
    index = places / bone.voxel_mm[:, None, None, None]
    values = map_coordinates(soft, index, order=1, mode="constant", cval=0.0) - 0.5
    vertices, faces = surface_nets(values)
    return bone.origin_skull + vertices * edge_mm - 2.0 * edge_mm, faces


def _visible(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Return the faces that rays reach from far away, and their vertices."""
    caster = MeshRaycaster(Mesh(vertices, faces))
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    middles = corners.mean(axis=1) + LIFT_MM * normals
    turns = np.arange(VIEWS)
    heights = 1.0 - (2.0 * turns + 1.0) / VIEWS  # Fibonacci sphere
    angles = turns * np.pi * (3.0 - np.sqrt(5.0))
    around = np.sqrt(1.0 - heights**2)
    views = np.stack((around * np.cos(angles), around * np.sin(angles), heights), axis=1)
    hidden = np.arange(len(faces))
    for view in views:
        facing = hidden[normals[hidden] @ view > 0.0]
        directions = np.repeat(view[None], len(facing), axis=0)
        visible = facing[np.isinf(caster.first_hit(middles[facing], directions))]
        hidden = np.setdiff1d(hidden, visible, assume_unique=True)
    kept = np.delete(faces, hidden, axis=0)
    used, renumbered = np.unique(kept, return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)
