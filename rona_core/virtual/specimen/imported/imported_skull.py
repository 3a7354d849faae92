"""Imported skull as a specimen: rays and feet on the zero level of its distance field."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from rona_core.devices.files.voxels.refusals import refused
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import (
    Bools,
    Floats,
    Ints,
    as_points,
    as_vector3,
    readonly,
)
from rona_core.geometry.mesh import Mesh
from rona_core.session.specimen import LoadedSkull
from rona_core.virtual.specimen.boundaries import Region, as_rays
from rona_core.virtual.specimen.bsplines import SplineVolume
from rona_core.virtual.specimen.imported.region_choice import GAP_MM
from rona_core.virtual.specimen.simulated.layer_radii import (
    diploe_share,
    layer_depths,
    move_step,
)
from rona_core.virtual.specimen.simulated.spherical_fields import HEAD_MM, Waves
from rona_core.virtual.specimen.sphere_tracing import first_entries

STEEPNESS = 1.1  # how fast a smoothed distance may change for each millimetre
RIM_NODES = 2.0  # of the grid that are not trusted
FOOT_STEPS, FOOT_MM = 40, 1e-6
LEAST_BEND = 0.2  # smallest curvature of the squared distance that Newton's method believes
LONGEST_STEP_MM = 2.0
LEVEL_STEPS, LEVEL_MM = 12, 1e-6  # back to the zero level; the last step gains two digits more
NIFTI_SUFFIXES = (".nii", ".nii.gz")  # whose coordinates are right, anterior, superior
SKIN_MM = 0.2  # walked beyond a boundary before the next is looked for
EDGE_MM = 8.0  # between the disc and the side of the grid
OFF_SURFACE_MM = 3.0  # a chosen centre farther outside the bone than this is refused,
WITHIN_MM = 15.0  # or farther within it, below the outer surface
LOOK_FROM_MM = 14.0  # above it; what lies over that (an arch, a holder) is another surface
NORMAL_PATCH_MM = 10.0  # radius over which the normal of the region is averaged
DRAWN_MM = 1.5  # a drawn vertex off the bone by more than this is a fault of the import
SHEET_NODES = 1.0  # pitch of the columns that sample the boundaries, in nodes


class BoneField:
    """The signed distance (negative in bone) by tricubic splines; all points in ``skull``."""

    def __init__(self, skull: LoadedSkull) -> None:
        self._skull = skull
        self._field = SplineVolume(skull.distance_um.astype(np.float64) / 1000.0)
        self.high = np.array(skull.distance_um.shape) - 1.0 - RIM_NODES  # last trusted nodes

    def places(self, points: Floats) -> Floats:
        """Return points (n, 3) in nodes of the grid."""
        return (points - self._skull.origin_skull) @ self._skull.axes_skull / self._skull.spacing_mm

    def trusted(self, points: Floats) -> Bools:
        """Return which points (n,) lie in the trusted part of the grid."""
        places = self.places(points)
        return np.asarray(((places > RIM_NODES) & (places < self.high)).all(axis=1))

    def distance(self, points: Floats) -> Floats:
        """Return the signed distance (n,) to the bone."""
        return self._field.value(self.places(points))

    def unit_gradient(self, points: Floats) -> Floats:
        """Return the direction (n, 3) in which the distance grows."""
        g = self._field.gradient(self.places(points)) @ self._skull.axes_skull.T
        return g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)

    def span(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return where rays enter and leave the trusted part of the grid."""
        o = self.places(origins)
        d = directions @ self._skull.axes_skull / self._skull.spacing_mm
        d = np.where(np.abs(d) < 1e-12, 1e-12, d)
        a, b = (RIM_NODES - o) / d, (self.high - o) / d
        enter = np.maximum(np.minimum(a, b).max(axis=1), 0.0)
        return enter, np.maximum(a, b).min(axis=1)

    def entries(self, o: Floats, d: Floats, sign: float, starts: Floats, ends: Floats) -> Floats:
        """Return where rays first enter bone (``sign`` +1) or leave it (-1), inf where never."""

        def gap(t: Floats, rays: Ints) -> Floats:
            return sign * self.distance(o[rays] + t[:, None] * d[rays])

        return first_entries(gap, starts, ends, STEEPNESS)

    def foot(self, q: Floats, start: Floats) -> Floats:
        """Return the points (n, 3) of the zero level nearest to ``q``, searched from ``start``.

        Newton steps in the tangent plane and back to the zero level; a step that does not come
        nearer is refused and the next one damped.
        """
        x = self.onto_level(start)
        best = np.linalg.norm(q - x, axis=1)
        damping = np.zeros(len(q))
        busy = np.arange(len(q))
        for _ in range(FOOT_STEPS):
            step = self._newton_step(q[busy], x[busy], damping[busy])
            trial = self.onto_level(x[busy] + step)
            distance = np.linalg.norm(q[busy] - trial, axis=1)
            better = distance <= best[busy]
            rows = busy[better]
            x[rows], best[rows] = trial[better], distance[better]
            damping[busy] = np.where(better, 0.0, np.maximum(damping[busy], 0.3) * 5.0)
            busy = busy[np.linalg.norm(step, axis=1) > FOOT_MM]
            if not len(busy):
                break
        return x

    def _newton_step(self, q: Floats, x: Floats, damping: Floats) -> Floats:
        """Return the step (n, 3) in the tangent plane at ``x`` towards the foot of ``q``.

        Half the squared distance, seen along the surface, has the Hessian 1 + height * curvature;
        its smallest eigenvalue is kept above ``LEAST_BEND``, and ``damping`` shortens the step.
        """
        axes, spacing = self._skull.axes_skull, self._skull.spacing_mm
        places = self.places(x)
        g = self._field.gradient(places) @ axes.T / spacing
        size = np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-12)
        n = g / size
        off = q - x
        height = np.einsum("ij,ij->i", off, n)
        tangent = np.eye(3) - n[:, :, None] * n[:, None, :]
        bend = axes @ self._field.hessian(places) @ axes.T / spacing**2
        curvature = tangent @ (bend / size[:, :, None]) @ tangent
        values, ways = np.linalg.eigh(np.eye(3) + height[:, None, None] * curvature)
        values = np.maximum(values, LEAST_BEND) + damping[:, None]
        slide = off - height[:, None] * n
        step = np.einsum("nij,nj->ni", ways, np.einsum("nji,nj->ni", ways, slide) / values)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        return step * np.minimum(1.0, LONGEST_STEP_MM / np.maximum(length, 1e-12))

    def onto_level(self, x: Floats) -> Floats:
        """Return points moved along the gradient to the zero level."""
        for _ in range(LEVEL_STEPS):
            level = self.distance(x)
            x = x - level[:, None] * self.unit_gradient(x)
            if np.abs(level).max(initial=0.0) < LEVEL_MM:
                break
        return x


