"""The floor of a rehearsed bed: as commanded, scanned again, what is left, how deep to go on.

Bone left below a milled floor: draws of the maps, corrected by what the probe measured there. The
draws say how errors of the maps hang together from place to place, so what was measured at some
places moves all of them (an ensemble Kalman filter with perturbed observations, Evensen 1994).
"""

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from scipy.spatial.distance import cdist

from rona_core.devices.samples import AScanTrack
from rona_core.devices.settings import Excitation
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Pose
from rona_core.planning.milling.milling_path import MillingPath
from rona_core.planning.placement.figures import spreads_above
from rona_core.robot.collision.collision_geometry import LINE_PROFILE
from rona_core.ultrasound.acoustic_calibration.reference_points import at_speed
from rona_core.ultrasound.acoustic_calibration.speed_calibration import (
    SpeedCalibration,
    speed_at,
    uncalibrated,
)
from rona_core.ultrasound.detection.detect import NOMINAL_SPEED_MM_PER_US, detect
from rona_core.ultrasound.probe.probe_model import ProbeModel, ProbeSurvey

CELL_MM = 0.25
AROUND_MM = 0.5


class CommandedFloor:
    """Heights over a grid in ``bed``.

    Attributes:
        places_mm: Cell centres (n,), along x and along y.
        top_mm: What should be left reaches up to here (n, n).
    """

    def __init__(self, half_mm: float) -> None:
        """Lay a grid so far to all sides of the bed's middle."""
        count = int(np.ceil((half_mm + AROUND_MM) / CELL_MM))
        self.places_mm = CELL_MM * np.arange(-count, count + 1.0)
        self.top_mm = np.zeros((len(self.places_mm), len(self.places_mm)))

    def cells(self) -> Floats:
        """Return x and y (m, 2) of every cell, rows of ``top_mm`` one after the other."""
        x, y = np.meshgrid(self.places_mm, self.places_mm, indexing="ij")
        return np.column_stack((x.ravel(), y.ravel()))

    def cut(self, bottom_bed: Floats, radius_mm: float) -> float:
        """Take away what a ball with its lowest place there reaches; return how much, in mm3."""
        i, j = (
            slice(*np.searchsorted(self.places_mm, (middle - radius_mm, middle + radius_mm)))
            for middle in bottom_bed[:2].tolist()
        )
        away2 = ((self.places_mm[i] - bottom_bed[0]) ** 2)[:, None]
        away2 = away2 + (self.places_mm[j] - bottom_bed[1]) ** 2
        lowest = bottom_bed[2] + radius_mm - np.sqrt(np.maximum(radius_mm**2 - away2, 0.0))
        old = self.top_mm[i, j]
        new = np.where(away2 <= radius_mm**2, np.minimum(old, lowest), old)
        taken_mm3 = CELL_MM**2 * float((old - new).sum())
        self.top_mm[i, j] = new
        return taken_mm3

    def flat_places(self, radius_mm: float, step_mm: float, rough_mm: float) -> Floats:
        """Return places (m, 3) on a grid round which the floor is flat for so far.

        Args:
            radius_mm: Of the disc that has to be flat.
            step_mm: Between places.
            rough_mm: From the lowest to the highest place of the disc, at most.
        """
        reach = np.arange(-radius_mm, radius_mm + 1e-9, CELL_MM)
        disc: Bools = np.hypot(reach[:, None], reach) <= radius_mm
        shifts = np.column_stack(np.nonzero(disc)) - len(reach) // 2
        every, margin = max(1, round(step_mm / CELL_MM)), len(reach) // 2
        middle = len(self.places_mm) // 2
        lines = np.arange(middle % every, len(self.places_mm), every)
        lines = lines[(lines >= margin) & (lines < len(self.places_mm) - margin)]
        found: list[tuple[float, float, float]] = []
        for i in lines.tolist():
            for j in lines.tolist():
                heights = self.top_mm[i + shifts[:, 0], j + shifts[:, 1]]
                if heights.max() - heights.min() <= rough_mm:
                    x, y = float(self.places_mm[i]), float(self.places_mm[j])
                    found.append((x, y, float(heights.mean())))
        return np.array(found, dtype=np.float64).reshape(-1, 3)


