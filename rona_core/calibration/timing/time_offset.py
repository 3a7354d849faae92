"""Time offset between two devices that measured the same motion, e.g. tracker and robot.

Both streams are smoothed alike. For each candidate delay the positions of one are predicted from
those of the other by the best linear map, which stands for the unknown frames; the delay at which
least is left over is refined between samples. A motion that can be mapped onto its own shifted
copy (rest, a circle at constant speed) does not determine the delay, and is refused.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, as_floats, as_points

MAX_OFFSET_S = 0.3  # delays up to this are searched, either way
SMOOTHING_S = 0.03  # width of the common low-pass; at least one sample of the slower stream
LEAST_MOTION_MM = 2.0  # RMS about the mean, below which a stream is at rest
LEAST_CORRELATION = 0.9  # of two streams that show the same motion
LEAST_OVERLAP_S = 1.0
SAME_SHARE = 1e-4  # of the motion: two delays that leave this much alike are equally good
SIGNIFICANT_SIGMAS = 3.0  # a smaller delay is not significant
WORST_SIGMA = 0.1  # share of the searched range; a wider result says nothing


@dataclass(frozen=True, slots=True)
class TimeOffset:
    """How much later a motion appears in stream b than in stream a."""

    offset_s: float
    sigma_s: float  # standard deviation, from the sensitivity and the residuals
    correlation: float  # 0 to 1, between b and what a predicts for it
    overlap_s: float  # duration that was compared


def tracker_delay_s(stated_s: float, behind_robot: TimeOffset | None) -> float:
    """Return by how much later than it was measured a frame of the tracker arrives, as known.

    The registration estimates by how much the tracker is later than the robot, whose joint angles
    are late themselves: a lower bound. What the maker states counts where it is more.

    Args:
        stated_s: Delay that the maker states.
        behind_robot: As the registration found it; None: it did not.
    """
    if behind_robot is None or behind_robot.offset_s <= SIGNIFICANT_SIGMAS * behind_robot.sigma_s:
        return stated_s
    return max(stated_s, behind_robot.offset_s)


def estimate_time_offset(
    times_a_s: ArrayLike,
    positions_a: ArrayLike,
    times_b_s: ArrayLike,
    positions_b: ArrayLike,
) -> TimeOffset:
    """Return the delay d for which ``positions_b`` at t belong to ``positions_a`` at t - d.

    Args:
        times_a_s: Growing times (n,) in seconds.
        positions_a: Positions (n, 3) in mm, in any frame fixed to the room.
        times_b_s: Growing times (m,) of the other device, on its own clock.
        positions_b: Positions (m, 3) in mm of a point on the same body, in any other frame.

    Raises:
        InvalidInputError: wrong shapes, times that do not grow, or less than a second in common.
        DegenerateGeometryError: no motion, another motion, one that repeats itself or is too even
            to tell the delay, or a delay beyond the range.
    """
    a, b = _stream(times_a_s, positions_a, "a"), _stream(times_b_s, positions_b, "b")
    step_s = max(np.median(np.diff(a[0])), np.median(np.diff(b[0])))
    width_s = max(SMOOTHING_S, float(step_s))
    margin_s = MAX_OFFSET_S + 3.0 * width_s
    start_s = max(a[0][0] + margin_s, b[0][0] + 3.0 * width_s)
    end_s = min(a[0][-1] - margin_s, b[0][-1] - 3.0 * width_s)
    if end_s - start_s < LEAST_OVERLAP_S:
        raise InvalidInputError(
            f"the two recordings have {max(end_s - start_s, 0.0):.2g} s in common beside the "
            f"margin of {margin_s:.2g} s, {LEAST_OVERLAP_S:g} s are needed"
        )
    times = np.arange(start_s, end_s, float(step_s))
    curve_a, curve_b = _smooth(*a, width_s), _smooth(*b, width_s)
    wanted = curve_b(times) - curve_b(times).mean(axis=0)
    _require_motion("a", curve_a(times))
    _require_motion("b", wanted)

    def left_over(offset_s: float) -> float:
        return float((_residual(curve_a(times - offset_s), wanted) ** 2).sum())

    total = float((wanted**2).sum())
    minima = _local_minima(left_over, float(step_s), total)
    cost, offset_s = minima[0]
    correlation = float(np.sqrt(max(0.0, 1.0 - cost / total)))
    sigma_s = _sigma(curve_a, times - offset_s, wanted, int(np.ceil(6.0 * width_s / step_s)))
    if sigma_s > WORST_SIGMA * MAX_OFFSET_S:
        raise DegenerateGeometryError(
            f"the motion is too even: it gives the delay only to {1e3 * sigma_s:.3g} ms; "
            "start, stop and turn more often"
        )
    if len(minima) > 1 and minima[1][0] < 1.5 * cost + SAME_SHARE * total:
        raise DegenerateGeometryError(
            f"the motion repeats itself after {abs(minima[1][1] - offset_s):.3g} s: the delay is "
            "ambiguous; move irregularly, or search a narrower range"
        )
    return TimeOffset(offset_s, sigma_s, correlation, float(end_s - start_s))


def _local_minima(
    cost: Callable[[float], float], step_s: float, total: float
) -> list[tuple[float, float]]:
    """Return costs and offsets of the local minima, the lowest first."""
    count = int(np.ceil(MAX_OFFSET_S / (0.5 * step_s)))
    offsets = np.linspace(-MAX_OFFSET_S, MAX_OFFSET_S, 2 * count + 1)
    costs = np.array([cost(float(offset)) for offset in offsets])
    places = _valleys(offsets, costs, total)
    return sorted(_deepest(cost, offsets[k - 1], offsets[k + 1]) for k in places)


def _require_motion(name: str, positions: Floats) -> None:
    """Refuse a stream (n, 3) that rests."""
    motion_mm = float(np.sqrt(((positions - positions.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if motion_mm < LEAST_MOTION_MM:
        raise DegenerateGeometryError(
            f"stream {name} moves by {motion_mm:.2g} mm RMS: without motion there is no delay "
            f"to be seen, {LEAST_MOTION_MM:g} mm are needed"
        )


def _stream(times_s: ArrayLike, positions: ArrayLike, name: str) -> tuple[Floats, Floats]:
    times = as_floats(times_s, name=f"times_{name}_s")
    points = as_points(positions, at_least=8, name=f"positions_{name}")
    if times.shape != (len(points),):
        raise InvalidInputError(f"stream {name}: {len(points)} positions need as many times")
    if (np.diff(times) <= 0.0).any():
        raise InvalidInputError(f"times_{name}_s must grow")
    return times, points


def _smooth(times_s: Floats, positions: Floats, width_s: float) -> CubicSpline:
    """Return a stream as a smooth curve, filtered on a regular grid of its own rate."""
    step_s = float(np.median(np.diff(times_s)))
    count = int(np.floor((times_s[-1] - times_s[0]) / step_s + 1e-6)) + 1
    grid = times_s[0] + step_s * np.arange(count)
    regular = np.stack([np.interp(grid, times_s, column) for column in positions.T], axis=1)
    return CubicSpline(grid, gaussian_filter1d(regular, width_s / step_s, axis=0, mode="nearest"))


def _residual(predictors: Floats, wanted: Floats) -> Floats:
    """Return what the best linear map of some columns (n, k) leaves of others (n, 3)."""
    centred = predictors - predictors.mean(axis=0)
    map_: Floats = np.linalg.lstsq(centred, wanted, rcond=1e-6)[0]
    return wanted - centred @ map_


def _deepest(cost: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """Return the least cost between two delays, and where it is."""
    found: Any = minimize_scalar(
        cost, bounds=(low, high), method="bounded", options={"xatol": 1e-7}
    )
    return float(found.fun), float(found.x)


def _valleys(offsets: Floats, costs: Floats, total: float) -> list[int]:
    """Return where the cost has a minimum that explains the motion, refused if there is none."""
    best = int(np.argmin(costs))
    enough = (1.0 - LEAST_CORRELATION**2) * total
    if costs[best] > enough:
        raise DegenerateGeometryError(
            f"the streams do not show the same motion: correlation "
            f"{np.sqrt(max(0.0, 1.0 - costs[best] / total)):.2f}, {LEAST_CORRELATION:g} is needed"
        )
    if best in (0, len(offsets) - 1):
        raise DegenerateGeometryError(
            f"no delay within {1e3 * offsets[-1]:.0f} ms stands out: the true one is beyond, or "
            "the motion is too even to tell it"
        )
    inner = costs[1:-1]
    low = (inner <= costs[:-2]) & (inner <= costs[2:]) & (inner <= enough)
    return [int(k) + 1 for k in np.flatnonzero(low)]


def _sigma(curve_a: CubicSpline, times: Floats, wanted: Floats, lags: int) -> float:
    """Return the standard deviation of the delay, with residuals that are correlated in time."""
    predictors = np.asarray(curve_a(times))
    predictors = predictors - predictors.mean(axis=0)
    map_: Floats = np.linalg.lstsq(predictors, wanted, rcond=1e-6)[0]
    slope = np.asarray(curve_a(times, 1)) @ map_
    sensitivity = _residual(
        predictors, slope - slope.mean(axis=0)
    )  # what no other map could imitate
    information = float((sensitivity**2).sum())
    if information <= 0.0:
        return float("inf")
    score = (sensitivity * (wanted - predictors @ map_)).sum(axis=1)
    variance = float(score @ score)
    for lag in range(1, min(lags, len(score) - 1) + 1):
        variance += 2.0 * (1.0 - lag / (lags + 1.0)) * float(score[lag:] @ score[:-lag])
    return float(np.sqrt(max(variance, 0.0)) / information)
