"""Mapped bones whose truth is one more draw of the same Gaussian field, and what a bed leaves."""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.boundary_map import BoundaryMap, Maps
from rona_core.planning.bed import Bed
from rona_core.planning.placement.problem import ExecutionError, MappedBone

AROUND_MM = 3.0  # of a bed, where the nearest place of the boundary may be
FINE_MM = 0.2  # between its places


@dataclass(frozen=True, slots=True, eq=False)
class BoneWorld:
    """A bone as it was mapped and drawn, and as it is."""

    bone: MappedBone
    u_mm: Floats
    v_mm: Floats
    inner_true_mm: Floats  # (nu, nv)


def bone_world(
    generator: Generator, side_mm: float, thickness_mm: float, *, draws: int = 200
) -> BoneWorld:
    """Return a square piece of skull with so much bone on average, mapped at cells of 1 mm.

    The thickness varies by 1 mm over some 10 mm, the inner map errs by 0.1 to 0.35 mm over 3 mm
    and by 0.1 mm as a whole.
    """
    n = round(side_mm) + 1
    at: Floats = np.linspace(-0.5 * (n - 1), 0.5 * (n - 1), n)
    u, v = np.meshgrid(at, at, indexing="ij")
    radius = generator.uniform(65.0, 95.0)
    outer = np.sqrt(radius**2 - u**2 - v**2) - radius
    outer += 0.15 * gaussian_fields(generator, at, 8.0, 1)[0]
    thickness = thickness_mm + gaussian_fields(generator, at, 10.0, 1)[0]
    inner = outer - np.maximum(thickness, 2.0)
    own = 0.1 + 0.25 * np.clip(0.5 + 0.5 * gaussian_fields(generator, at, 8.0, 1)[0], 0.0, 1.0)
    off = own * gaussian_fields(generator, at, 3.0, draws + 1)
    off += 0.1 * generator.standard_normal((draws + 1, 1, 1))
    outer_draws = outer + 0.05 * gaussian_fields(generator, at, 3.0, draws)
    whole: Bools = np.ones((n, n), dtype=np.bool_)
    maps = [BoundaryMap(Pose.identity(), at, at, height, whole) for height in (outer, inner)]
    empty, none = np.zeros((0, 3)), np.zeros(0, dtype=np.bool_)
    both = Maps(empty, empty, none, none, maps[0], maps[1], maps[0], None)
    bone = MappedBone(both, outer_draws, inner + off[1:])
    return BoneWorld(bone, at, at, inner + off[0])


def gaussian_fields(generator: Generator, at_mm: Floats, reach_mm: float, count: int) -> Floats:
    """Return fields (count, n, n) of variance 1 that are alike within a reach."""
    apart = (at_mm[:, None] - at_mm) / reach_mm
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart**2))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return root @ generator.standard_normal((count, len(at_mm), len(at_mm))) @ root.T


def milled(generator: Generator, execution: ExecutionError, T_map_bed: Pose) -> Pose:
    """Return where a bed comes to lie that was planned at a pose."""
    lateral, depth = execution.lateral_mm, execution.depth_mm
    off = Pose.from_translation(generator.standard_normal(3) * (lateral, lateral, depth))
    return T_map_bed @ off


def true_residual_mm(world: BoneWorld, bed: Bed, T_map_bed: Pose) -> float:
    """Return the least distance of any cell of a bed from the true inner boundary.

    From every cell to the nearest place of a fine spline: another way than that of the planner.
    """
    i, j = np.nonzero(bed.cut())
    points = T_map_bed @ np.column_stack((bed.x_mm[i], bed.y_mm[j], -bed.depth_mm[i, j]))
    u, v = (
        np.arange(points[:, axis].min() - AROUND_MM, points[:, axis].max() + AROUND_MM, FINE_MM)
        for axis in (0, 1)
    )
    places = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
    inner = np.column_stack((places, _inner_mm(world, places)))
    away = np.asarray(KDTree(inner).query(points)[0])
    through = points[:, 2] < _inner_mm(world, points[:, :2])
    return float(np.where(through, -away, away).min())


def _inner_mm(world: BoneWorld, places_mm: Floats) -> Floats:
    cells = (places_mm - (world.u_mm[0], world.v_mm[0])).T  # are 1 mm wide
    return np.asarray(map_coordinates(world.inner_true_mm, cells, order=3, mode="nearest"))


def round_bed(diameter_mm: float, depth_mm: float, cell_mm: float = 0.2) -> Bed:
    """Return a cylinder."""
    return oblong_bed(diameter_mm, diameter_mm, depth_mm, cell_mm)


def oblong_bed(length_mm: float, width_mm: float, depth_mm: float, cell_mm: float = 0.2) -> Bed:
    """Return a stadium along x."""
    x, y = (_cells(side, cell_mm) for side in (length_mm, width_mm))
    beyond = np.maximum(np.abs(x) - 0.5 * (length_mm - width_mm), 0.0)
    inside = np.hypot(*np.meshgrid(beyond, y, indexing="ij")) <= 0.5 * width_mm + 1e-9
    return Bed(x, y, np.where(inside, depth_mm, 0.0))


def _cells(side_mm: float, cell_mm: float) -> Floats:
    """Return even cell centres (n,) a little beyond a side, one of them in its middle."""
    n = int(np.ceil(0.5 * side_mm / cell_mm)) + 1
    return np.linspace(-n * cell_mm, n * cell_mm, 2 * n + 1)
