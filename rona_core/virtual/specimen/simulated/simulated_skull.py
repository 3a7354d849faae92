"""Simulated skull as a specimen, answered by its atlas."""

import numpy as np
from numpy.typing import ArrayLike

from rona_core.devices.protocols import DrawnHead
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, as_points, as_vector3, readonly
from rona_core.geometry.mesh import Mesh
from rona_core.session.specimen import Side
from rona_core.virtual.specimen.boundaries import SMOOTH, Region, Relief, as_rays
from rona_core.virtual.specimen.simulated.atlas import Atlas
from rona_core.virtual.specimen.simulated.drawn_head import drawn_head
from rona_core.virtual.specimen.simulated.layer_radii import SkullShape
from rona_core.virtual.specimen.simulated.patient_sampling import draw_patient
from rona_core.virtual.specimen.simulated.spherical_fields import HEAD_MM
from rona_core.virtual.specimen.sphere_tracing import first_entries, sphere_span

REGION_PLACE_MM = (35.0, 45.0)  # behind and above the ear canal
REGION_RIM_MM = 35.0  # how far the fine splines go beyond the region
NORMAL_PATCH_MM = 10.0  # radius over which the normal of the region is averaged
OFF_SURFACE_MM = 15.0  # a chosen centre farther from the bone than this is refused
BOUNDARIES = 4  # outermost first


