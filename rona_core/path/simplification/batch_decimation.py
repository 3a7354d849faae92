"""Greedy vertex decimation in batches, in the very order of one point at a time.

Removing a point changes the costs of its two neighbours alone. Between two bounds of the cost only
a few points go, in clusters apart from one another; clusters that never touch the same point
cannot influence one another, so all advance together. Two that do touch are put back and advance
as one. Within a cluster the points that would go by their present keys are found at once; those up
to the first whose removal makes another point cheap really go, then the rest is looked at afresh.
"""

from collections.abc import Callable

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints

SHARE, AT_LEAST = 0.08, 12  # of the points left: how many the next band takes

Costs = Callable[[Ints, Ints], Floats]  # first and last original of pieces -> their costs
Allowed = Callable[[Ints, Ints], Bools]  # the same -> whether a segment may replace them


def decimate(
    fixed: Bools, costs: Costs, allowed: Allowed | None, tolerance: float
) -> tuple[Ints, Floats]:
    """Return the points in the order they go, and what each cost.

    Always the point of least (cost, gap between its neighbours, index) goes next.

    Args:
        fixed: Mask (n,) of the points that stay, ends included.
        costs: Deviation of pieces.
        allowed: Whether pieces may become segments; None allows all.
        tolerance: The search ends when the cheapest removal costs more.
    """
    index, stays = np.arange(len(fixed)), fixed
    free = np.flatnonzero(~fixed)
    cost = np.full(len(fixed), np.inf)
    cost[free] = costs(free - 1, free + 1)
    untested = np.full(len(fixed), allowed is not None)
    order = [np.zeros(0, dtype=np.int64)]
    paid = [np.zeros(0)]
    while (bound := _bound(index, cost, tolerance)) is not None:
        band = _Band(index, stays, cost, untested, bound, costs, allowed)
        gone, spent = band.run()
        order.append(index[gone])
        paid.append(spent)
        there = band.there
        index, stays = index[there], stays[there]
        cost, untested = band.cost[there], band.untested[there]
    return np.concatenate(order), np.concatenate(paid)


def _bound(index: Ints, cost: Floats, tolerance: float) -> tuple[float, int] | None:
    """Return the cost and gap up to which the next band goes, or None if nothing may go."""
    able = np.flatnonzero((cost <= tolerance) & (cost < np.inf))
    if not len(able):
        return None
    wanted = min(len(able), max(AT_LEAST, int(SHARE * len(able)))) - 1
    costs = cost[able]
    limit = float(np.partition(costs, wanted)[wanted])
    equal = able[costs == limit]
    gaps = index[equal + 1] - index[equal - 1]
    place = wanted - int((costs < limit).sum())
    return limit, int(np.partition(gaps, place)[place])


def _chosen(rank: Ints, linked: Bools) -> Bools:
    """Return which points of a chain go, smallest rank first, if each saves its neighbours.

    From a local minimum upwards every other point goes; a local maximum goes if both beside stay.
    """
    n = len(rank)
    rising = linked & (rank[1:] > rank[:-1])
    left_less = np.concatenate(([False], rising))
    right_less = np.concatenate((linked & ~rising, [False]))
    at = np.arange(n)
    from_left = at - np.maximum.accumulate(np.where(left_less & ~right_less, 0, at))
    from_right = np.minimum.accumulate(np.where(right_less & ~left_less, n, at)[::-1])[::-1] - at
    goes = (np.where(left_less, from_left, from_right) % 2 == 0) & ~(left_less & right_less)
    peaks = np.flatnonzero(left_less & right_less)
    goes[peaks] = ~goes[peaks - 1] & ~goes[peaks + 1]
    return goes


