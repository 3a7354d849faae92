"""All placements of a bed on a grid: screened with the map, then the promising ones with draws."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.planning.bed import Bed
from rona_core.planning.placement.chance import normal_quantile, spreads_above
from rona_core.planning.placement.evaluate import judge_placement
from rona_core.planning.placement.figures import PlacementFigures, Shortfall, objective
from rona_core.planning.placement.problem import PlacementProblem
from rona_core.planning.placement.residuals import (
    bed_margins,
    beyond_screws,
    screw_places,
)
from rona_core.planning.placement.screening import Screen
from rona_core.planning.placement.seat import Placement, lay_seats, tilted
from rona_core.planning.placement.settings import SearchGrid
from rona_core.planning.placement.solid_points import SolidPoints, least_reach_mm, lowest_of_blocks

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
