"""Make the template of the drawn head from a mask of a whole skull.

``python -m tests.tools.head_template MASK.nii.gz OUT.npz`` takes about a minute. The mask is that
of benchmark 8 of ITRUSST: 0.5 mm voxels, x to one side, y forward, z up. Why and how:
docs/decisions/0009-drawn-head-from-a-template.md.
"""

import sys

import nibabel as nib
import numpy as np
from scipy import ndimage, optimize, sparse

from rona_core.geometry.mesh import Mesh, surface_nets
from rona_core.geometry.surface.raycast import MeshRaycaster
from rona_core.virtual.specimen.imported.display_mesh import _visible
from rona_core.virtual.specimen.simulated.drawn_head import (
    NOMINAL_MM,
    SEAM_Y_MM,
    SEAM_Z_MM,
    UNITS_PER_MM,
)
from rona_core.virtual.specimen.simulated.spherical_fields import CENTER_SKULL, Egg
from tests.tools.quadric_decimation import decimate

VOXEL_MM, CELL_VOXELS, PAD = 0.5, 4, 8
EAR_MM = np.array((89.4, 117.5, 44.0))  # midway between the ear canals, in the mask
TILT_RAD = np.deg2rad(6.0)  # of the mask, nose down
FACES, BAND_MM = 5600, 10.0  # of the template; how far it reaches above the seam
VIEWS, REACH_MM = 64, 70.0  # of the light that falls in: directions, and how far it looks
CENTER = np.array(CENTER_SKULL)


def cleaned(mask: np.ndarray) -> np.ndarray:
    """Return the largest piece of bone, without jaw and neck, its pinholes closed."""
    x, y, z = np.meshgrid(
        *(np.arange(n) * VOXEL_MM for n in mask.shape), indexing="ij", sparse=True
    )
    aside = np.abs(x - EAR_MM[0])
    mask = mask & ~((aside > 35) & (aside < 57.5) & (y > 112) & (y < 164) & (z < 42))  # jaw
    mask &= ~((z < 21) & (y < 120) & (aside < 40))  # vertebrae
    mask &= z > 1.0
    mask = np.pad(ndimage.gaussian_filter(mask.astype(np.float32), 1.6) > 0.36, PAD)
    mask = ndimage.binary_closing(mask, ndimage.generate_binary_structure(3, 1), iterations=3)
    pieces, _ = ndimage.label(mask)
    return pieces == np.argmax(np.bincount(pieces.ravel())[1:]) + 1