STEP_MM = 1.5  # between places
ROUGH_MM = 0.2  # of a floor that a face is pressed on: ridges are less
EDGE_MM = 0.4  # from the probe to the wall
OVER_MM = 2.0  # above the highest bone, where the probe comes from and goes to


@dataclass(frozen=True, slots=True, eq=False)
class FloorLine:
    """Places in ``bed`` that the face of a probe goes through, straight from one to the next."""

    points_bed: Floats  # (n, 3), first and last of them above the bone
    stops: Ints  # (m,) points at which it is pressed on the floor, m at least 1

    @property
    def places_bed(self) -> Floats:
        """Return the places (m, 3) of the floor."""
        return self.points_bed[self.stops]


def floor_line(floor: CommandedFloor, face_radius_mm: float, below_mm: float) -> FloorLine | None:
    """Return a line over all places of a floor where a probe can be pressed on; None: no place.

    The face stands wholly on the floor there, and the delay line, which widens upwards, is clear
    of the wall. Rows are scanned to and fro. Where the wall is between two places, the probe goes
    up over the bone; there it begins and ends too.

    Args:
        floor: What was milled so far.
        face_radius_mm: Of the probe.
        below_mm: Places of the floor lie below this height.
    """
    places = floor.flat_places(face_radius_mm + EDGE_MM, STEP_MM, ROUGH_MM)
    places = places[places[:, 2] < below_mm]
    line = _Line.of(face_radius_mm)
    free = [line.clear(floor, place[None]) for place in places]
    places = places[np.array(free, dtype=np.bool_)]
    if not len(places):
        return None
    rows = np.unique(places[:, 0], return_inverse=True)[1]
    places = places[np.lexsort((places[:, 1] * np.where(rows % 2, -1.0, 1.0), rows))]
    high = floor.top_mm.max() + OVER_MM
    above = np.column_stack((places[:, :2], np.full(len(places), high)))
    points, stops = [above[0]], []
    for row, place in enumerate(places):
        if row and not line.clear(floor, _leg(places[row - 1], place)):
            points += [above[row - 1], above[row]]
        stops.append(len(points))
        points.append(place)
    return FloorLine(np.array([*points, above[-1]]), np.array(stops))


@dataclass(frozen=True, slots=True, eq=False)
class _Line:
    """The delay line as what collides of it is bounded, with the way that it keeps from a wall."""

    radii_mm: Floats  # (k,) rising
    heights_mm: Floats  # (k,) of its side over its face, at these radii

    @classmethod
    def of(cls, face_radius_mm: float) -> "_Line":
        """Return the line of a probe; with a wider face all of it is wider."""
        radii, heights = np.array(LINE_PROFILE)[::-1].T
        return cls(radii + max(face_radius_mm - radii[0], 0.0) + EDGE_MM, -heights)

    def clear(self, floor: CommandedFloor, places_bed: Floats) -> bool:
        """Return whether it meets nothing but ridges with its face at places (k, 3)."""
        cells, tops = floor.cells(), floor.top_mm.ravel()
        for place in places_bed:
            away = np.linalg.norm(cells - place[:2], axis=1)
            side = np.interp(away, self.radii_mm, self.heights_mm, right=np.inf)
            if (tops > place[2] + ROUGH_MM + side).any():
                return False
        return True


def _leg(start: Floats, end: Floats) -> Floats:
    """Return places (k, 3) of the straight way over a floor, at the height of its higher end."""
    count = int(np.ceil(np.linalg.norm(end - start) / CELL_MM)) + 1
    return np.column_stack(
        (np.linspace(start[:2], end[:2], count), np.full(count, max(start[2], end[2])))
    )


