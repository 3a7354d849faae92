"""Rows of a further pass, led round what the probe is to keep off."""

from itertools import pairwise

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.path.scan_patterns import Detours, Inside

Row = tuple[Floats, Floats]  # start and end (2,) in cells of the map
LOOK = 0.5  # cells between places at which a row is looked at


def lead_rows(rows: list[Row], inside: Inside, shape: tuple[int, int]) -> list[Row]:
    """Return the parts of rows that stay inside, the nearest next, and rows for the ways between.

    What no way leads to is left out.

    Args:
        rows: In the order of scanning.
        inside: Which places (k, 2) in cells the probe may come to.
        shape: Of the map, in cells.
    """
    left = [part for row in rows for part in _parts(row, inside)]
    if not left:
        return []
    detours = Detours(inside, np.zeros(2), np.array(shape) - 1.0, 1.0)
    led = [left.pop(0)]
    while left:
        end = led[-1][1]
        ends = np.array(left).reshape(-1, 2)
        lengths = detours.lengths(end, ends)
        nearest = int(lengths.argmin())
        way = detours.way(end, ends[nearest])
        if way is None:
            return led
        led += list(pairwise(way)) if len(way) > 1 else [(w, w) for w in way]
        start, stop = left.pop(nearest // 2)
        led.append((stop, start) if nearest % 2 else (start, stop))
    return led


def _parts(row: Row, inside: Inside) -> list[Row]:
    start, end = row
    count = int(np.ceil(np.linalg.norm(end - start) / LOOK)) + 1
    places = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
    good = np.concatenate(([False], inside(places), [False]))
    first, last = np.flatnonzero(~good[:-1] & good[1:]), np.flatnonzero(good[:-1] & ~good[1:]) - 1
    return [(places[a], places[b]) for a, b in zip(first, last, strict=True)]
