"""Chain of scan lines that is most informative of the least bone below a bed, chosen greedily.

With Gaussian errors, the variance of the least bone that a scan leaves does not depend on its
echoes, and less of it is worth more whatever the risk is (Blackwell 1953). Draws of the maps give
the covariance of the thickness at each place with that least bone. See
docs/algorithms/implant/further_lines.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import Pose
from rona_core.mapping.accuracy.map_draws import MapDraws
from rona_core.path.scan_patterns import Inside
from rona_core.planning.bed import Bed
from rona_core.planning.implants.implant import Implant
from rona_core.planning.placement.evaluate import margins, solid_points
from rona_core.planning.placement.problem import PlacementProblem

CORNER_MM = 3.0  # between places at which a line may end
APART_MM = 2.0  # between places of a line that count
LENGTHS_MM = (6.0, 25.0)  # of a line
_NOTHING: Ints = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Hearing:
    """What a further scan would hear, in draws, over the places that it may go to."""

    places_mm: Floats  # (m, 2) cells of the map
    thickness_mm: Floats  # (m, n) that it would read there in each draw
    least_mm: Floats  # (n,) least bone below the bed in the same draws
    sigma_mm: float  # of what a line reads at one place, by itself


@dataclass(frozen=True, slots=True, eq=False)
class Lines:
    """Lines one after the other, each from where the last one ended."""

    rows_mm: Floats  # (k, 2, 2) start and end of each in the plane of the map
    left_share: float  # of the variance of the least bone, after all of them


def best_lines(hearing: Hearing, length_mm: float) -> Lines:
    """Return the lines that leave least of the variance for their length, greedily.

    They are chosen by one half of the draws, and the variance left is estimated on the other, so
    that the choice does not bias it.

    Args:
        hearing: Draws of at least two dozen worlds.
        length_mm: Of all lines together, about.
    """
    known = _Known(hearing, slice(0, None, 2))
    corners = _corners(hearing.places_mm)
    lines = _Chords(hearing.places_mm, corners)
    rows: list[tuple[int, int]] = []
    gone_mm = 0.0
    possible = np.arange(lines.count)
    while gone_mm < length_mm and len(possible):
        gains = np.array([known.gain(lines.places[one]) for one in possible])
        best = int(possible[np.argmax(gains / lines.lengths_mm[possible])])
        rows.append((int(lines.ends[best, 0]), int(lines.ends[best, 1])))
        gone_mm += float(lines.lengths_mm[best])
        known.hear(lines.places[best])
        possible = np.flatnonzero(lines.ends[:, 0] == rows[-1][1])
    ends = np.array(rows, dtype=np.int64).reshape(-1, 2)
    rows_mm = hearing.places_mm[corners[ends]]
    return Lines(readonly(rows_mm), left_share(hearing, rows_mm))


def left_share(hearing: Hearing, rows_mm: Floats) -> float:
    """Return the share of the variance of the least bone that lines (k, 2, 2) leave, 0 to 1.

    The regression of the least bone on the echoes is fitted on one half of the draws, and tested
    on the other.
    """
    tree = KDTree(hearing.places_mm)
    places = np.unique(np.concatenate([_along(tree, *row) for row in rows_mm] or [_NOTHING]))
    if not len(places):
        return 1.0
    weights = _Known(hearing, slice(0, None, 2)).weights(places)
    echoes = hearing.thickness_mm[places][:, 1::2]
    least = hearing.least_mm[1::2]
    off = least - least.mean() - weights @ (echoes - echoes.mean(axis=1, keepdims=True))
    noise = hearing.sigma_mm**2 * float(weights @ weights)
    return float(np.clip((off.var() + noise) / max(least.var(), 1e-12), 0.0, 1.0))


class _Known:
    """Covariances of the echoes to come and of the least bone, given the echoes so far."""

    def __init__(self, hearing: Hearing, draws: slice) -> None:
        echoes, least = hearing.thickness_mm[:, draws], hearing.least_mm[draws]
        echoes = echoes - echoes.mean(axis=1, keepdims=True)
        count = echoes.shape[1] - 1
        self._places: Floats = echoes @ echoes.T / count
        self._error = hearing.sigma_mm**2
        self._least: Floats = echoes @ (least - least.mean()) / count

    def weights(self, places: Ints) -> Floats:
        """Return what each of some places (p,) says of the least bone."""
        found = np.linalg.solve(self._read(places), self._least[places])
        return np.asarray(found, dtype=np.float64)

    def gain(self, places: Ints) -> float:
        """Return the variance that hearing some places (p,) takes from the least bone."""
        return float(self.weights(places) @ self._least[places])

    def hear(self, places: Ints) -> None:
        """Condition the covariances on the echoes at some places (p,)."""
        tied = self._places[:, places]
        share = np.linalg.solve(self._read(places), tied.T)
        self._least = self._least - self._least[places] @ share
        self._places = self._places - tied @ share

    def _read(self, places: Ints) -> Floats:
        """Return the covariance (p, p) of what is read at some places."""
        return self._places[np.ix_(places, places)] + self._error * np.eye(len(places))


class _Chords:
    """Lines between corners that lie in the region all along."""

    def __init__(self, places_mm: Floats, corners: Ints) -> None:
        at, tree = places_mm[corners], KDTree(places_mm)
        apart = np.linalg.norm(at[:, None] - at, axis=-1)
        ends = np.argwhere((apart >= LENGTHS_MM[0]) & (apart <= LENGTHS_MM[1]))
        along = [_along(tree, at[i], at[j]) for i, j in ends]
        kept = np.array([len(one) > 0 for one in along], dtype=np.bool_)
        self.ends: Ints = ends[kept]  # (c, 2) of the corners
        self.lengths_mm: Floats = apart[tuple(self.ends.T)]  # (c,)
        self.places = [one for one in along if len(one)]
        self.count = len(self.places)


def _along(tree: KDTree, start: Floats, end: Floats) -> Ints:
    """Return the places along a line; none where it leaves the region."""
    count = max(2, round(float(np.linalg.norm(end - start)) / APART_MM) + 1)
    line = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
    away, nearest = tree.query(line)
    return np.unique(nearest) if away.max() <= APART_MM / 2.0 else _NOTHING


def _corners(places_mm: Floats) -> Ints:
    """Return every place (c,) of the region that lies on a wider grid."""
    wide = np.rint((places_mm - places_mm.mean(axis=0)) / CORNER_MM).astype(np.int64)
    off = np.linalg.norm(places_mm - places_mm.mean(axis=0) - CORNER_MM * wide, axis=1)
    order = np.lexsort((off, wide[:, 1], wide[:, 0]))
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(wide[order], axis=0) != 0).any(axis=1)
    return order[first]


AROUND_MM = 2.0  # of bed and screws, where a line may go, too


def bed_hearing(
    draws: MapDraws,
    problem: PlacementProblem,
    implant: Implant,
    bed: Bed,
    T_base_bed: Pose,
    allowed: Inside | None,
    sigma_mm: float,
) -> Hearing:
    """Return what a further scan would hear around a bed.

    What counts is the least bone over the limit below the bed or beyond a screw.

    Args:
        draws: Of the maps.
        problem: The bone in those draws, and what is asked of the bed.
        implant: With its lift.
        bed: As it would be milled.
        T_base_bed: Where it lies.
        allowed: Whether places (n, 2) of the map may be scanned; None: all may.
        sigma_mm: Of a thickness by one A-scan.
    """
    maps, bone = draws.maps, problem.bone
    solid = solid_points(problem, bed, implant.screws)
    T_map_bed: Pose = maps.outer.T_base_map.inv() @ T_base_bed
    screws = np.array([(one.x_mm, one.y_mm, 0.0) for one in implant.screws]).reshape(-1, 3)
    beneath = np.vstack((T_map_bed @ solid.floor, T_map_bed @ screws))[:, :2]
    places = bone.places_mm()
    away = KDTree(beneath).query(places)[0]
    around = maps.outer.ok & (away <= AROUND_MM)
    if allowed is not None:
        around[around] = allowed(places[around])
    return Hearing(
        places_mm=readonly(places[around]),
        thickness_mm=readonly(draws.reread_mm[:, around].T),
        least_mm=readonly(margins(problem, T_map_bed, solid)),
        sigma_mm=sigma_mm,
    )
