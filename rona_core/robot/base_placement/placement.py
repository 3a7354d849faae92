"""Base placement: places of the robot base from which the path can be scanned.

A grid of places around the base is screened; the place with the largest margin and the nearest one
that works are then planned in full on the dense path, timed and verified. Turning the base about
the vertical is the same as an offset of joint 1, so every place has the base turned towards the
head. See docs/algorithms/robot/base_placement.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require
from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.settings import RobotSettings
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.path5d import Path5D, resample_path
from rona_core.robot.base_placement.reachability import (
    FARTHEST_MM,
    BasePlace,
    BasePlacement,
    BaseSearch,
    Planner,
    ReachabilityMap,
    Spot,
)
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.planning.plan_motion import PlanSettings, plan_scan

HALVINGS = 5  # of the smallest move
DIRECTIONS, SHARES = 16, (0.4, 0.6, 0.8)  # looked at for a smaller move
POLISH = (0.5, 0.25)  # of a grid step, around the place with the largest margin
MOST_TRIES = 5  # places that are planned in full, for the best and for the nearest one each
HOPELESS_TRIES = 3  # likewise where no constant roll seems to work: a varying one may
COMFORTABLE = 0.25  # room at which jumps are hardly met
SCREENED = 0.5  # of the progress


def place_base(
    path: Path5D,
    model: RobotModel,
    robot: RobotSettings,
    *,
    search: BaseSearch | None = None,
    planner: Planner | None = None,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> BasePlacement:
    """Search places of the base from which the path can be scanned.

    Args:
        path: The scan path in ``base``, as the base stands now.
        model: The robot with its tool.
        robot: Where the base stands now.
        search: Where to look, and how closely.
        planner: Plans a path in full from a new place, given the path and the pose of the old
            base as seen from there, with which to move whatever else stands around; the default
            is ``plan_scan``.
        progress: Receives the share that is done, 0 to 1.
        cancel: Asked between places.

    Raises:
        InvalidInputError: a path without length.
        DegenerateGeometryError: neighbouring axes of the path are opposite.
        CancelledError: ``cancel`` returned True.
    """
    search = search or BaseSearch()
    require(path.arc_length_mm()[-1] > 0.0, "a scan path needs two different points")
    settings = PlanSettings(margin_limits=search.margin_limits)
    planner = planner or (lambda seen, old_in_new: plan_scan(seen, model, settings, cancel=cancel))
    places = ReachabilityMap(resample_path(path), model, robot, search, planner, progress, cancel)
    chart = _screened(places)
    smallest = _smallest(places, chart)
    best = _best(places, chart, smallest)
    progress(1.0)
    return BasePlacement(
        x_mm=readonly(chart.x_mm),
        y_mm=readonly(chart.y_mm),
        margins=readonly(chart.margins.astype(np.float32)),
        turns_deg=readonly(chart.spots[:, :, 3].astype(np.float32)),
        levels_mm=readonly(chart.spots[:, :, 2].astype(np.float32)),
        blocked=readonly(chart.blocked),
        planned=readonly(places.marked(chart.spots, certified=False)),
        verified=readonly(places.marked(chart.spots, certified=True)),
        here=places.margin(places.now),
        best=best,
        smallest=smallest,
        reasons=_reasons(places, chart, best, smallest),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Chart:
    """The screened grid."""

    x_mm: Floats  # (nx,)
    y_mm: Floats  # (ny,)
    spots: Floats  # (nx, ny, 4) the best height at each place, aimed
    margins: Floats  # (nx, ny)
    blocked: Bools  # (nx, ny)

    def ranked(self, least: float) -> list[tuple[float, Spot]]:
        """Return margin and spot of what has at least this margin, the largest first."""
        found: list[tuple[float, Spot]] = []
        for i, j in np.argwhere((self.margins >= least) & ~self.blocked):
            x, y, z, turn = (float(v) for v in self.spots[i, j])
            found.append((float(self.margins[i, j]), (x, y, z, turn)))
        return sorted(found, key=lambda item: (-item[0], item[1]))


def _screened(places: ReachabilityMap) -> _Chart:
    """Return the margins of all places of the grid."""
    search = places.search
    halves = (search.half_x_mm, search.half_y_mm)
    x, y = (
        _ticks(middle, half, search.step_mm)
        for middle, half in zip(places.now, halves, strict=False)
    )
    shape = (len(x), len(y))
    margins, blocked = np.full(shape, -np.inf), np.zeros(shape, dtype=np.bool_)
    spots = np.zeros((*shape, 4))
    for i, j in np.ndindex(shape):
        x_mm, y_mm = float(x[i]), float(y[j])
        blocked[i, j] = places.too_near(x_mm, y_mm)
        for level_mm in search.levels_mm:
            spot = places.aimed(x_mm, y_mm, places.now[2] + level_mm)
            margin = -1.0 if blocked[i, j] else places.margin(spot)
            if margin > margins[i, j]:
                margins[i, j], spots[i, j] = margin, spot
        places.tick(SCREENED * (i * len(y) + j + 1) / margins.size)
    return _Chart(x, y, spots, margins, blocked)


def _ticks(now_mm: float, half_mm: float, step_mm: float) -> Floats:
    count = int(half_mm / step_mm + 1e-9)
    ticks = now_mm + step_mm * np.arange(-count, count + 1, dtype=np.float64)
    return ticks[np.abs(ticks) <= FARTHEST_MM]


def _smallest(places: ReachabilityMap, chart: _Chart) -> BasePlace | None:
    """Return the nearest place that was found to work, where the base stands if that does."""
    place = places.plan(places.now)
    if place is not None:
        return place
    working = chart.ranked(places.search.reserve)
    near = sorted(working, key=lambda item: (places.moved_mm(item[1]), item[1]))
    calm = [item for item in near if item[0] >= COMFORTABLE]
    for _, spot in near[:MOST_TRIES] + calm[:MOST_TRIES]:
        place = places.plan(_unturned(places, spot))
        if place is not None:
            return _around(places, _nearer(places, place))
    return None


def _unturned(places: ReachabilityMap, spot: Spot) -> Spot:
    """Return the spot without a turn of the base, where that seems to work as well."""
    kept: Spot = (spot[0], spot[1], spot[2], places.now[3])
    return kept if places.margin(kept) >= places.search.reserve else spot


def _nearer(places: ReachabilityMap, place: BasePlace) -> BasePlace:
    """Return a place on the way to a place that works, as far back as works."""
    start, end = np.array(places.now[:3]), np.array(place.shift_mm)
    kept = place.turn_deg == places.now[3]

    def at(share: float) -> Spot:
        x, y, z = (float(v) for v in np.round(start + share * (end - start)))
        return (x, y, z, places.now[3]) if kept else places.aimed(x, y, z)

    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        if places.margin(at(middle)) >= places.search.reserve:
            high = middle
        else:
            low = middle
    for share in (high, (high + 1.0) / 2.0):
        if share < 1.0:
            nearer = places.plan(at(share))
            if nearer is not None:
                return nearer
    return place


def _around(places: ReachabilityMap, place: BasePlace) -> BasePlace:
    """Return a place less far away in another direction, where there is one."""
    angles = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    for share in SHARES:
        found: list[tuple[float, Spot]] = []
        for angle in angles:
            x, y = np.round(share * place.moved_mm * np.array((np.cos(angle), np.sin(angle))))
            spot = places.aimed(places.now[0] + x, places.now[1] + y, places.now[2])
            spot = _unturned(places, spot)
            if not places.too_near(*spot[:2]):
                found.append((places.margin(spot), spot))
        margin, spot = max(found, default=(-1.0, places.now))
        other = places.plan(spot) if margin >= places.search.reserve else None
        if other is not None:
            return _nearer(places, other)
    return place


def _best(places: ReachabilityMap, chart: _Chart, smallest: BasePlace | None) -> BasePlace | None:
    """Return the place with the largest margin that was found to work."""
    ranked = chart.ranked(-np.inf)
    working = [item for item in ranked if item[0] >= 0.0]
    hopeless = [item for item in ranked if item[0] < 0.0]
    if working:
        working.insert(0, _polished(places, *working[0]))
    tries = working[:MOST_TRIES] or ([] if smallest else hopeless[:HOPELESS_TRIES])
    for _, spot in tries:
        place = places.plan(spot)
        if place is not None:
            better = smallest is None or place.margin >= smallest.margin
            return place if better else smallest
    return smallest


def _polished(places: ReachabilityMap, margin: float, spot: Spot) -> tuple[float, Spot]:
    """Return a spot with a larger margin near the best one of the grid."""
    for share in POLISH:
        step = share * places.search.step_mm
        x0, y0, z0, _ = spot
        for x, y in ((x0 + i * step, y0 + j * step) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            near = places.aimed(x, y, z0)
            inside = max(abs(x), abs(y)) <= FARTHEST_MM and not places.too_near(x, y)
            if inside and (value := places.margin(near)) > margin:
                margin, spot = value, near
    return margin, spot


def _reasons(
    places: ReachabilityMap, chart: _Chart, best: BasePlace | None, smallest: BasePlace | None
) -> tuple[str, ...]:
    """Return in plain words what was found."""
    here = places.margin(places.now)
    looked = int(np.count_nonzero(~chart.blocked))
    seeming = len(chart.ranked(0.0))
    words = [
        f"where the base stands, the smallest margin of a constant roll is {here:.2f}, 0 is needed",
        f"{seeming} of {looked} places seem to work with a constant roll; "
        f"{chart.blocked.sum()} are too near the head",
    ]
    if smallest is not None and best is not None:
        words += [f"smallest move: {smallest.sentence}", f"largest margin: {best.sentence}"]
    else:
        words.append("no place was found from which the scan is certified")
    return tuple(words + places.refusals)
