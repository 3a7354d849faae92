"""Coarse display mesh of an imported skull, small enough for a session file and a browser."""

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, Ints
from rona_core.geometry.mesh import Mesh, surface_nets
from rona_core.geometry.surface.raycast import MeshRaycaster
from rona_core.virtual.specimen.imported.region_choice import CoarseBone

MOST_FACES = 30_000
TRIAL_MM = 6.0  # edge of the cells of a first mesh, from which the size of the final one follows
FINEST_MM, COARSER = 2.5, 1.04  # its least edge, and the growth until the mesh is small enough
MOST_VOXELS, MOST_CELLS = 20_000_000, 4_000_000  # smoothed, and looked through, at once
VIEWS = 40  # directions from which the mesh is looked at
LIFT_MM = 0.3  # a ray starts this far above its face
WALLS = 8  # nearest places between bone and air that make the surface at a vertex
PLAIN = 0.4  # length of their mean normal from which they are one side of the bone


def display_mesh(bone: CoarseBone) -> tuple[Floats, Ints]:
    """Return vertices (n, 3) in ``upright`` and at most 30 000 faces of the bone that can be seen.

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
            return _onto_bone(vertices, bone), faces
        edge *= COARSER


def _thinned(bone: CoarseBone) -> CoarseBone:
    """Return fewer voxels of a volume that is much larger than a head."""
    stride = max(1, int(np.ceil(np.cbrt(bone.mask.size / MOST_VOXELS))))
    mask = bone.mask[::stride, ::stride, ::stride]
    return CoarseBone(mask, bone.origin_upright, bone.voxel_mm * stride, bone.back)


def _onto_bone(vertices: Floats, bone: CoarseBone) -> Floats:
    """Return vertices (n, 3) moved onto the bone, which the nets of wide cells smooth away.

    The surface lies midway between voxels of bone and of air; near a vertex it is the plane through
    the middle of the nearest such places, or the nearest of them where both sides of a plate are.
    """
    middles: list[Floats] = []
    normals: list[Floats] = []
    mask = np.pad(bone.mask, 1)  # what ends with the volume has a surface there
    for axis in range(3):
        here, there = (np.moveaxis(mask, axis, 0)[part] for part in (slice(-1), slice(1, None)))
        for sign, wall in ((1.0, np.greater(here, there)), (-1.0, np.greater(there, here))):
            index = np.argwhere(np.moveaxis(wall, 0, axis)).astype(np.float64)
            middles.append((index - 1.0 + 0.5 * np.eye(3)[axis]) * bone.voxel_mm)
            normals.append(np.repeat(sign * np.eye(3)[axis][None], len(index), axis=0))
    places, ways = np.concatenate(middles), np.concatenate(normals)
    off = vertices - bone.origin_upright
    tree = KDTree(places)
    near = np.asarray(tree.query(off, k=WALLS)[1], dtype=np.int64)
    normal = ways[near].mean(axis=1)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.maximum(length, 1e-9)
    middle = places[near].mean(axis=1)
    height = np.einsum("ij,ij->i", middle - off, normal)
    onto_plane = off + height[:, None] * normal
    beside, _ = tree.query(onto_plane)  # where the places lie about a hollow, their middle is none
    plain = (length > PLAIN) & (beside[:, None] < bone.voxel_mm.max())
    return bone.origin_upright + np.where(plain, onto_plane, places[near[:, 0]])


def _nets(bone: CoarseBone, edge_mm: float) -> tuple[Floats, Ints]:
    soft = gaussian_filter(bone.mask, 0.4 * edge_mm / bone.voxel_mm, output=np.float32)
    extent = np.array(bone.mask.shape) * bone.voxel_mm
    axes = [np.arange(-2.0 * edge_mm, size + 2.0 * edge_mm, edge_mm) for size in extent]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=0)
    index = places / bone.voxel_mm[:, None, None, None]
    values = map_coordinates(soft, index, order=1, mode="constant", cval=0.0) - 0.5
    vertices, faces = surface_nets(values)
    return bone.origin_upright + vertices * edge_mm - 2.0 * edge_mm, faces


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
