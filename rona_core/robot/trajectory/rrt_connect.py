"""RRT-Connect (Kuffner 2000): collision-free joint paths by two growing trees, and shortcuts.

Both trees grow towards random places and then towards each other. The numbers come from a seed, so
that the same question has the same answer.
"""

from itertools import pairwise

import numpy as np

from rona_core.geometry.arrays import Floats
from rona_core.robot.collision.edge_check import Checker

GROWTH_RAD = 0.5  # length of a branch, in weighted joint angles
WEIGHTS = np.array((1.0, 1.0, 1.0, 0.5, 0.5, 0.3))  # the first joints move the most
ROOM_RAD = float(np.deg2rad(80.0))  # random places lie this far beyond start and goal
SHORTCUTS = 60
COARSE = (4, 2, 1)  # how many times farther apart places are looked at while trees grow
ARRIVED = 1e-9


class _Tree:
    """Places reached from one end, each with the place it was reached from."""

    def __init__(self, root: Floats) -> None:
        self.places, self.parents = [root], [-1]
        self.weighted = [root * WEIGHTS]

    def nearest(self, q: Floats) -> int:
        gaps = np.array(self.weighted) - q * WEIGHTS
        return int(np.argmin(np.einsum("ij,ij->i", gaps, gaps)))

    def add(self, q: Floats, parent: int) -> int:
        self.places.append(q)
        self.parents.append(parent)
        self.weighted.append(q * WEIGHTS)
        return len(self.places) - 1

    def branch(self, index: int) -> list[Floats]:
        """Return the places from the root to one of them."""
        result: list[Floats] = []
        while index >= 0:
            result.append(self.places[index])
            index = self.parents[index]
        return result[::-1]


def search(q_from_rad: Floats, q_to_rad: Floats, checker: Checker, seed: int) -> Floats | None:
    """Return joint angles (k, 6) of a clear way from one place to another, None if none is found.

    Both ends are taken to be clear. Trees grow on a coarse look; a way that they find is looked at
    closely, and if it is not clear the search begins again with a closer look. It ends when the
    checker has looked at as many places as it may.
    """
    rng = np.random.default_rng(seed)
    for coarse in COARSE:
        stops = _search(q_from_rad, q_to_rad, checker, rng, coarse)
        if stops is None:
            return None
        if all(checker.move(a, b) for a, b in pairwise(stops)):
            return stops
    return None


def _search(
    q_from_rad: Floats,
    q_to_rad: Floats,
    checker: Checker,
    rng: np.random.Generator,
    coarse: int,
) -> Floats | None:
    limits = checker.model.limits
    low = np.maximum(np.minimum(q_from_rad, q_to_rad) - ROOM_RAD, limits.lower_rad)
    high = np.minimum(np.maximum(q_from_rad, q_to_rad) + ROOM_RAD, limits.upper_rad)
    growing, other = _Tree(q_from_rad), _Tree(q_to_rad)
    swapped = False
    while not checker.spent:
        reached = _grow(growing, rng.uniform(low, high), checker, coarse)
        if reached >= 0:
            met = _connect(other, growing.places[reached], checker, coarse)
            if met >= 0:
                start, end = growing.branch(reached), other.branch(met)[::-1]
                stops = np.array(start + end[1:])
                return stops[::-1].copy() if swapped else stops
        growing, other, swapped = other, growing, not swapped
    return None


def shortened(stops_rad: Floats, checker: Checker, seed: int) -> Floats:
    """Return a clear way (k, 6) without the detours that can be cut off."""
    rng = np.random.default_rng(seed)
    stops = [np.asarray(q) for q in stops_rad]
    for _ in range(SHORTCUTS):
        if len(stops) == 2:
            break
        first, last = np.sort(rng.uniform(0.0, len(stops) - 1.0, 2))
        i, j = int(first), min(int(last), len(stops) - 2)
        if i == j:
            continue
        a = stops[i] + (first - i) * (stops[i + 1] - stops[i])
        b = stops[j] + (last - j) * (stops[j + 1] - stops[j])
        if checker.move(a, b):
            stops = [*stops[: i + 1], a, b, *stops[j + 1 :]]
    return np.array(_straightened(stops, checker))


def _straightened(stops: list[Floats], checker: Checker) -> list[Floats]:
    """Return the way with every place left out that can be passed by."""
    result = [stops[0]]
    i = 0
    while i < len(stops) - 1:
        j = len(stops) - 1
        while j > i + 1 and not checker.move(stops[i], stops[j]):
            j -= 1
        result.append(stops[j])
        i = j
    return result


def _grow(tree: _Tree, towards: Floats, checker: Checker, coarse: int) -> int:
    """Grow one branch towards a place; return the new place, -1 where it is blocked at once."""
    nearest = tree.nearest(towards)
    start = tree.places[nearest]
    length = float(np.linalg.norm((towards - start) * WEIGHTS))
    end = start + min(1.0, GROWTH_RAD / max(length, ARRIVED)) * (towards - start)
    if not checker.move(start, end, coarse):
        return -1
    return tree.add(end, nearest)


def _connect(tree: _Tree, goal: Floats, checker: Checker, coarse: int) -> int:
    """Grow towards the goal until it is reached (its number in this tree) or blocked (-1)."""
    while not checker.spent:
        reached = _grow(tree, goal, checker, coarse)
        if reached < 0:
            return -1
        if np.abs(tree.places[reached] - goal).max() < ARRIVED:
            return reached
    return -1