class LoadedSpecimen:
    """A loaded skull; see ``boundaries.Specimen`` for what each method means."""

    def __init__(
        self,
        skull: LoadedSkull,
        center_skull: ArrayLike | None = None,
        radius_mm: float = 25.0,
        step: tuple[Waves, ...] = (),
    ) -> None:
        self._skull, self._step = skull, step
        self._field = BoneField(skull)
        self._tree: tuple[KDTree, Floats] | None = None
        self.region = self._region(skull, center_skull, radius_mm)

    @property
    def head_axes_skull(self) -> Floats | None:
        """Right, front and top of the head: those of NIfTI; other files' are not stored."""
        nifti = self._skull.name.lower().endswith(NIFTI_SUFFIXES)
        return np.eye(3) if nifti else None

    def _region(
        self, skull: LoadedSkull, center_skull: ArrayLike | None, radius_mm: float
    ) -> Region:
        axes = skull.axes_skull
        center = skull.center_skull
        if center_skull is not None:
            center = as_vector3(center_skull, name="center")
        place = (center - skull.origin_skull) @ axes
        edges = np.array(skull.distance_um.shape) * skull.spacing_mm
        room = np.minimum(place, edges - place)
        if room[:2].min() < radius_mm + EDGE_MM or room[2] < EDGE_MM / 2.0:
            raise InvalidInputError(
                f"a disc of {radius_mm:g} mm about {center.round(1).tolist()} leaves the stored "
                f"part of {skull.name}: load it again with this centre and radius"
            )
        top = center + min(edges[2] - place[2], LOOK_FROM_MM) * axes[:, 2]
        depth = self._first(top[None], -axes[:, 2][None])[0]
        found = top - depth * axes[:, 2] if np.isfinite(depth) else center
        above = float((center - found) @ axes[:, 2])  # the surface
        if not np.isfinite(depth) or not -WITHIN_MM <= above <= OFF_SURFACE_MM:
            where = f"{abs(above):.1f} mm {'above' if above > 0 else 'below'} it"
            where = where if np.isfinite(depth) else "beside all bone"
            raise InvalidInputError(
                f"{center.round(1).tolist()} is not on the outer surface of {skull.name}, but "
                f"{where}: choose a point within {OFF_SURFACE_MM:g} mm of it"
            )
        angles = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
        ring = np.stack((np.cos(angles), np.sin(angles)), 1) @ axes[:, :2].T
        offsets = np.concatenate(
            (np.zeros((1, 3)), ring * NORMAL_PATCH_MM / 2, ring * NORMAL_PATCH_MM)
        )
        tops = top + offsets
        depths = self._first(tops, np.repeat(-axes[:, 2][None], len(tops), axis=0))
        hit = np.isfinite(depths)
        feet = tops[hit] - depths[hit, None] * axes[:, 2]
        normal = self._field.unit_gradient(feet).mean(axis=0)
        return Region(readonly(found), readonly(normal / np.linalg.norm(normal)), radius_mm)

    def _first(self, o: Floats, d: Floats) -> Floats:
        """Return the distance (n,) to the outer surface."""
        return self._field.entries(o, d, 1.0, *self._field.span(o, d))

    def _last_exit(self, o: Floats, d: Floats, outer: Floats) -> Floats:
        """Return the distance (n,) at which each ray leaves the bone for good; inf: missing."""
        inner = np.full(len(o), np.inf)
        rays = np.flatnonzero(np.isfinite(outer))
        _, leave = self._field.span(o, d)
        entry = outer[rays]
        while len(rays):
            exits = self._field.entries(o[rays], d[rays], -1.0, entry + SKIN_MM, leave[rays])
            inner[rays] = exits
            rays, exits = rays[np.isfinite(exits)], exits[np.isfinite(exits)]
            beyond = np.minimum(exits + GAP_MM, leave[rays])
            entry = self._field.entries(o[rays], d[rays], 1.0, exits + SKIN_MM, beyond)
            rays, entry = rays[np.isfinite(entry)], entry[np.isfinite(entry)]
        return inner

    def ray(self, origins_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the distance (n,) to the outer boundary along each ray; inf where missed."""
        return self._first(*as_rays(origins_skull, directions_skull))

    def layers(self, origins_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the distances (n, 4) of the four boundaries along each ray."""
        o, d = as_rays(origins_skull, directions_skull)
        outer = self._first(o, d)
        inner = self._last_exit(o, d, outer)
        whole = np.isfinite(inner)
        distances = np.full((len(o), 4), np.inf)
        distances[:, 0] = outer
        thickness = inner[whole] - outer[whole]
        depths = layer_depths(thickness, diploe_share(thickness))
        entries = (o[whole] + outer[whole, None] * d[whole]) / HEAD_MM
        move_step(depths, sum((field.value(entries) for field in self._step), 0.0))
        distances[whole] = outer[whole, None] + depths
        return distances

    def thickness(self, points_skull: ArrayLike, directions_skull: ArrayLike) -> Floats:
        """Return the bone (n,) in mm from outer surface points along inward directions."""
        o, d = as_rays(points_skull, directions_skull)
        return self._last_exit(o, d, np.zeros(len(o)))

    def _outer_samples(self) -> tuple[KDTree, Floats]:
        """Return points (n, 3) of the outer boundary under a lattice on top, and their tree."""
        if self._tree is None:
            axes, spacing = self._skull.axes_skull, self._skull.spacing_mm
            sides = [
                np.arange(RIM_NODES, high + 1e-9, SHEET_NODES) for high in self._field.high[:2]
            ]
            a, b = np.meshgrid(*sides, indexing="ij")
            places = np.stack((a, b, np.full_like(a, self._field.high[2])), axis=-1).reshape(-1, 3)
            o = self._skull.origin_skull + spacing * places @ axes.T
            d = np.repeat(-axes[:, 2][None], len(o), axis=0)
            t = self.ray(o, d)
            valid = np.isfinite(t)
            points = o[valid] + t[valid, None] * d[valid]
            self._tree = KDTree(points), points
        return self._tree

    def closest(self, points_skull: ArrayLike) -> Floats:
        """Return the nearest point (n, 3) of the outer boundary to each point near it."""
        q = as_points(points_skull, name="points_skull")
        tree, samples = self._outer_samples()
        return self._field.foot(q, samples[tree.query(q)[1]])

    def normal(self, points_skull: ArrayLike) -> Floats:
        """Return the outward unit normals (n, 3) at points on or near the outer boundary."""
        return self._field.unit_gradient(as_points(points_skull, name="points_skull"))

    def mesh(self, edge_mm: float = 3.0) -> Mesh:
        """Return triangles of the whole skull for the eye; they were made when it was imported."""
        vertices = self._skull.mesh_vertices_skull.astype(np.float64)
        return Mesh(readonly(vertices), readonly(self._skull.mesh_faces.astype(np.int64)))

    def drawn_head(self, edge_mm: float = 3.0) -> None:
        """Return None: a loaded skull has a face of its own."""


def drawn_on_level(skull: LoadedSkull, voxel_mm: float) -> LoadedSkull:
    """Return the skull with drawn vertices on its zero level where the smoothing moved that.

    It takes spikes and plates away that are a voxel thick: so far a vertex moves, and no farther.
    """
    field = BoneField(skull)
    vertices = skull.mesh_vertices_skull.astype(np.float64)
    near = np.flatnonzero(field.trusted(vertices))
    off = np.abs(field.distance(vertices[near]))
    near = near[(off > 0.5 * DRAWN_MM) & (off < 0.5 * DRAWN_MM + voxel_mm)]
    vertices[near] = field.onto_level(vertices[near])
    return replace(skull, mesh_vertices_skull=vertices.astype(np.float32))


def check_drawn(skull: LoadedSkull) -> None:
    """Hold each vertex of the drawn skull, which is the robot's obstacle, against the distance.

    Only those within the stored part can be; one transform places them all.

    Raises:
        InvalidInputError: one of them is more than 1.5 mm off the bone.
    """
    field = BoneField(skull)
    vertices = skull.mesh_vertices_skull.astype(np.float64)
    vertices = vertices[field.trusted(vertices)]
    off = np.abs(field.distance(vertices))
    if len(off) and (worst := off.max()) > DRAWN_MM:
        raise refused(
            "a drawn surface off the bone",
            name=skull.name,
            worst=worst,
            place=vertices[off.argmax()].round(1).tolist(),
            most=DRAWN_MM,
        )
