"""Best placement of a bed over the whole mapped region, and how sure it is everywhere.

Every place, angle and tilt is screened with the map and its cell-wise spread, which promises too
much; draws tell by how much, at every other place. The promising ones are then judged with all
draws, best first. See docs/algorithms/implant/placement.md.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree
from scipy.special import ndtr

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.cell_grid import cosines
from rona_core.planning.bed import Bed, Screw
from rona_core.planning.placement.evaluate import (
    SolidPoints,
    bed_margins,
    beyond_screws,
    judge_placement,
    least_reach_mm,
    lowest_of_blocks,
    screw_places,
    solid_points,
)
from rona_core.planning.placement.figures import (
    PlacementFigures,
    Shortfall,
    normal_quantile,
    objective,
    spreads_above,
)
from rona_core.planning.placement.problem import (
    Placement,
    PlacementProblem,
    SearchGrid,
    Seats,
    lay_seats,
    tilted,
)

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


LEAN = 0.8  # of its least reach a bed covers in the plane of the map, however it leans
ANCHOR_CELLS = 2  # every other place along u and v is judged with draws
FEW = 400  # places that are all judged with draws
SLACK = 0.15  # by which the score of a place may be better than that of its nearest anchor
MOST_JUDGED = 400  # placements that compete with all draws
FINALISTS = 5  # of them are judged in full
TIE = 1e-9  # of a score: where no probability differs from 0, the least hopeless one is best


class Candidates:
    """Placements of a bed: k places, a angles, t tilts."""

    def __init__(
        self, problem: PlacementProblem, solid: SolidPoints, bed: Bed, grid: SearchGrid
    ) -> None:
        """Screen them all, and see with draws by how much that promises too much."""
        self.problem, self.solid = problem, solid
        bone = problem.bone
        roomy = bone.ok & (bone.unmapped_mm >= LEAN * least_reach_mm(bed))
        self.cells: Ints = np.argwhere(roomy)
        self.places_mm = bone.places_mm()[roomy]
        self.angles, self.tilts = grid.angles_rad(solid.turn_rad), grid.tilt_pairs_rad()
        floor = lowest_of_blocks(bed, 2.0 * bone.cell_mm)
        coarse = replace(solid, floor=floor, rim=solid.rim[::2])
        screen = Screen(problem)
        looks = [screen.look(coarse, self.places_mm, angle, self.tilts) for angle in self.angles]
        self.room_mm = np.stack([look.room_mm for look in looks], axis=1)
        self.rim_mm = np.stack([look.rim_mm for look in looks], axis=1)
        covered: Bools = np.stack([look.covered for look in looks], axis=1)
        barred = ~(covered & (self.room_mm >= 0.0))[:, :, None]
        score = np.stack([look.score for look in looks], axis=1)
        residual = np.stack([look.residual_mm for look in looks], axis=1)
        self.covered = np.asarray(covered.any(axis=1), dtype=np.bool_)
        self.score = np.where(barred, -np.inf, score)
        self.residual_mm = np.where(barred, -np.inf, residual)
        self.laid = np.asarray((~barred).any(axis=(1, 2)), dtype=np.bool_)
        self.safest: Floats = self.score.max(axis=(1, 2), initial=-np.inf)
        self.optimism = self._optimism()

    def best(self) -> PlacementFigures | None:
        """Return the placement with the largest objective; None where the bed cannot be laid."""
        if not self.laid.any():
            return None
        limits, room = self.problem.limits, self.room_mm[:, :, None]
        sure = normal_quantile(self.score - self.optimism[:, None, None] + SLACK)
        hoped = objective(limits, sure, self.residual_mm, self.rim_mm, room) + TIE * sure
        hoped = hoped.ravel()
        some = np.argpartition(-hoped, min(MOST_JUDGED, len(hoped) - 1))[:MOST_JUDGED]
        some = some[np.isfinite(hoped[some])]
        some = some[np.argsort(-hoped[some], kind="stable")]
        k, a, t = (np.asarray(n, np.int64) for n in np.unravel_index(some, self.score.shape))
        values: list[float] = []
        for i, (spreads, residual_mm) in enumerate(self._judged(k, a, t)):
            score = normal_quantile(np.array(spreads))
            rim, space = self.rim_mm[k[i], a[i], t[i]], self.room_mm[k[i], a[i]]
            value = objective(limits, score, residual_mm, rim, space) + TIE * score
            values.append(float(value))
            if i + 1 < len(some) and max(values) >= hoped[some[i + 1]]:
                break
        first = np.argsort(-np.array(values), kind="stable")[:FINALISTS]
        judged = [
            judge_placement(self.problem, self.solid, self._placement(*chosen))
            for chosen in np.stack((k, a, t), axis=1)[first].tolist()
        ]
        judged = [one for one in judged if one.shortfall is not Shortfall.UNMAPPED]
        return max(judged, key=_rank) if judged else None

    def _optimism(self) -> Floats:
        """Return by how much the screened score of each place (k,) is better than that of draws.

        At the safest angle and tilt, and of the nearest place that was judged.
        """
        rows = np.flatnonzero(self.laid)
        if len(rows) > FEW:
            rows = rows[(self.cells[rows] % ANCHOR_CELLS == 0).all(axis=1)]
        if not len(rows):
            return np.zeros(len(self.cells))
        flat = self.score[rows].reshape(len(rows), -1).argmax(axis=1)
        a, t = np.unravel_index(flat, self.score.shape[1:])
        judged = np.array([score for score, _ in self._judged(rows, a, t)])
        beyond = rows[np.isinf(judged)]
        self.laid[beyond] = self.covered[beyond] = False
        rows, judged = rows[np.isfinite(judged)], judged[np.isfinite(judged)]
        if not len(rows):
            return np.zeros(len(self.cells))
        gap = self.safest[rows] - judged
        return gap[KDTree(self.cells[rows]).query(self.cells)[1]]

    def _judged(self, k: Ints, a: Ints, t: Ints) -> Iterator[tuple[float, float]]:
        """Yield spreads over the limit and least residual, with all draws; -inf: not all mapped."""
        bone, solid = self.problem.bone, self.solid
        seats = lay_seats(bone, solid.rim, self.places_mm[k], self.angles[a])
        rim = np.column_stack((solid.rim, np.zeros(len(solid.rim))))
        for i in range(len(k)):
            T_map_bed = tilted(seats, i, self._placement(k[i], a[i], t[i]))
            floor_map, rim_map = T_map_bed @ solid.floor, T_map_bed @ rim
            screws_map = screw_places(bone, T_map_bed, solid.screws)
            touched = np.concatenate((floor_map, rim_map, screws_map.reshape(-1, 3)))[:, :2]
            if not bone.covered(touched).all():
                yield -np.inf, -np.inf
                continue
            least, mapped = bed_margins(self.problem, T_map_bed, solid)
            score = float(spreads_above(least, 0.0))
            if solid.screws:
                beyond, _ = beyond_screws(self.problem, T_map_bed, screws_map)
                score = min(score, float(spreads_above(beyond.T, 0.0).min()))
            yield score, float(mapped.min())

    def _placement(self, k: int, a: int, t: int) -> Placement:
        u_mm, v_mm = self.places_mm[k].tolist()
        tilt_x_rad, tilt_y_rad = self.tilts[t].tolist()
        turn_rad = float(np.remainder(self.angles[a] + np.pi, 2.0 * np.pi) - np.pi)
        return Placement(u_mm, v_mm, turn_rad, tilt_x_rad, tilt_y_rad)


def _rank(one: PlacementFigures) -> tuple[float, float]:
    return one.objective, one.chance.score if one.chance else -np.inf


@dataclass(frozen=True, slots=True, eq=False)
class PlacementSearch:
    """The best placement, and what the bed lacks where."""

    best: PlacementFigures | None  # None where the bed cannot be laid at all
    probability: Floats  # (nu, nv) with the bed's origin in that cell, at its best angle and tilt
    shortfall: Ints  # (nu, nv) of that, see ``Shortfall``
    refusal: str | None  # why no placement is safe; None where the best one is


def search_placements(
    problem: PlacementProblem,
    bed: Bed,
    screws: Sequence[Screw] = (),
    grid: SearchGrid | None = None,
) -> PlacementSearch:
    """Return the best placement of a bed over the whole mapped region.

    Args:
        problem: Bone, limits, errors of execution and zones.
        bed: The solid that the burr sweeps.
        screws: Beside it.
        grid: Angles and tilts.

    Raises:
        InvalidInputError: the bed is larger than the region, or no bed at all.
    """
    solid = solid_points(problem, bed, screws)
    _check_size(problem, bed)
    found = Candidates(problem, solid, bed, grid or SearchGrid())
    best, cells = found.best(), tuple(found.cells.T)
    probability = np.zeros(problem.bone.shape)
    shortfall = np.full(problem.bone.shape, int(Shortfall.UNMAPPED))
    if len(found.cells):
        chance = np.where(found.laid, ndtr(normal_quantile(found.safest - found.optimism)), 0.0)
        enough = found.residual_mm.max(axis=(1, 2)) >= problem.limits.residual_mm
        state = np.where(enough, Shortfall.UNSURE, Shortfall.THIN)
        state[chance >= problem.limits.probability] = Shortfall.NONE
        barred = np.where(found.covered, Shortfall.ZONE, Shortfall.UNMAPPED)
        probability[cells], shortfall[cells] = chance, np.where(found.laid, state, barred)
    refusal = _refusal(problem, best, found)
    return PlacementSearch(best, readonly(probability), readonly(shortfall), refusal)


def _check_size(problem: PlacementProblem, bed: Bed) -> None:
    area = float(bed.cut().sum()) * float(bed.x_mm[1] - bed.x_mm[0]) ** 2
    mapped = float(problem.bone.ok.sum()) * problem.bone.cell_mm**2
    require(
        area <= mapped,
        f"the bed covers {area:.0f} mm2, and both boundaries are mapped over {mapped:.0f} mm2: "
        "take a smaller implant or scan a larger region",
    )


def _refusal(
    problem: PlacementProblem, best: PlacementFigures | None, found: Candidates
) -> str | None:
    """Return why no placement is safe."""
    limits = problem.limits
    if best is None:
        if found.covered.any() and not found.laid.any():
            return "wherever the bed lies over mapped bone it comes too close to a zone to avoid"
        return "nowhere does the bed lie wholly where both boundaries are mapped: scan on"
    if best.shortfall is Shortfall.NONE:
        return None
    most = float(found.residual_mm.max())
    if most < limits.residual_mm:
        return (
            f"the bone is too thin: at best {most:.2f} mm would be left below the bed, and "
            f"{limits.residual_mm:g} mm are required: lift the implant or take a shallower one"
        )
    short = [one for one in best.screws if one.bone_mm <= one.screw.length_mm]
    if short:
        return (
            f"a screw of {short[0].screw.length_mm:g} mm finds {short[0].bone_mm:.2f} mm of bone "
            "at the best place: take shorter screws or other holes"
        )
    return (
        f"the bone is thick enough, but not surely: the probability is {best.probability:.3f} at "
        f"best, and {limits.probability:g} is required: scan again there, or lift the implant"
    )