TAPER_MM = 15.0  # beyond which chance alone may tie draws together
LEAST_SIGMA_MM = 0.10  # of one A-scan: the face looks at a disc, and not at a place
AT_ONCE = 512  # places that are worked on together: thousands with all draws take much memory
OUTLIER = 3.5  # sigmas off the median difference


@dataclass(frozen=True, slots=True, eq=False)
class MeasuredFloor:
    """Residual bone measured from a floor: m places in ``bed``."""

    scans: Ints  # (m,) which of the A-scans
    places_bed: Floats  # (m, 3)
    residual_mm: Floats  # (m,) by the probe, along its axis as all of these are
    sigma_mm: Floats  # (m,) of each by itself
    common_share: float  # relative sigma that all share: that of the speed of sound
    mapped_mm: Floats  # (m,) by the maps
    drawn_mm: Floats  # (m, k) in draws of the maps

    def part(self, which: Bools) -> "MeasuredFloor":
        """Return some of the places (m,)."""
        return MeasuredFloor(
            self.scans[which],
            self.places_bed[which],
            self.residual_mm[which],
            self.sigma_mm[which],
            self.common_share,
            self.mapped_mm[which],
            self.drawn_mm[which],
        )

    def without_outliers(self) -> "MeasuredFloor":
        """Return it without places that are far off what the others say of the maps."""
        off = self.residual_mm - self.mapped_mm
        sigma = np.hypot(self.drawn_mm.std(axis=1), self.sigma_mm)
        return self.part(np.abs(off - np.median(off)) <= OUTLIER * sigma)


class CorrectedBone:
    """Draws of the bone below a bed, moved by what was measured."""

    def __init__(self, measured: MeasuredFloor, random: Generator) -> None:
        """Take in what was measured, at least at one place; its noise in the draws is random."""
        self._places = measured.places_bed
        self._off = measured.drawn_mm - measured.drawn_mm.mean(axis=1, keepdims=True)
        count, draws = self._off.shape
        own = np.hypot(measured.sigma_mm, LEAST_SIGMA_MM)
        common = measured.common_share * measured.residual_mm
        noise = own[:, None] * random.standard_normal((count, draws))
        noise += common[:, None] * random.standard_normal(draws)
        cov = self._tied(self._places, self._off) + np.diag(own**2) + np.outer(common, common)
        innovations = measured.residual_mm[:, None] + noise - measured.drawn_mm
        self._moves = np.linalg.solve(cov, innovations)

    def draws(self, places_bed: Floats, drawn_mm: Floats, *, overwrite: bool = False) -> Floats:
        """Return residuals (n, k) below places (n, 3) in draws, given those of the maps (n, k).

        With ``overwrite`` they take the place of those of the maps.
        """
        found = drawn_mm if overwrite else drawn_mm.copy()
        for start in range(0, len(found), AT_ONCE):
            rows = slice(start, start + AT_ONCE)
            off = found[rows] - found[rows].mean(axis=1, keepdims=True)
            found[rows] += self._tied(places_bed[rows], off) @ self._moves
        return found

    def _tied(self, places_bed: Floats, off_mm: Floats) -> Floats:
        """Return the covariance (n, m) of places with those that were measured."""
        away2 = cdist(places_bed[:, :2], self._places[:, :2], "sqeuclidean")
        away2 *= -0.5 / TAPER_MM**2  # in place: there are many places
        tied = np.exp(away2, out=away2)
        tied *= off_mm @ self._off.T
        tied /= off_mm.shape[1] - 1
        return tied


# relative sigma of the speed in what is left against that in the whole bone: of what is left none
# to all is diploe (two sigmas to either side), which is 15 to 20 % slower than the tables
MIXED_SHARE = 0.25 * 0.175


