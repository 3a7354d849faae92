"""Latency of the robot's joint angles, estimated from echoes while the probe moves along its axis.

Against bone that keeps still, the stand-off shrinks exactly as the face goes forward: the delay is
the shift in time at which stand-off and place agree. Between two joint angles that were read the
place is not known, where the robot accelerates: such A-scans count less. A robot settles a little
elsewhere now and then: where one step from an A-scan to the next stands out, a new piece with its
own offset begins. A head that gives way or breathes moves the bone: an even motion is taken out of
each movement, and what is left of a breath is in the standard deviation.
See docs/algorithms/navigation/pose_timing.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, as_floats
from rona_core.geometry.robust import mad_sigma

MAX_DELAY_S = 0.1  # either way
STEP_S = 0.004  # of the search, before it is refined
LEAST_SCANS = 12
ROUNDS = 3  # of looking for breaks
OUTLIER_MADS = 5.0  # a step between A-scans that is off by more deviations is a break
LEAST_DEVIATION_MM = 0.001
STRETCHES = 5  # of A-scans, in the order of time, that are left out in turn
LEAST_LEFT = 0.01  # of what is known of the delay: with less it cannot be estimated
TINY = 1e-300
WORST_SIGMA_S = 0.01  # less certain than this, the delay is not worth applying
BREATH_MM, BREATH_HZ = 0.012, 0.25  # of a head in its clamp: RMS along the axis, at rest


@dataclass(frozen=True, slots=True, eq=False)
class EchoSegment:
    """One movement along the probe's axis over bone that keeps still."""

    scan_times_s: Floats  # (n,) instants at which A-scans were fired
    standoff_mm: Floats  # (n,) distance to the bone that they show
    joint_times_s: Floats  # (m,) times at which joint angles arrived, growing
    place_mm: Floats  # (m,) place of the face along the probe's axis that they stand for


@dataclass(frozen=True, slots=True)
class PoseDelay:
    """How much later a pose is reported than it was taken."""

    delay_s: float
    sigma_s: float  # standard deviation
    scale: float  # change of stand-off over change of place: 1 if both are true
    rms_mm: float  # what the fit leaves over
    n_scans: int
    n_pieces: int  # segments, and parts of them between which the robot settled elsewhere

    def way_mm(self, speed_mm_per_s: float) -> float:
        """Return by how much a map would be shifted along the path without correction."""
        return abs(self.delay_s) * speed_mm_per_s

    def sigma_mm(self, speed_mm_per_s: float) -> float:
        """Return the standard deviation of that shift that the correction leaves."""
        return self.sigma_s * speed_mm_per_s


def estimate_pose_delay(segments: Sequence[EchoSegment]) -> PoseDelay:
    """Return the delay for which place(t + delay) and stand-off(t) of all segments agree best.

    The scale is common, because the speed of sound in the delay line may not be exactly known.

    Raises:
        InvalidInputError: arrays that do not fit together.
        DegenerateGeometryError: too few A-scans, or a motion too slow or too even to tell.
    """
    parts = [_Part(segment) for segment in segments]
    n = sum(len(part.times_s) for part in parts)
    if n < LEAST_SCANS:
        raise DegenerateGeometryError(f"{n} A-scans are too few for a delay: {LEAST_SCANS}")
    standoffs = np.concatenate([part.standoff_mm for part in parts])
    pieces = np.repeat(np.arange(len(parts)), [len(part.times_s) for part in parts])
    drifts = _even_motions(parts)
    sds = np.full(n, LEAST_DEVIATION_MM)
    fit = _best_fit(parts, standoffs, sds, pieces, drifts)
    for _ in range(ROUNDS):
        # a break stands out among the steps between A-scans that the fit leaves over
        steps = np.diff(standoffs - fit.fitted_mm)
        within = np.diff(pieces) == 0
        deviation = mad_sigma(steps[within], floor=LEAST_DEVIATION_MM)
        between = np.concatenate([part.unknown_mm(fit.delay_s) for part in parts])
        expected = np.hypot(deviation, np.hypot(between[1:], between[:-1]))
        breaks = within & (np.abs(steps) > OUTLIER_MADS * expected)
        pieces = np.concatenate(([0], np.cumsum(breaks | ~within)))
        sds = np.hypot(deviation / np.sqrt(2.0), between)  # a step is a difference
        fit = _best_fit(parts, standoffs, sds, pieces, drifts)
    n_pieces = int(pieces[-1]) + 1
    freedom = n - n_pieces - drifts.shape[1] - 2
    times, off = np.concatenate([part.times_s for part in parts]), standoffs - fit.fitted_mm
    moved = _left_out(parts, off / sds, sds, pieces, drifts, fit)
    own_s = _sigma_s(fit.sensitivity, off / sds, freedom, moved)
    sigma_s = float(np.hypot(own_s, _breath_s(fit, sds, times)))
    if sigma_s > WORST_SIGMA_S or abs(fit.delay_s) > MAX_DELAY_S - STEP_S:
        raise DegenerateGeometryError(
            f"the motion gives the delay of the poses only to {1e3 * sigma_s:.2g} ms: move faster, "
            "and not evenly"
        )
    rms_mm = float(np.sqrt((off**2).mean()))
    return PoseDelay(fit.delay_s, sigma_s, fit.scale, rms_mm, n, n_pieces)


