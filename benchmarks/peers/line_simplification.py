"""Packages that simplify lines, each behind one call; None where one is not installed."""

import importlib
from collections.abc import Callable
from types import ModuleType

import numpy as np

from rona_core.geometry.arrays import Floats, Ints

Simplify = Callable[[Floats], Floats]  # points (n, 3) -> points kept (k, 2 or 3)


def as_index(points: Floats, kept: Floats) -> Ints:
    """Return which points were kept, found by their first two coordinates, in order."""
    index, at = [], 0
    for place in kept[:, :2]:
        at += int(np.abs(points[at:, :2] - place).sum(axis=1).argmin())
        index.append(at)
    return np.array(index, dtype=np.int64)


def _module(name: str) -> ModuleType | None:
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


def pybind11_rdp(tolerance: float) -> Simplify | None:
    """Return Ramer-Douglas-Peucker in C++, 2D and 3D."""
    module = _module("pybind11_rdp")
    if module is None:
        return None
    return lambda points: np.asarray(module.rdp(points, epsilon=tolerance), dtype=np.float64)


def rdp(tolerance: float) -> Simplify | None:
    """Return Ramer-Douglas-Peucker in Python, with the distance from the infinite line."""
    module = _module("rdp")
    if module is None:
        return None
    return lambda points: points[module.rdp(points, epsilon=tolerance, return_mask=True)]


def simplification(tolerance: float) -> Simplify | None:
    """Return Ramer-Douglas-Peucker in Rust; it knows two dimensions, so it gets x and y."""
    module = _module("simplification.cutil")
    if module is None:
        return None

    def kept(points: Floats) -> Floats:
        flat = np.ascontiguousarray(points[:, :2])
        return np.asarray(module.simplify_coords(flat, tolerance), dtype=np.float64)

    return kept


def shapely(tolerance: float) -> Simplify | None:
    """Return the simplification of GEOS, which carries z along without looking at it."""
    module = _module("shapely")
    if module is None:
        return None

    def kept(points: Floats) -> Floats:
        line = module.LineString(points).simplify(tolerance, preserve_topology=False)
        return np.asarray(line.coords, dtype=np.float64)

    return kept


PEERS: tuple[tuple[str, Callable[[float], Simplify | None]], ...] = (
    ("pybind11-rdp", pybind11_rdp),
    ("rdp", rdp),
    ("simplification (xy)", simplification),
    ("shapely", shapely),
)
