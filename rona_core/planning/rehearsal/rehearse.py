"""A milling rehearsed at a site: layers, the floor scanned again, the depth put right, the rest.

See docs/algorithms/implant/rehearsal.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rona_core.devices.protocols import Cancel, Progress, never, silent
from rona_core.devices.samples import AScanTrack
from rona_core.errors import CancelledError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.planning.placement.figures import chance_above, spreads_for
from rona_core.planning.rehearsal.breakthrough import Breakthrough, FeedControl
from rona_core.planning.rehearsal.milled_floor import (
    ROUGH_MM,
    CommandedFloor,
    CorrectedBone,
    FloorLine,
    MeasuredFloor,
    ceiling_mm,
    floor_line,
)
from rona_core.planning.rehearsal.site import BurrWay, MillingSite, ProbeWay
from rona_core.planning.robot_milling import RobotPath

STEP_MM = 0.25  # between places of the way at which force is felt
FINE_MM = 0.1  # between those they are taken from: the tip may go further than the ball


def burr_way(
    path: RobotPath, layers: Ints, ways_mm: Floats, qs_rad: Floats, times_s: Floats
) -> BurrWay:
    """Return the places at which the burr cuts, evenly along its way.

    Args:
        path: What the robot drives.
        layers: Of the n places of the milling path (n,).
        ways_mm: Along the path of the robot (k,), never falling.
        qs_rad: Postures there (k, 6).
        times_s: When the robot is there (k,).
    """
    cutting = path.cutting
    ways = np.arange(0.0, float(cutting.way_mm()[-1]), FINE_MM)
    moves = cutting.moves_at(ways)
    cuts = ~cutting.in_air[moves]
    ways, moves = ways[cuts], moves[cuts]
    bottoms = cutting.at(ways).bottoms_bed
    gone = np.cumsum(np.linalg.norm(np.diff(bottoms, axis=0, prepend=bottoms[:1]), axis=1))
    kept = np.diff(np.floor(gone / STEP_MM), prepend=-1.0) > 0.0
    ways, moves = ways[kept], moves[kept]
    qs = [np.interp(ways, ways_mm, q) for q in qs_rad.T]
    return BurrWay(
        T_base_bed=cutting.T_base_bed,
        bottoms_bed=bottoms[kept],
        radii_mm=cutting.radii_mm[moves],
        qs_rad=np.column_stack(qs),
        times_s=np.interp(ways, ways_mm, times_s),
        feeds_mm_per_s=cutting.feeds_mm_per_s[moves],
        layers=layers[path.places[moves]],
    )


RESOLVED_MARGIN_MM = 0.3  # over the least bone that the probe resolves
RESOLVED_SIGMAS = 2.0
# rms by which the burr is elsewhere along the axis of the bed: the head moves in its clamp, and the
# burr sits anew in its chuck after the scan of the floor; 0.1 mm each, assumed
REPOSITIONING_MM = 0.14
NOISE_SEED = (0, 1)  # not that of the errors of execution, which the draws hold
MOST_THROUGH = 0.3  # probability of a breakthrough, above which the burr stops
WATCH = 200  # steps between two looks at cancel
AT_ONCE = 512  # places that are worked on together: thousands with all draws take much memory

# boundary heights in bed: places (n, 3) -> (n,)
Heights = Callable[[Floats], Floats]
# bone at places (n, 3) of ``bed`` by the maps (n,), and in draws of them (n, k)
Mapped = Callable[[Floats], tuple[Floats, Floats]]
# A-scans on a floor, places -> thickness, sigma, ok (m,), and the relative sigma that all share
MeasureFloor = Callable[[AScanTrack, Floats], tuple[Floats, Floats, Bools, float]]
# what is left of the way after a layer, nothing of it below a height, in the postures of a motion
# that is certified for it; None: nothing is left, or no motion is certified
RaiseWay = Callable[[int, float], BurrWay | None]
# a probe at the places of a line, in the postures of a motion that is certified for it; None: none
PlanFloorScan = Callable[[FloorLine], ProbeWay | None]


@dataclass(frozen=True, slots=True)
class Guards:
    """What keeps the burr off the dura."""

    rescan: bool = True  # and put the depth right
    stop_on_force: bool = True  # stop where force and maps say that the burr is through


@dataclass(frozen=True, slots=True, eq=False)
class MillingTask:
    """What is to be milled, and what is known of the bone."""

    way: BurrWay
    mapped: Mapped  # the shortest way to the inner boundary
    along_axis: Mapped  # the way along the axis of the bed: what a probe on the floor measures
    outer_mm: Heights  # of the mapped outer boundary
    raised: RaiseWay
    floor_scan: PlanFloorScan
    limit_mm: float
    probability: float
    face_radius_mm: float  # of the probe
    resolved_mm: float  # of bone, the least that the probe resolves


@dataclass(frozen=True, slots=True, eq=False)
class MillingOutcome:
    """How a rehearsal went."""

    pause: int  # last layer before the floor was scanned again; -1: it was not
    ceiling_mm: float  # height below which nothing was to be milled after that; -inf: as planned
    steps: int  # done, up to the scan on the way as planned and then on the raised one
    stopped: bool  # by the force
    asked: int  # places of the floor that were scanned
    measured: MeasuredFloor | None  # what counted of them
    raised_mm: float  # by which the lowest place is higher than planned
    residual_mm: float  # least bone below what was milled, as thought in the end: median
    probability: float  # that it is as much as was asked for
    duration_s: float  # of cutting
    most_n: float  # force
    through: Floats  # (steps,) probability at each that the burr was through, see `Breakthrough`


def rehearse(
    task: MillingTask,
    site: MillingSite,
    measure: MeasureFloor,
    guards: Guards | None = None,
    *,
    progress: Progress = silent,
    cancel: Cancel = never,
) -> MillingOutcome:
    """Mill a bed at a site, deciding by force and by A-scans alone.

    Raises:
        CancelledError: ``cancel`` returned True.
    """
    return _Rehearsal(task, site, guards or Guards(), progress, cancel).run(measure)


class _Rehearsal:
    """One rehearsal under way."""

    def __init__(
        self,
        task: MillingTask,
        site: MillingSite,
        guards: Guards,
        progress: Progress,
        cancel: Cancel,
    ) -> None:
        self._task, self._site, self._guards = task, site, guards
        self._progress, self._cancel = progress, cancel
        way = task.way
        reach = np.abs(way.bottoms_bed[:, :2]).max() + way.radii_mm.max()
        self._floor = CommandedFloor(float(reach))
        cells = self._floor.cells()
        heights = task.outer_mm(np.column_stack((cells, np.zeros(len(cells)))))
        self._floor.top_mm = heights.reshape(self._floor.top_mm.shape).copy()
        self._feed, self._force = FeedControl(), Breakthrough(float(reach))
        self._duration_s, self._most_n, self._done = 0.0, 0.0, 0
        self._through: list[float] = []

    def run(self, measure: MeasureFloor) -> MillingOutcome:
        """Mill the first layers, scan their floor, put the depth right and mill the rest."""
        task, way = self._task, self._task.way
        drawn = task.mapped(way.bottoms_bed)[1]
        pause = self._pause(drawn) if self._guards.rescan else -1
        random = np.random.default_rng(NOISE_SEED)
        wander = REPOSITIONING_MM * random.standard_normal(drawn.shape[1])
        count = int(np.searchsorted(way.layers, pause, side="right"))
        later = np.arange(len(way)) >= count
        first, rest = way.part(~later), way.part(later)
        done, stopped = self._mill(first, lambda row: np.asarray(drawn[row] + wander))
        asked, measured, ceiling, steps, below = 0, None, -np.inf, 0, drawn[count:]
        if not stopped:
            if len(first):
                asked, measured = self._scan(measure, first)
            bone = None if measured is None else CorrectedBone(measured, random)
            drawn = _corrected(bone, way.bottoms_bed, drawn, wander)
            below = drawn[count:]
            if self._guards.rescan:
                spreads = spreads_for(task.probability)
                ceiling = ceiling_mm(rest.bottoms_bed, below, task.limit_mm, spreads)
            if ceiling > -np.inf:
                raised = task.raised(pause, ceiling)
                rest = rest.part(np.zeros(len(rest), np.bool_)) if raised is None else raised
                rest, below = rest.after(first), below[:0]
                if len(rest):
                    mapped = task.mapped(rest.bottoms_bed)[1]
                    below = _corrected(bone, rest.bottoms_bed, mapped, wander)
            steps, stopped = self._mill(rest, lambda row: below[row])
        self._progress(1.0)
        bottoms = np.concatenate((first.bottoms_bed[:done, 2], rest.bottoms_bed[:steps, 2]))
        left = np.minimum(
            drawn[:done].min(axis=0, initial=np.inf), below[:steps].min(axis=0, initial=np.inf)
        )
        if not len(bottoms):  # the bone is whole
            bottoms = task.outer_mm(way.bottoms_bed)
            left = (drawn + (bottoms - way.bottoms_bed[:, 2])[:, None]).min(axis=0)
        return MillingOutcome(
            pause=pause,
            ceiling_mm=ceiling,
            steps=done + steps,
            stopped=stopped,
            asked=asked,
            measured=measured,
            raised_mm=max(float(bottoms.min() - way.bottoms_bed[:, 2].min()), 0.0),
            residual_mm=float(np.median(left)),
            probability=chance_above(left, task.limit_mm).probability,
            duration_s=self._duration_s,
            most_n=self._most_n,
            through=np.array(self._through),
        )

    def _pause(self, drawn: Floats) -> int:
        """Return the last layer of the first burr that leaves bone to be resolved; -1: none."""
        task, way = self._task, self._task.way
        resolved = _surely(drawn, RESOLVED_SIGMAS) >= task.resolved_mm + RESOLVED_MARGIN_MM
        pause = -1
        for layer in np.unique(way.layers):
            own = way.layers == layer
            if way.radii_mm[own][0] != way.radii_mm[0] or not resolved[own].all():
                break
            pause = int(layer)
        return pause

    def _scan(self, measure: MeasureFloor, milled: BurrWay) -> tuple[int, MeasuredFloor | None]:
        """Return how many places of the floor were scanned, and what was measured there."""
        task = self._task
        below = float(milled.bottoms_bed[:, 2].min()) + ROUGH_MM
        line = floor_line(self._floor, task.face_radius_mm, below)
        way = None if line is None else task.floor_scan(line)
        if way is None:
            return 0, None
        places = way.places_bed
        track = self._site.scan_floor(replace(way, times_s=way.times_s + milled.times_s.max()))
        thickness, sigma, ok, common = measure(track, places)
        mapped, drawn = task.along_axis(places)
        rows = np.arange(len(places))
        measured = MeasuredFloor(rows, places, thickness, sigma, common, mapped, drawn).part(ok)
        measured = measured.without_outliers() if ok.any() else measured
        return len(places), measured if len(measured.residual_mm) else None

    def _mill(self, way: BurrWay, drawn_mm: Callable[[int], Floats]) -> tuple[int, bool]:
        """Mill along a way; return how many steps were done, and whether it was stopped.

        Args:
            way: To mill along.
            drawn_mm: Returns the bone below one of its places in draws (k,).
        """
        if not len(way):
            return 0, False
        self._site.follow(way)
        steps_mm = way.steps_mm()
        whole = len(self._task.way)
        for row in range(len(way)):
            feed = float(way.feeds_mm_per_s[row]) * self._feed.share
            radius = float(way.radii_mm[row])
            area = self._floor.cut(way.bottoms_bed[row], radius) / float(steps_mm[row])
            reading = self._site.advance(feed)
            self._feed.update(reading)
            self._duration_s += float(steps_mm[row]) / feed
            self._most_n = max(self._most_n, reading.mean_n)
            self._force.begin_layer(int(way.layers[row]))
            through = self._force.update(reading, way.bottoms_bed[row], area, feed, drawn_mm(row))
            self._through.append(through)
            self._done += 1
            if self._guards.stop_on_force and through > MOST_THROUGH:
                return row + 1, True
            if self._done % WATCH == 0:
                self._progress(min(self._done / whole, 0.99))
                if self._cancel():
                    raise CancelledError("cancelled")
        return len(way), False


def _corrected(
    bone: CorrectedBone | None, places_bed: Floats, drawn_mm: Floats, wander_mm: Floats
) -> Floats:
    """Return the bone below places (n, 3) in draws (n, k), by what was measured; in their place."""
    if bone is not None:
        drawn_mm = bone.draws(places_bed, drawn_mm, overwrite=True)
    drawn_mm += wander_mm
    return drawn_mm


def _surely(drawn_mm: Floats, sigmas: float) -> Floats:
    """Return what is left (n,) in all but the worst draws (n, k)."""
    blocks = [drawn_mm[start : start + AT_ONCE] for start in range(0, len(drawn_mm), AT_ONCE)]
    return np.concatenate([some.mean(axis=1) - sigmas * some.std(axis=1) for some in blocks])