def surface(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return what can be seen of the bone, smooth, its origin between the ear canals."""
    soft = ndimage.gaussian_filter(mask.astype(np.float32), 1.8)
    vertices, faces = surface_nets(soft[::CELL_VOXELS, ::CELL_VOXELS, ::CELL_VOXELS] - 0.5)
    vertices, faces = _visible(vertices * CELL_VOXELS * VOXEL_MM - PAD * VOXEL_MM, faces)
    vertices, faces = largest(vertices, faces)
    mean = means(len(vertices), faces)
    for _ in range(6):  # Taubin 1995: smooth, and do not shrink
        vertices = vertices + 0.5 * (mean @ vertices - vertices)
        vertices = vertices - 0.52 * (mean @ vertices - vertices)
    cos, sin = np.cos(TILT_RAD), np.sin(TILT_RAD)
    turn = np.array(((1.0, 0.0, 0.0), (0.0, cos, -sin), (0.0, sin, cos)))
    vertices = (vertices - EAR_MM) @ turn.T
    vertices[:, 0] -= 0.5 * (vertices[:, 0].max() + vertices[:, 0].min())
    return vertices, faces


def neighbours(n: int, faces: np.ndarray) -> sparse.csr_matrix:
    rows, columns = faces.ravel(), faces[:, (1, 2, 0)].ravel()
    graph = sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n, n)).tocsr()
    return ((graph + graph.T) > 0).astype(float)


def means(n: int, faces: np.ndarray) -> sparse.csr_matrix:
    graph = neighbours(n, faces)
    return sparse.diags(1.0 / np.asarray(graph.sum(axis=1)).ravel()) @ graph


def largest(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    _, piece = sparse.csgraph.connected_components(neighbours(len(vertices), faces))
    kept = faces[piece[faces[:, 0]] == np.argmax(np.bincount(piece))]
    return used(vertices, kept)


def used(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    numbers, faces_of_used = np.unique(faces, return_inverse=True)
    return vertices[numbers], faces_of_used.reshape(-1, 3)


def normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    corners = vertices[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sums = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(sums, faces[:, k], areas)
    return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-9)


def above_seam(vertices: np.ndarray) -> np.ndarray:
    return vertices[:, 2] - np.interp(vertices[:, 1], SEAM_Y_MM, SEAM_Z_MM)


def outside_egg(vertices: np.ndarray) -> np.ndarray:
    v = vertices - CENTER
    radius = np.linalg.norm(v, axis=1)
    return radius - Egg(tuple(NOMINAL_MM)).value(v / radius[:, None])


def fitted(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the vertices scaled along the axes and shifted, so that the calvaria is the egg's."""
    v = vertices - CENTER
    outward = np.einsum("ij,ij->i", normals(vertices, faces), v) > 0.5 * np.linalg.norm(v, axis=1)
    places = np.flatnonzero((above_seam(vertices) > 22.0) & outward)
    places = np.random.default_rng(0).choice(places, 1500, replace=False)

    def placed(p: np.ndarray, which: np.ndarray) -> np.ndarray:
        return which * p[:3] + np.array((0.0, p[3], p[4]))

    def off(p: np.ndarray) -> np.ndarray:
        return np.append(outside_egg(placed(p, vertices[places])), (2.0 * p[3], 2.0 * p[4]))

    found = optimize.least_squares(off, (0.93, 0.95, 0.88, 0.0, 0.0), loss="soft_l1")
    return placed(found.x, vertices)


def light(vertices: np.ndarray, faces: np.ndarray, whole: Mesh) -> np.ndarray:
    """Return the share (n,) of the light from all sides that reaches each vertex."""
    out, caster = normals(vertices, faces), MeshRaycaster(whole)
    heights = 1.0 - 2.0 * (np.arange(VIEWS) + 0.5) / VIEWS
    turns, flat = np.arange(VIEWS) * np.pi * (3.0 - 5.0**0.5), np.sqrt(1.0 - heights**2)
    sums, all_of_it = np.zeros(len(vertices)), np.zeros(len(vertices))
    for view in np.column_stack((flat * np.cos(turns), flat * np.sin(turns), heights)):
        share = out @ view
        at = np.flatnonzero(share > 0.05)
        free = caster.first_hit(vertices[at] + 1.6 * out[at], np.repeat(view[None], len(at), 0))
        sums[at] += share[at] * np.clip(free / REACH_MM, 0.0, 1.0)
        all_of_it[at] += share[at]
    return sums / np.maximum(all_of_it, 1e-9)


def band(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return which vertices (n,) are put onto the calvaria of a patient."""
    v, height, off = vertices - CENTER, above_seam(vertices), outside_egg(vertices)
    facing = np.einsum("ij,ij->i", normals(vertices, faces), v) / np.linalg.norm(v, axis=1)
    orbits = (np.abs(vertices[:, 0]) < 30) & (height < 1) & (vertices[:, 1] > 60) & (off < -3)
    near = (height > -4) & (off > -8) & (off < 14)
    return near & ((facing > 0.1) | (height > 8)) & ~orbits


def main(mask_path: str, out_path: str) -> None:
    """Write the template."""
    mask = np.asarray(nib.load(mask_path).dataobj) > 0
    vertices, faces = surface(cleaned(mask))
    vertices = fitted(vertices, faces)
    whole = Mesh(vertices, faces)
    below = faces[~(above_seam(vertices)[faces] > BAND_MM).all(axis=1)]
    vertices, faces = used(vertices, below)
    weights = np.where(vertices[:, 1] > 35.0, 3.0, 1.0)  # face before skull base
    weights *= np.where(above_seam(vertices) > -10.0, 8.0, 1.0)  # and the seam before both
    vertices, faces = decimate(vertices, faces, FACES, weights)
    np.savez_compressed(
        out_path,
        vertices=np.round(vertices * UNITS_PER_MM).astype(np.int16),
        faces=faces.astype(np.uint16),
        shades=np.round(255.0 * light(vertices, faces, whole)).astype(np.uint8),
        band=band(vertices, faces),
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
