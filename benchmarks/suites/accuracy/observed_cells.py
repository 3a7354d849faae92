"""What the program observes at the cells of a map: would another order tell where it errs?"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from benchmarks.suites.ultrasound.observed_order import LEAST
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.mapping.accuracy.echo_terms import cells_map
from rona_core.mapping.accuracy.error_terms import ErrorTerm
from rona_core.mapping.boundary_map import Maps
from rona_core.mapping.fitting.plate_field import fit_field
from rona_core.session.document import Session

NEAR, AROUND = 6, 24  # A-scans


def cell_observables(session: Session, terms: Sequence[ErrorTerm], cells: Ints) -> Floats:
    """Return logarithms (m, k) of what the program observes at some cells (m,) of its maps.

    Args:
        session: With its maps.
        terms: Causes of error of the map that is asked for.
        cells: Numbers of the cells, row by row.
    """
    made, results = session.results.maps, session.results
    if made is None:
        return np.zeros((len(cells), 0))
    maps: Maps = made.value
    passes = (results.detection, results.second_detection)
    found = [derived.value for derived in passes if derived is not None]
    level = np.concatenate([one.outer_quality for one in found])
    sure = np.concatenate([one.inner_quality for one in found])
    other = np.concatenate([one.alternative_quality for one in found])
    timing_mm = np.concatenate([one.thickness_sigma_mm for one in found])
    places = cells_map(maps.outer)[cells, :2]
    shape, T_map_base = maps.outer.height_mm.shape, maps.outer.T_base_map.inv()
    outer_map, inner_map = T_map_base @ maps.outer_points_base, T_map_base @ maps.inner_points_base
    depth_mm = outer_map[:, 2] - inner_map[:, 2]
    front = _surroundings(places, outer_map[:, :2], outer_map[:, 2], maps.outer_used)
    bone = _surroundings(places, inner_map[:, :2], depth_mm, maps.inner_used)
    near = np.flatnonzero(maps.inner_used)[_nearest(places, inner_map[maps.inner_used, :2], NEAR)]
    every = _nearest(places, outer_map[:, :2], AROUND)
    own = [np.broadcast_to(term.own_mm, shape).ravel()[cells] for term in terms]
    columns = [
        *own,
        maps.thickness_mm().ravel()[cells],
        np.sqrt(np.mean(timing_mm[near] ** 2, axis=1)),
        1.0 - sure[near].mean(axis=1),
        other[near].mean(axis=1),
        level[every].mean(axis=1),
        1.0 - sure[every].mean(axis=1),
        1.0 - maps.inner_used[every[:, :NEAR]].mean(axis=1),
        1.0 - maps.inner_used[every].mean(axis=1),
        *front.T,
        *bone.T,
    ]
    return np.log(np.maximum(np.stack(columns, axis=1), LEAST))


def _surroundings(places: Floats, samples: Floats, heights_mm: Floats, used: Bools) -> Floats:
    """Return way to the first and sixth sample, their scatter near and around, slope (m, 5)."""
    plate = fit_field(samples[used], heights_mm[used])
    rest = np.square(heights_mm[used] - plate.heights(samples[used]))
    rows = _nearest(places, samples[used], AROUND)
    away = np.linalg.norm(samples[used][rows] - places[:, None], axis=2)
    slope = np.hypot(plate.heights(places, (1, 0)), plate.heights(places, (0, 1)))
    scatter = np.sqrt(rest[rows[:, :NEAR]].mean(axis=1)), np.sqrt(rest[rows].mean(axis=1))
    return np.stack((away[:, 0], away[:, min(NEAR, away.shape[1]) - 1], *scatter, slope), axis=1)


def _nearest(places: Floats, samples: Floats, count: int) -> Ints:
    """Return rows (m, k) of the nearest samples (n, 2) to places (m, 2)."""
    return np.asarray(KDTree(samples).query(places, k=min(count, len(samples)))[1], dtype=np.int64)