class _Band:
    """All removals up to one bound of (cost, gap), by clusters that do not touch.

    Points are named by their position among those there at the start of the band.
    """

    def __init__(
        self,
        index: Ints,
        stays: Bools,
        cost: Floats,
        untested: Bools,
        bound: tuple[float, int],
        costs: Costs,
        allowed: Allowed | None,
    ) -> None:
        m = len(index)
        self.index, self.stays, self.bound = index, stays, bound
        self.costs, self.allowed = costs, allowed
        self.first_cost, self.first_untested = cost, untested
        self.cost, self.untested = cost.copy(), untested.copy()
        self.left, self.right = np.arange(m) - 1, np.arange(m) + 1
        self.there = np.ones(m, dtype=np.bool_)
        self.cluster = np.zeros(m, dtype=np.int64)  # of the points touched
        self.low = self.high = np.zeros(0, dtype=np.int64)  # of each cluster: what it touched
        self.valid = np.zeros(0, dtype=np.bool_)  # not put back
        self.events: list[tuple[Ints, Floats, Ints, Ints, Ints]] = []

    def run(self) -> tuple[Ints, Floats]:
        """Return positions in the order they go, and what each cost."""
        every = np.flatnonzero(self.cost <= self.bound[0])
        active = every[self._cheap(every)]
        fresh = np.concatenate(([True], np.diff(active) > 2))
        self._begin(active, np.cumsum(fresh) - 1)
        while True:
            self._advance(active)
            live = np.flatnonzero(self.valid)
            live = live[np.argsort(self.low[live])]
            low, high = self.low[live], self.high[live]
            joint = np.cumsum(np.append(True, low[1:] > np.maximum.accumulate(high)[:-1])) - 1
            size = np.bincount(joint)
            if size.max() == 1:
                return self._in_order()
            heads = np.flatnonzero(np.append(True, np.diff(joint) > 0))
            low, high = low[heads][size > 1], np.maximum.reduceat(high, heads)[size > 1]
            self.valid[live[size[joint] > 1]] = False
            active = self._put_back(low, high)
            self._begin(active, np.searchsorted(low, active, side="right") - 1)

    def _cheap(self, at: Ints) -> Bools:
        """Return which points have a key within the bound."""
        gap = self.index[self.right[at]] - self.index[self.left[at]]
        return self._within(self.cost[at], gap)

    def _within(self, cost: Floats, gap: Ints) -> Bools:
        return (cost < self.bound[0]) | ((cost == self.bound[0]) & (gap <= self.bound[1]))

    def _begin(self, active: Ints, cluster: Ints) -> None:
        """Give points that start clusters their number; ``cluster`` counts from 0 upwards."""
        heads = np.flatnonzero(np.append(True, np.diff(cluster) > 0))
        self.cluster[active] = cluster + len(self.low)
        self.low = np.append(self.low, active[heads])
        self.high = np.append(self.high, active[np.append(heads[1:], len(active)) - 1])
        self.valid = np.append(self.valid, np.ones(len(heads), dtype=np.bool_))

    def _put_back(self, low: Ints, high: Ints) -> Ints:
        """Undo all between the positions given; return the points that are cheap there again."""
        sizes = high - low + 1
        at = np.arange(int(sizes.sum())) + np.repeat(low - (np.cumsum(sizes) - sizes), sizes)
        self.there[at], self.left[at], self.right[at] = True, at - 1, at + 1
        self.cost[at], self.untested[at] = self.first_cost[at], self.first_untested[at]
        maybe = at[self.cost[at] <= self.bound[0]]
        return maybe[self._cheap(maybe)]

    def _advance(self, active: Ints) -> None:
        """Let every cluster remove its points until none is cheap; ``active`` is in order."""
        turn = 0
        while True:
            active = self._tested(active)
            if not len(active):
                return
            active = self._turn(active, turn)
            turn += 1

    def _tested(self, active: Ints) -> Ints:
        if self.allowed is None:
            return active
        some = active[self.untested[active]]
        good = self.allowed(self.index[self.left[some]], self.index[self.right[some]])
        self.untested[some] = False
        self.cost[some[~good]] = np.inf
        return active[self.cost[active] < np.inf]

    def _turn(self, active: Ints, turn: int) -> Ints:
        """Remove what surely goes next in each cluster; return the points that are cheap then."""
        index, left, right = self.index, self.left, self.right
        gap = index[right[active]] - index[left[active]]
        rank = np.zeros(len(active), dtype=np.int64)
        rank[np.lexsort((active, gap, self.cost[active]))] = np.arange(len(active))
        goes = _chosen(rank, right[active[:-1]] == active[1:])
        pop, rank, gap = active[goes], rank[goes], gap[goes]
        a, b = left[pop], right[pop]  # they stay in this turn
        shared = b[:-1] == a[1:]
        k = np.arange(len(pop))
        by_left = k[np.append(shared, False) ^ True]  # b[k] loses only its left neighbour
        by_right = k[np.append(False, shared) ^ True]
        both = k[:-1][shared]
        by_left = by_left[~self.stays[b[by_left]]]
        by_right = by_right[~self.stays[a[by_right]]]
        both = both[~self.stays[b[both]]]
        earlier = np.where(rank[both] < rank[both + 1], both, both + 1)
        later = 2 * both + 1 - earlier
        # the points touched, the piece each then stands for, and by which removal
        touched = np.concatenate((b[by_left], a[by_right], b[both], b[both]))
        starts = np.concatenate(
            (a[by_left], left[a[by_right]], np.where(earlier == both, a[both], pop[both]), a[both])
        )
        ends = np.concatenate(
            (
                right[b[by_left]],
                b[by_right],
                np.where(earlier == both, pop[both + 1], b[both + 1]),
                b[both + 1],
            )
        )
        cause = np.concatenate((by_left, by_right, earlier, later))
        starts, ends = index[starts], index[ends]
        cost = self.costs(starts, ends)
        revived = self._within(cost, ends - starts)
        # in each cluster, all up to the first removal that makes another point cheap
        last = np.full(len(self.low), len(active))
        np.minimum.at(last, self.cluster[pop[cause[revived]]], rank[cause[revived]])
        sure = rank <= last[self.cluster[pop]]
        owner = self.cluster[pop[cause]]
        pop, gap, a, b = pop[sure], gap[sure], a[sure], b[sure]
        cluster = self.cluster[pop]
        self.events.append((pop, self.cost[pop], gap, cluster, np.full(len(pop), turn)))
        self.there[pop] = False
        right[a], left[b] = b, a
        np.minimum.at(self.low, cluster, a)
        np.maximum.at(self.high, cluster, b)
        done = sure[cause]  # where both sides are done, the final cost is written last
        self.cost[touched[done]], self.cluster[touched[done]] = cost[done], owner[done]
        self.untested[touched[done]] = self.allowed is not None
        found = np.unique(np.concatenate((active, touched[done & revived])))
        found = found[self.there[found]]
        return found[self._cheap(found)]

    def _in_order(self) -> tuple[Ints, Floats]:
        """Return the events as one at a time would bring them about.

        The cluster whose next key is least moves next: an event happens when the largest key of
        its cluster up to it comes up.
        """
        if not self.events:  # all that was cheap may not go
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        pop, cost, gap, cluster, turn = (
            np.concatenate(parts) for parts in zip(*self.events, strict=True)
        )
        real = self.valid[cluster]
        pop, cost, gap, cluster, turn = (x[real] for x in (pop, cost, gap, cluster, turn))
        n = len(pop)
        rank = np.zeros(n, dtype=np.int64)
        rank[np.lexsort((pop, gap, cost))] = np.arange(n)
        told = np.lexsort((rank, turn, cluster))
        offset = cluster[told] * n
        due = np.maximum.accumulate(rank[told] + offset) - offset
        told = told[np.argsort(due, kind="stable")]
        return pop[told], cost[told]