class _Part:
    """A segment as a curve that can be looked up at any time."""

    def __init__(self, segment: EchoSegment) -> None:
        self.times_s = as_floats(segment.scan_times_s, name="scan_times_s")
        self.standoff_mm = as_floats(segment.standoff_mm, name="standoff_mm")
        times = as_floats(segment.joint_times_s, name="joint_times_s")
        places = as_floats(segment.place_mm, name="place_mm")
        if self.times_s.shape != self.standoff_mm.shape or times.shape != places.shape:
            raise InvalidInputError("a segment needs one stand-off per A-scan, one place per pose")
        if len(times) < 4 or (np.diff(times) <= 0.0).any():
            raise InvalidInputError("a segment needs poses at 4 times or more, which must grow")
        self._curve, self._places_mm, self._times_s = CubicSpline(times, places), places, times

    def at(self, delay_s: float, order: int = 0) -> Floats:
        """Return places, or speeds with order 1, at the A-scans for some delay."""
        return np.asarray(self._curve(self._wanted_s(delay_s), order), dtype=np.float64)

    def unknown_mm(self, delay_s: float) -> Floats:
        """Return how far the place may be off because it lies between two that were read.

        A robot whose controller drives straight between its way points, and one that drives a
        smooth curve, are as far apart there: the more, the more it accelerates.
        """
        straight = np.interp(self._wanted_s(delay_s), self._times_s, self._places_mm)
        return np.abs(self.at(delay_s) - straight)

    def _wanted_s(self, delay_s: float) -> Floats:
        return np.clip(self.times_s + delay_s, self._times_s[0], self._times_s[-1])


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    delay_s: float
    scale: float
    fitted_mm: Floats  # (n,) stand-offs by the fit
    sensitivity: Floats  # (n,) of them to the delay over their sigma, without what is explained


def _best_fit(
    parts: Sequence[_Part], standoffs: Floats, sds: Floats, pieces: Ints, drifts: Floats
) -> _Fit:
    explained = np.linalg.qr(np.hstack((_offsets(pieces), drifts)) / sds[:, None])[0]

    def rest(values: Floats) -> Floats:
        return np.asarray(values - explained @ (explained.T @ values))

    wanted = rest(standoffs / sds)

    def places(delay_s: float, order: int = 0) -> Floats:
        return rest(np.concatenate([part.at(delay_s, order) for part in parts]) / sds)

    def cost(delay_s: float) -> float:
        residuals = wanted - _along(places(float(delay_s)), wanted)
        return float(residuals @ residuals)

    delays = np.arange(-MAX_DELAY_S, MAX_DELAY_S + STEP_S / 2.0, STEP_S)
    best = float(delays[int(np.argmin([cost(float(d)) for d in delays]))])
    found: Any = minimize_scalar(
        cost, bounds=(best - STEP_S, best + STEP_S), method="bounded", options={"xatol": 1e-7}
    )
    delay_s = float(found.x)
    moved = places(delay_s)
    fitted = _along(moved, wanted)
    power = float(moved @ moved)
    scale = float(moved @ wanted) / power if power > 0.0 else 0.0
    slope = scale * places(delay_s, 1)
    off = sds * (wanted - fitted)
    return _Fit(delay_s, -scale, standoffs - off, slope - _along(moved, slope))


