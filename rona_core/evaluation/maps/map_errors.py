"""Errors of the maps in every cell, against ground truth."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.evaluation.maps.map_metrics import (
    cells,
    inner_errors_mm,
    outer_errors_mm,
    thickness_errors_mm,
)
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.comparison.map_errors import MapErrors

if TYPE_CHECKING:
    from rona_core.mapping.boundary_map import Maps


def errors_of_maps(maps: "Maps", truth: Truth) -> MapErrors:
    """Return the signed errors of the maps over their grid, as a comparison has them."""
    found = cell_errors_mm(maps, truth)
    wanted = ("outer", "fused", "inner", "thickness")
    return MapErrors(
        {name: np.where(np.isfinite(found[name]), found[name], np.nan) for name in wanted}
    )


def cell_errors_mm(maps: "Maps", truth: Truth) -> dict[str, Floats]:
    """Return the signed errors of all maps over their grid (nu, nv), infinite where none is known.

    Keys are ``thickness``, and ``outer``, ``inner`` and ``fused``, absolute and, with the ending
    ``_same_robot``, for the same robot. All maps are on one grid.
    """
    errors: dict[str, Floats] = {}
    for suffix, systematic in (("", False), ("_same_robot", True)):
        for name, boundary, errors_mm in (
            ("outer", maps.outer, outer_errors_mm),
            ("fused", maps.fused, outer_errors_mm),
            ("inner", maps.inner, inner_errors_mm),
        ):
            found = errors_mm(cells(boundary), truth, systematic)
            errors[name + suffix] = _on_grid(boundary.ok, found)
    both = maps.inner.ok & maps.outer.ok
    errors["thickness"] = _on_grid(both, thickness_errors_mm(maps, truth))
    return errors


def _on_grid(which: Bools, values: Floats) -> Floats:
    """Return values (n,) in their cells, infinite elsewhere."""
    grid = np.full(which.shape, np.inf)
    grid[which] = values
    return grid