@dataclass(frozen=True, slots=True, eq=False)
class FloorDetector:
    """Measures the bone below a bed; a ``MeasureFloor``."""

    T_base_bed: Pose
    probe: ProbeModel
    excitation: Excitation
    bone_loss: float | None  # over the nominal one, as the scan of the bone found it
    speed: SpeedCalibration | None  # None: the published one

    def __call__(
        self, track: AScanTrack, places_bed: Floats
    ) -> tuple[Floats, Floats, Bools, float]:
        """Return thickness, sigma and whether it is sure (m,), and the speed's relative sigma."""
        places = self.T_base_bed @ places_bed
        axis = -self.T_base_bed.rotation[:, 2]
        found = detect(
            ProbeSurvey(
                track,
                self.probe,
                self.excitation,
                positions_mm=places,
                axes=np.tile(axis, (len(places), 1)),
            ),
            sound_speed_mm_per_us=NOMINAL_SPEED_MM_PER_US,
            bone_loss=self.bone_loss,
        )
        known = uncalibrated() if self.speed is None else self.speed
        speeds, sigmas = speed_at(known, places)
        found = at_speed(found, speeds)
        share = float(np.hypot(MIXED_SHARE, (sigmas / speeds).mean()))
        return found.thickness_mm, found.thickness_sigma_mm, found.inner_ok, share


def ceiling_mm(bottoms_bed: Floats, drawn_mm: Floats, limit_mm: float, spreads: float) -> float:
    """Return the height below which no place of a way may lie; -inf where all may stay.

    Args:
        bottoms_bed: Lowest places of the burr (n, 3).
        drawn_mm: Bone below them in draws (n, k).
        limit_mm: That has to be left below all of them.
        spreads: By how many the median has to be above that, see `spreads_for`.
    """
    if not len(bottoms_bed) or float(spreads_above(drawn_mm.min(axis=0), limit_mm)) >= spreads:
        return -np.inf
    # a draw keeps the limit once every place is so high; heights of the way itself count alike
    wanted = np.full(drawn_mm.shape[1], -np.inf)
    for height, drawn in zip(bottoms_bed[:, 2] + limit_mm, drawn_mm, strict=True):
        np.maximum(wanted, height - drawn, out=wanted)
    median = float(np.median(wanted))
    above = wanted[wanted > median] - median
    return median + spreads * float(np.sqrt((above**2).mean())) if len(above) else median


def raised_path(
    path: MillingPath, pause: int, ceiling: float, surface_mm: float
) -> tuple[MillingPath, Ints] | None:
    """Return what is left to be milled after a layer, nothing of it below a height.

    Layers above that height stay, one ends on it, those that would cut nothing are left out.

    Args:
        path: As planned, of n places.
        pause: Last layer that is milled; -1: none.
        ceiling: The height in ``bed``.
        surface_mm: Height in ``bed`` that no bone within the outline rises above.

    Returns:
        The path, and which planned places (m,) it comes from; None where nothing is left.
    """
    heights, later = path.bottoms_bed()[:, 2], path.layers > pause
    lifts = np.where(later, np.maximum(ceiling - heights, 0.0), 0.0)
    kept = later.copy()
    lowest: dict[int, float] = {}  # of each burr so far
    for layer in np.unique(path.layers):
        own = path.layers == layer
        burr, depth = int(path.tools[own][0]), float((heights + lifts)[own].min())
        before = lowest.get(burr, surface_mm)
        kept &= ~own | (depth < before - 1e-6)
        lowest[burr] = min(depth, before)
    rows = np.flatnonzero(kept)
    if not len(rows):
        return None
    tips = path.tips_bed + lifts[:, None] * (0.0, 0.0, 1.0)
    moves, layers, tools = (part[rows] for part in (path.moves, path.layers, path.tools))
    return MillingPath(tips[rows], path.axes_bed[rows], moves, layers, tools, path.burrs), rows