def _offsets(pieces: Ints) -> Floats:
    """Return a column (n,) for each piece: where the robot settled in it."""
    return np.asarray(pieces[:, None] == np.arange(pieces[-1] + 1), dtype=np.float64)


def _even_motions(parts: Sequence[_Part]) -> Floats:
    """Return what bone that moves evenly adds to the stand-offs: a column (n,) for each part."""
    columns = [part.times_s - part.times_s.mean() for part in parts]
    return np.asarray(block_diag(*(column[:, None] for column in columns)), dtype=np.float64)


def _along(direction: Floats, values: Floats) -> Floats:
    """Return the part of ``values`` (n,) that is a multiple of ``direction`` (n,)."""
    power = float(direction @ direction)
    return direction * (float(direction @ values) / power if power > 0.0 else 0.0)


def _sigma_s(sensitivity: Floats, residuals: Floats, freedom: int, moved: float) -> float:
    """Return the deviation of the delay; no less than noise, misfit or what was left out make it.

    Sensitivity and residuals are over the sigmas of the stand-offs.
    """
    information = float(sensitivity @ sensitivity)
    if information <= 0.0 or freedom < 1:
        return float("inf")
    return float(np.sqrt(max(float(residuals @ residuals) / freedom, moved, 1.0) / information))


def _left_out(
    parts: Sequence[_Part],
    residuals: Floats,
    sds: Floats,
    pieces: Ints,
    drifts: Floats,
    fit: _Fit,
) -> float:
    """Return how far the delay moves when stretches are left out: a mean square, 1 for noise alone.

    Each move counts over the standard deviation from the information of the stretch on the
    delay if every A-scan errs by itself and by its sigma (after Künsch 1989). A robot that wanders
    by micrometres over many A-scans makes it more. Near the fit the stand-offs are taken as linear
    in the delay.
    """
    place, speed = (
        np.concatenate([part.at(fit.delay_s, order) for part in parts]) for order in (0, 1)
    )
    design = np.column_stack((_offsets(pieces), drifts, place, speed))
    equations = np.column_stack((design / sds[:, None], residuals))
    rows = np.arange(len(residuals))
    known = _delay_of(equations)[1]
    squares: list[float] = []
    for left_out in np.array_split(rows, STRETCHES):
        shift, still = _delay_of(np.delete(equations, left_out, axis=0))
        if LEAST_LEFT * known < still < known:
            squares.append(shift**2 / (1.0 / still - 1.0 / known))
    return float(np.mean(squares)) if squares else 0.0


def _delay_of(equations: Floats) -> tuple[float, float]:
    """Return the last unknown of equations (n, k + 1), least squares, and how well it is known."""
    factor: Floats = np.asarray(np.linalg.qr(equations, mode="r"), dtype=np.float64)
    steep = float(factor[-2, -2])
    return float(factor[-2, -1]) / (steep or TINY), steep**2


def _breath_s(fit: _Fit, sds: Floats, times_s: Floats) -> float:
    """Return the deviation of the delay that a breath of unknown phase makes."""
    information = float(fit.sensitivity @ fit.sensitivity)
    if information <= 0.0:
        return float("inf")
    wave = np.exp(2.0j * np.pi * BREATH_HZ * times_s) / sds
    return float(BREATH_MM * np.abs(fit.sensitivity @ wave) / information)


def segment_places(points_base: ArrayLike, axes_base: ArrayLike, near: int) -> Floats:
    """Return places (m,) of faces (m, 3) along the axis of one of them."""
    points, axes = np.asarray(points_base), np.asarray(axes_base)
    return np.asarray((points - points[near]) @ axes[near], dtype=np.float64)