def cube_sphere(n: int) -> tuple[Ints, Floats]:
    """Return faces (12 n^2, 3), seen counter-clockwise from outside, and unit vertices (m, 3).

    Args:
        n: Cells along each edge of the cube.
    """
    tan = np.tan(np.linspace(-np.pi / 4.0, np.pi / 4.0, n + 1))  # equal angles, not equal steps
    a, b = (grid.ravel() for grid in np.meshgrid(tan, tan, indexing="ij"))
    corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    quads = np.stack((corner, corner + n + 1, corner + n + 2, corner + 1), axis=1)
    vertices, faces = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            v = np.zeros((len(a), 3))
            v[:, axis], v[:, (axis + 1) % 3], v[:, (axis + 2) % 3] = sign, a, b
            cells = quads if sign > 0 else quads[:, ::-1]
            offset = len(vertices) * len(a)
            faces.append(np.concatenate((cells[:, (0, 1, 2)], cells[:, (0, 2, 3)])) + offset)
            vertices.append(v)
    points = np.concatenate(vertices)
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    _, first, merged = np.unique(
        np.round(unit, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    return merged.ravel()[np.concatenate(faces)].astype(np.int64), unit[first]


class SimulatedSpecimen:
    """A simulated head; see ``boundaries.Specimen`` for what each method means."""

    def __init__(
        self,
        seed: int,
        side: Side = "left",
        center_skull: ArrayLike | None = None,
        radius_mm: float = 25.0,
        relief: Relief = SMOOTH,
    ) -> None:
        self.shape: SkullShape = draw_patient(seed, relief)
        self._center = self.shape.center_skull
        _, directions = cube_sphere(24)
        self._bound_mm = float(self.shape.outer_radii(directions).max()) + 2.0
        middle = self._region_center(side, center_skull)
        axis = middle / np.linalg.norm(middle)
        self._atlas = Atlas(self.shape, axis, (radius_mm + REGION_RIM_MM) / HEAD_MM)
        self.region = self._region(middle, radius_mm)

    @property
    def head_axes_skull(self) -> Floats:
        """Right, front and top of the head: x, y and z of ``skull``."""
        return np.eye(3)

    def _region_center(self, side: Side, center_skull: ArrayLike | None) -> Floats:
        """Return the centre of the region on the closed-form outer surface, from the head's."""
        if center_skull is not None:
            v = as_vector3(center_skull, name="center") - self._center
            distance = float(np.linalg.norm(v))
            u = v / max(distance, 1e-9)
            radius = float(self.shape.outer_radii(u[None])[0])
            if abs(distance - radius) > OFF_SURFACE_MM:
                raise InvalidInputError(
                    f"the centre must lie on the skull, but lies {distance - radius:+.0f} "
                    f"mm off it: choose a point within {OFF_SURFACE_MM:g} mm of the surface"
                )
            return radius * u
        behind, above = REGION_PLACE_MM
        sign = 1.0 if side == "right" else -1.0
        origin = np.array((sign * 2.0 * HEAD_MM, -behind, above)) - self._center
        inward = np.array((-sign, 0.0, 0.0))

        def gap(t: Floats, _: object) -> Floats:
            v = origin + t[:, None] * inward
            r = np.linalg.norm(v, axis=1)
            return r - self.shape.outer_radii(v / r[:, None])

        t = first_entries(gap, np.zeros(1), np.full(1, 2.0 * HEAD_MM))
        return origin + t[0] * inward

    def _region(self, middle: Floats, radius_mm: float) -> Region:
        normal = self._atlas.normals(middle[None])[0]
        e1 = np.linalg.svd(normal[None])[2][1]
        e2 = np.cross(normal, e1)
        ring = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
        offsets = [
            r * (np.cos(angle) * e1 + np.sin(angle) * e2)
            for r in (NORMAL_PATCH_MM / 2.0, NORMAL_PATCH_MM)
            for angle in ring
        ]
        patch = self._atlas.normals(middle + np.array([np.zeros(3), *offsets])).mean(axis=0)
        return Region(
            readonly(middle + self._center), readonly(patch / np.linalg.norm(patch)), radius_mm
        )

    def _trace(self, v: Floats, d: Floats, k: Ints, starts: Floats) -> Floats:
        enter, leave = sphere_span(v, d, self._bound_mm)

        def gap(t: Floats, rays: Ints) -> Floats:
            return self._atlas.gap(v[rays] + t[:, None] * d[rays], k[rays])

        return first_entries(gap, np.maximum(enter, starts), leave)

    def ray(self, origins_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the distance (n,) to the outer boundary along each ray; inf where missed."""
        return self._to_boundary(0, origins_skull, directions_skull)

    def _to_boundary(
        self, number: int, origins_skull: ArrayLike, directions_skull: ArrayLike
    ) -> Floats:
        o, d = as_rays(origins_skull, directions_skull)
        v = o - self._center
        return self._trace(v, d, np.full(len(v), number), np.zeros(len(v)))

    def layers(self, origins_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the distances (n, 4) of the four boundaries along each ray."""
        o, d = as_rays(origins_skull, directions_skull)
        v, n = o - self._center, len(o)
        outer = self._trace(v, d, np.zeros(n, dtype=np.int64), np.zeros(n))
        hit = np.flatnonzero(np.isfinite(outer))
        k = np.repeat(np.arange(1, BOUNDARIES), len(hit))
        rows = np.tile(hit, BOUNDARIES - 1)
        deeper = self._trace(v[rows], d[rows], k, outer[rows])
        distances = np.full((n, BOUNDARIES), np.inf)
        distances[:, 0] = outer
        distances[hit, 1:] = deeper.reshape(BOUNDARIES - 1, len(hit)).T
        return distances

    def thickness(self, points_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the bone (n,) in mm from outer surface points along inward directions."""
        return self._to_boundary(BOUNDARIES - 1, points_skull, directions_skull)

    def closest(self, points_skull: ArrayLike) -> Floats:
        """Return the nearest point (n, 3) of the outer boundary to each point near it."""
        v = as_points(points_skull, name="points_skull") - self._center
        return self._atlas.closest(v) + self._center

    def normal(self, points_skull: ArrayLike) -> Floats:
        """Return the outward unit normals (n, 3) at points on or near the outer boundary."""
        return self._atlas.normals(as_points(points_skull, name="points_skull") - self._center)

    def mesh(self, edge_mm: float = 3.0) -> Mesh:
        """Return triangles of the outer boundary for the eye."""
        faces, directions = cube_sphere(int(np.ceil(0.5 * np.pi * HEAD_MM / edge_mm)))
        vertices = self._center + self.shape.outer_radii(directions)[:, None] * directions
        return Mesh(readonly(vertices), readonly(faces))

    def drawn_head(self, edge_mm: float = 3.0) -> DrawnHead:
        """Return calvaria, face and sutures for the eye."""
        return drawn_head(self.shape, self.mesh(edge_mm), self.region)
