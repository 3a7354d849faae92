"""Drawn head of a simulated skull: a template of face and skull base fitted under its calvaria.

For the eye only: the specimen is one closed ovoid, and nothing of the template can be measured. See
docs/decisions/0009-drawn-head-from-a-template.md for where the template comes from.
"""

from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from rona_core.devices.protocols import DrawnHead
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.virtual.specimen.boundaries import Region
from rona_core.virtual.specimen.simulated.layer_radii import SkullShape

TEMPLATE = Path(__file__).with_name("head_template.npz")
UNITS_PER_MM = 32.0  # of the stored vertices
NOMINAL_MM = np.array((70.0, 92.0, 75.0))  # semi-axes of the egg that the template was fitted to
# The seam between calvaria and template in the side view, y and z of ``skull``: from the inion over
# the ear canal and the brow to the glabella
SEAM_Y_MM = (-110.0, -92.0, -47.0, -15.0, 5.0, 30.0, 55.0, 75.0, 100.0)
SEAM_Z_MM = (8.0, 8.0, 2.0, 6.0, 10.0, 14.0, 30.0, 42.0, 44.0)
AROUND_REGION_MM = 15.0  # the true surface is drawn so far beyond the region, wherever it lies
BELOW_MM = 1.0  # of the template under the calvaria
HIDDEN_MM = 9.0  # the template ends so far beneath the calvaria
SPREAD_MM = 6.0  # distance at which what fits the seam begins to fade
STEEPEST = 2.0  # the face may stand out so much for each mm below the seam
SUTURE_STEP_MM, SUTURE_LIFT_MM = 2.0, 0.3
GAP = 3.0  # steps between points that belong to one suture, in multiples of the usual one


def drawn_head(shape: SkullShape, surface: Mesh, region: Region) -> DrawnHead:
    """Return calvaria, face and sutures of a simulated head, in ``skull``.

    Args:
        shape: The head.
        surface: Triangles of its whole outer boundary, as they would be drawn.
        region: Where the true surface must be seen.
    """
    vertices, faces, shades, band = _template()
    calvaria = _calvaria(shape, surface, region)
    placed = _fitted(shape, vertices * (np.array(shape.egg.semi_axes_mm) / NOMINAL_MM), band)
    placed = _tucked(shape, placed, region)
    under = heights_mm(placed, region) > HIDDEN_MM  # the region may be opened: nothing is below it
    kept = ~under[faces].all(axis=1)
    points = shape.sutures.points
    at = shape.center_skull + shape.outer_radii(points)[:, None] * points
    return DrawnHead(
        calvaria=calvaria,
        face=Mesh(readonly(placed), readonly(faces[kept])),
        shades=shades,
        sutures=readonly(_sutures(at, directions=points, region=region)),
    )


def heights_mm(points_skull: Floats, region: Region) -> Floats:
    """Return how far (n,) points lie on the calvaria's side of the seam, about; else negative."""
    above = points_skull[:, 2] - np.interp(points_skull[:, 1], SEAM_Y_MM, SEAM_Z_MM)
    apart = np.linalg.norm(points_skull - region.center_skull, axis=1)
    return np.maximum(above, region.radius_mm + AROUND_REGION_MM - apart)


@cache
def _template() -> tuple[Floats, Ints, Floats, Bools]:
    """Return vertices (n, 3) in nominal ``skull``, faces, shades (n,) and which fit the seam."""
    with np.load(TEMPLATE, allow_pickle=False) as held:
        return (
            readonly(held["vertices"] / UNITS_PER_MM),
            readonly(held["faces"].astype(np.int64)),
            readonly(held["shades"] / 255.0),
            readonly(held["band"]),
        )


def _calvaria(shape: SkullShape, surface: Mesh, region: Region) -> Mesh:
    """Return the true surface above the seam; vertices just below are moved along it to there."""
    vertices, faces = np.array(surface.vertices), surface.faces
    height = heights_mm(vertices, region)
    above = height > 0.0
    cut = faces[above[faces].any(axis=1)]
    pairs = np.concatenate((cut[:, (0, 1)], cut[:, (1, 2)], cut[:, (2, 0)]))
    pairs = np.concatenate((pairs, pairs[:, ::-1]))
    low, high = pairs[~above[pairs[:, 0]] & above[pairs[:, 1]]].T
    sums, counts = np.zeros((len(vertices), 4)), np.bincount(low, minlength=len(vertices))
    np.add.at(sums, low, np.column_stack((vertices[high], height[high])))
    rim = np.flatnonzero(counts)
    mean = sums[rim] / counts[rim, None]
    share = height[rim] / (height[rim] - mean[:, 3])
    moved = vertices[rim] + share[:, None] * (mean[:, :3] - vertices[rim])
    _, u = _polar(moved - shape.center_skull)
    vertices[rim] = shape.center_skull + shape.outer_radii(u)[:, None] * u
    used, numbers = np.unique(cut, return_inverse=True)
    return Mesh(readonly(vertices[used]), readonly(numbers.reshape(-1, 3).astype(np.int64)))


def _fitted(shape: SkullShape, vertices: Floats, band: Bools) -> Floats:
    """Return the template (n, 3) with its seam on the head, and the rest carried along."""
    radius, u = _polar(vertices[band] - shape.center_skull)
    shifts = (shape.outer_radii(u) - BELOW_MM - radius)[:, None] * u
    count = min(24, len(shifts))
    apart, near = KDTree(vertices[band]).query(vertices, k=count)
    weights = 1.0 / (apart**2 + SPREAD_MM**2)
    weights /= weights.sum(axis=1, keepdims=True)
    placed = vertices + np.einsum("nk,nki->ni", weights, shifts[near])
    placed[band] = vertices[band] + shifts
    return placed


def _tucked(shape: SkullShape, placed: Floats, region: Region) -> Floats:
    """Return the template (n, 3) under the calvaria, and gradually free of it below the seam."""
    radius, u = _polar(placed - shape.center_skull)
    surface = shape.outer_radii(u)
    height = heights_mm(shape.center_skull + surface[:, None] * u, region)
    limit = surface - BELOW_MM + STEEPEST * np.maximum(-height, 0.0)
    return shape.center_skull + np.minimum(radius, limit)[:, None] * u


def _sutures(points_skull: Floats, directions: Floats, region: Region) -> Floats:
    """Return the sutures as segments (k, 2, 3), just off the calvaria."""
    lifted = points_skull + SUTURE_LIFT_MM * directions
    steps = np.linalg.norm(np.diff(points_skull, axis=0), axis=1)
    usual = float(np.median(steps))
    every = max(1, round(SUTURE_STEP_MM / usual))
    ends = np.flatnonzero(steps > GAP * usual) + 1
    lines = [part[::every] for part in np.split(lifted, ends)]
    pairs = np.concatenate([np.stack((line[:-1], line[1:]), axis=1) for line in lines])
    return pairs[(heights_mm(pairs.reshape(-1, 3), region).reshape(-1, 2) > 0.0).all(axis=1)]


def _polar(v: Floats) -> tuple[Floats, Floats]:
    """Return lengths (n,) and directions (n, 3) of vectors."""
    radius = np.linalg.norm(v, axis=1)
    return radius, v / np.maximum(radius, 1e-9)[:, None]
