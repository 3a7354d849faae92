"""Maps of one session against the truth: honest near and far from samples, and drawn together."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from benchmarks.suites.honesty.judged import Judged
from benchmarks.suites.honesty.maps import maps as judged_maps
from rona_core.app.steps.maps.inputs import drawn_maps, map_accuracy
from rona_core.evaluation.map_metrics import cell_errors_mm
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.accuracy.map_accuracy import MapAccuracy
from rona_core.mapping.boundary_map import Maps
from rona_core.session.document import Session

FAR_MM = (0.0, 1.0, 2.5, np.inf)  # from the nearest sample of a boundary
PATCHES_MM = (5, 10, 20)
FULL_PATCH = 0.6  # share of its cells that a patch must have
DRAWS = 100


def judge(session: Session, truth: Truth, case: int) -> list[Judged]:
    """Return errors and sigmas of a session: common, local, by distance, and of patches drawn.

    Args:
        session: With its maps.
        truth: Of it.
        case: Its number; two skulls of one seed are two cases.
    """
    made, accuracy = session.results.maps, map_accuracy(session)
    if made is None or accuracy is None:
        return []
    errors = cell_errors_mm(made.value, truth)
    return [
        *judged_maps(session, case),
        *_by_distance(made.value, accuracy, errors, case),
        *_patches(session, errors, case),
    ]


def _by_distance(
    maps: Maps, accuracy: MapAccuracy, errors: dict[str, Floats], seed: int
) -> Iterator[Judged]:
    """Yield the local part, by how far a cell is from the nearest sample of its boundary."""
    stated = {
        "outer_same_robot": (accuracy.outer.own_mm, maps.outer_points_base[maps.outer_used]),
        "fused_same_robot": (accuracy.fused.own_mm, maps.outer_points_base[maps.outer_used]),
        "thickness": (accuracy.thickness.own_mm, maps.inner_points_base[maps.inner_used]),
    }
    for name, (own_mm, samples_base) in stated.items():
        far_mm = _distances_mm(maps, samples_base)
        known = np.isfinite(errors[name]) & np.isfinite(own_mm)
        if not known.any():
            continue
        local = errors[name] - errors[name][known].mean()
        for low, high in pairwise(FAR_MM):
            cells = known & (far_mm >= low) & (far_mm < high)
            reach = f"{low:g} to {high:g} mm" if np.isfinite(high) else f"over {low:g} mm"
            title = f"{name.replace('_', ' ')}, {reach} from a sample"
            yield Judged(title, "local", seed, local[cells], own_mm[cells])


def _distances_mm(maps: Maps, samples_base: Floats) -> Floats:
    """Return how far (nu, nv) cells are from the nearest of samples (n, 3), in the map's plane."""
    grid = maps.outer
    if not len(samples_base):
        return np.full(grid.ok.shape, np.inf)
    places = (grid.T_base_map.inv() @ samples_base)[:, :2]
    cells = np.stack(np.meshgrid(grid.u_mm, grid.v_mm, indexing="ij"), axis=-1)
    return np.asarray(KDTree(places).query(cells)[0], dtype=np.float64)


def _patches(session: Session, errors: dict[str, Floats], seed: int) -> Iterator[Judged]:
    """Yield mean errors of square patches beside their scatter over draws of the maps."""
    draws = drawn_maps(session, DRAWS, seed, same_robot=True)
    maps = draws.maps
    thickness = draws.outer_mm - draws.inner_mm
    for name, values, middle in (
        ("outer_same_robot", draws.outer_mm, maps.outer.height_mm),
        ("thickness", thickness, maps.thickness_mm()),
    ):
        known = np.isfinite(errors[name]) & maps.inner.ok
        for size in PATCHES_MM:
            parts = list(_squares(known, size))
            found = np.array([errors[name][part].mean() for part in parts])
            drawn = np.array([(values - middle)[:, part].mean(axis=1).std() for part in parts])
            title = f"drawn {name.replace('_', ' ')}, patches of {size} mm"
            yield Judged(title, "whole", seed, found, drawn)


def _squares(known: Bools, size: int) -> Iterator[Bools]:
    """Yield the cells (nu, nv) of each square of so many cells that is nearly full."""
    i, j = np.indices(known.shape) // size
    label = i * (known.shape[1] + 1) + j
    for one in np.unique(label[known]):
        part = known & (label == one)
        if np.count_nonzero(part) >= FULL_PATCH * size**2:
            yield part
