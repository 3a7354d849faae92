"""Cheap figures of all placements with one angle: from the map and its cell-wise spread alone."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.cell_grid import cosines
from rona_core.planning.bed import Screw
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.seat import Seats, lay_seats
from rona_core.planning.placement.solid_points import SolidPoints

LEAST_SIGMA_MM = 1e-3
SIDES = np.array([(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0)])


@dataclass(frozen=True, slots=True, eq=False)
class Screened:
    """Figures of k places with t tilts each."""

    score: Floats  # (k, t) least distance from the limit anywhere, in sigmas of that place
    residual_mm: Floats  # (k, t) least of the map
    rim_mm: Floats  # (k, t) largest distance of the outer map from the plane z = 0
    room_mm: Floats  # (k,) to what is not mapped or is avoided; negative: within a zone
    covered: Bools  # (k,) both boundaries are mapped wherever the bed and its screws reach


class Screen:
    """Patches between four cells each, on which both boundaries are planes."""

    def __init__(self, problem: PlacementProblem) -> None:
        """Gather what all placements look up."""
        bone = problem.bone
        self.problem, self.bone = problem, bone
        outer, inner, ok = bone.outer.height_mm, bone.inner.height_mm, bone.ok
        inner_draws = bone.inner_boundary.draws_at_cells_mm()
        spread = (bone.outer_draws - inner_draws).std(axis=1).reshape(bone.shape)
        inner_slopes, outer_slopes = (bone.grid.slopes(height) for height in (inner, outer))
        variance, cosine = inner_draws.var(axis=1).reshape(bone.shape), cosines(inner_slopes)
        self.inner = _patches([inner, *np.moveaxis(inner_slopes, -1, 0), cosine, variance])
        self.outer = _patches([outer, *np.moveaxis(outer_slopes, -1, 0), spread])
        places = bone.places_mm().reshape(-1, 2)
        clearance = problem.zone_clearance_mm(places).reshape(bone.shape)
        self.room = _patches([np.minimum(bone.unmapped_mm, clearance)])[0]
        among = ok[:-1, :-1] & ok[1:, :-1] & ok[:-1, 1:] & ok[1:, 1:]
        self.covered = np.append(among.ravel(), False)  # the last stands for all that is outside
        self.size = np.array(among.shape)

    def look(
        self, solid: SolidPoints, places_mm: Floats, angle_rad: float, tilts_rad: Floats
    ) -> Screened:
        """Return the figures of a bed at places (k, 2), at one angle and with tilts (t, 2)."""
        angles = np.full(len(places_mm), angle_rad)
        seats = lay_seats(self.bone, solid.rim, places_mm, angles)
        rim = np.column_stack((solid.rim, np.zeros(len(solid.rim))))
        screws = [self._screw(seats, screw) for screw in solid.screws]
        met = [self._find(_in_map(seats, points))[0] for points in (solid.floor, rim)]
        met = np.concatenate((*met, *(patches for _, patches in screws)), axis=1)
        covered = np.asarray(self.covered[met].all(axis=1), dtype=np.bool_)
        room = np.where(covered, self.room[np.where(covered[:, None], met, 0)].min(axis=1), 0.0)
        shape = len(places_mm), len(tilts_rad)
        score, residual = np.full(shape, -np.inf), np.full(shape, -np.inf)
        rims = np.zeros(shape)
        rows = np.flatnonzero(covered)
        if len(rows):
            kept = Seats(seats.rotations[rows], seats.translations[rows], seats.rim_mm[rows])
            score[rows], residual[rows], rims[rows] = self._bed(solid, kept, tilts_rad)
        for score_of_screw, _ in screws:
            score = np.minimum(score, score_of_screw[:, None])
        return Screened(score, residual, rims, room, covered)

    def _bed(
        self, solid: SolidPoints, seats: Seats, tilts_rad: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Return score, residual and rim (k, t) of a bed.

        A small tilt moves each place along a straight line, so the bone is looked up once.
        """
        points = _in_map(seats, solid.floor)
        patch, u, v = self._find(points)
        inner, slope_u, slope_v, cosine, variance = np.take(self.inner, patch, axis=1)
        level = cosine * (points[:, 2] - inner - slope_u * u - slope_v * v)
        normals = np.stack((-slope_u * cosine, -slope_v * cosine, cosine), axis=1)
        normals_bed = np.swapaxes(seats.rotations, 1, 2) @ normals
        wx, wy, wz = normals_bed[:, 0], normals_bed[:, 1], normals_bed[:, 2]
        x, y, z = solid.floor.T
        lateral, depth = self.problem.execution.lateral_mm, self.problem.execution.depth_mm
        own = cosine**2 * variance + LEAST_SIGMA_MM**2
        sharpness = 1.0 / np.sqrt(own + lateral**2 * (wx**2 + wy**2) + depth**2 * wz**2)
        about_x, about_y = y * wz - z * wy, z * wx - x * wz
        limit = self.problem.limits.residual_mm
        score, residual, rim = (np.zeros((len(level), len(tilts_rad))) for _ in range(3))
        for t, (tilt_x, tilt_y) in enumerate(tilts_rad):
            left = level + tilt_x * about_x + tilt_y * about_y
            residual[:, t] = left.min(axis=1)
            score[:, t] = ((left - limit) * sharpness).min(axis=1)
            lifted = solid.rim[:, 1] * tilt_x - solid.rim[:, 0] * tilt_y
            rim[:, t] = np.abs(seats.rim_mm - lifted).max(axis=1)
        return score, residual, rim

    def _find(self, points: Floats) -> tuple[Ints, Floats, Floats]:
        """Return the patch of each point (k, 3, m) in ``map``, and u and v from its middle."""
        cell = self.bone.cell_mm
        u, v = ((points[:, axis] - self.bone.grid.origin_mm[axis]) / cell for axis in (0, 1))
        i, j = np.floor(u), np.floor(v)
        outside = (i < 0) | (j < 0) | (i >= self.size[0]) | (j >= self.size[1])
        patch = np.where(outside, self.inner.shape[1], i * self.size[1] + j).astype(np.int64)
        return patch, cell * (u - i - 0.5), cell * (v - j - 0.5)

    def _screw(self, seats: Seats, screw: Screw) -> tuple[Floats, Ints]:
        """Return the score (k,) of a screw along its axis, and the patches (k, 5) it meets."""
        axes = seats.rotations[:, :, 2]
        start = seats.rotations[:, :, :2] @ (screw.x_mm, screw.y_mm) + seats.translations
        entry, (height, slope_u, slope_v, spread), u, v = self._column(start, self.outer)
        start = start + (height + slope_u * u + slope_v * v - start[:, 2])[:, None] * axes
        tip, radius = start - screw.length_mm * axes, 0.5 * screw.diameter_mm
        _, rows, u, v = self._column(tip, self.inner)
        below = rows[0] + rows[1] * u + rows[2] * v
        gap = tip[:, 2] - below - radius * np.hypot(rows[1], rows[2])
        score = gap / np.maximum(spread, LEAST_SIGMA_MM)
        around = [self._find((tip + radius * side)[:, :, None])[0] for side in SIDES]
        return score, np.concatenate((entry[:, None], *around), axis=1)

    def _column(self, points: Floats, table: Floats) -> tuple[Ints, Floats, Floats, Floats]:
        """Return the patch of each point (k, 3), its rows of a table, and u and v from there."""
        patch, u, v = self._find(points[:, :, None])
        rows = np.take(table, np.minimum(patch[:, 0], table.shape[1] - 1), axis=1)
        return patch[:, 0], rows, u[:, 0], v[:, 0]


def _in_map(seats: Seats, points: Floats) -> Floats:
    """Return places (m, 3) of a bed in ``map`` for k seats (k, 3, m)."""
    return seats.rotations @ points.T + seats.translations[:, :, None]


def _patches(fields: list[Floats]) -> Floats:
    """Return the means of four cells that lie together, a row (patches,) for each field."""
    stacked = np.stack(fields)
    sums = stacked[:, :-1, :-1] + stacked[:, 1:, :-1] + stacked[:, :-1, 1:] + stacked[:, 1:, 1:]
    return 0.25 * sums.reshape(len(fields), -1)
