"""Neighbourhoods: the points of a cloud within a radius of many places."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.geometry.arrays import Bools, Floats, Ints

BATCH = 400_000  # padded neighbours handed out together


@dataclass(frozen=True, slots=True, eq=False)
class Neighbourhoods:
    """The neighbours of b places, padded to the largest neighbourhood among them."""

    rows: Ints  # (b,) which of the places
    offsets: Floats  # (b, k, 3) neighbours minus place; zero where there is none
    there: Bools  # (b, k)


def neighbourhoods(tree: KDTree, places: Floats, radius_mm: float) -> Iterator[Neighbourhoods]:
    """Yield the neighbourhoods of all ``places`` (m, 3) that have any, a batch at a time."""
    if not tree.n or not len(places):
        return
    counts = np.asarray(tree.query_ball_point(places, radius_mm, return_length=True))
    rows = np.argsort(-counts, kind="stable")[: np.count_nonzero(counts)]
    while len(rows):  # the largest come first, so that little is padded
        width = int(counts[rows[0]])
        batch, rows = np.split(rows, [max(1, BATCH // width)])
        bound_mm = float(np.nextafter(radius_mm, np.inf))  # points at the radius count
        nearest = tree.query(places[batch], k=width, distance_upper_bound=bound_mm)[1]
        found = np.asarray(nearest, dtype=np.int64).reshape(len(batch), width)
        there = found < tree.n
        offsets = tree.data[np.where(there, found, 0)] - places[batch][:, None]
        yield Neighbourhoods(batch, np.where(there[:, :, None], offsets, 0.0), there)
