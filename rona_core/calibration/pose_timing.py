"""How late the robot's joint angles arrive, seen by the echoes while the probe moves up or down.

Against bone that keeps still, the stand-off shrinks exactly as the face goes forward: the delay is
the shift in time at which stand-off and place agree. What is compared are the steps from one A-scan
to the next: a robot that settles a little elsewhere now and then spoils one step, not the rest.
See docs/algorithms/pose_timing.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from rona_core.arrays import Bools, Floats, as_floats
from rona_core.errors import DegenerateGeometryError, InvalidInputError

MAX_DELAY_S = 0.1  # either way
STEP_S = 0.004  # of the search, before it is refined
LEAST_STEPS = 12
ROUNDS = 4  # of leaving out outliers
OUTLIER_MADS = 4.0  # steps further off than this many deviations are left out
LEAST_DEVIATION_MM = 0.002
WORST_SIGMA_S = 0.01  # less certain than this, the delay is not worth applying


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
    rms_mm: float  # what the fit leaves over of the steps
    n_steps: int  # between A-scans that were used

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
    n = sum(len(part.times_s) - 1 for part in parts)
    if n < LEAST_STEPS:
        raise DegenerateGeometryError(f"{n} steps are too few for a delay: {LEAST_STEPS}")
    seen = np.concatenate([np.diff(part.standoff_mm) for part in parts])
    used = np.ones(n, dtype=np.bool_)
    for _ in range(ROUNDS):
        delay_s = _best_delay(parts, seen, used)
        left = seen - _predicted(parts, seen, used, delay_s)[0]
        deviation = max(1.4826 * float(np.median(np.abs(left[used]))), LEAST_DEVIATION_MM)
        kept = np.abs(left) < OUTLIER_MADS * deviation
        if (kept == used).all() or np.count_nonzero(kept) < LEAST_STEPS:
            break
        used = kept
    delay_s = _best_delay(parts, seen, used)
    fitted, scale, told = _predicted(parts, seen, used, delay_s)
    left = (seen - fitted)[used]
    count = int(np.count_nonzero(used))
    information = float((told[used] ** 2).sum())
    variance = float((left**2).sum()) / max(count - 2, 1)
    sigma_s = float(np.sqrt(variance / information)) if information > 0.0 else float("inf")
    if sigma_s > WORST_SIGMA_S or abs(delay_s) > MAX_DELAY_S - STEP_S:
        raise DegenerateGeometryError(
            f"the motion tells the delay of the poses only to {1e3 * sigma_s:.2g} ms: move faster, "
            "and not evenly"
        )
    return PoseDelay(delay_s, sigma_s, scale, float(np.sqrt((left**2).mean())), count)


class _Part:
    """A segment as a curve that can be looked up at any time."""

    def __init__(self, segment: EchoSegment) -> None:
        self.times_s = as_floats(segment.scan_times_s, name="scan_times_s")
        self.standoff_mm = as_floats(segment.standoff_mm, name="standoff_mm")
        times = as_floats(segment.joint_times_s, name="joint_times_s")
        places = as_floats(segment.place_mm, name="place_mm")
        if self.times_s.shape != self.standoff_mm.shape or times.shape != places.shape:
            raise InvalidInputError("a segment needs one stand-off per A-scan, one place per pose")
        if len(self.times_s) < 2 or len(times) < 4 or (np.diff(times) <= 0.0).any():
            raise InvalidInputError("a segment needs 2 A-scans and 4 poses at times that grow")
        self._curve = CubicSpline(times, places)
        self._range = times[0], times[-1]

    def steps(self, delay_s: float, order: int = 0) -> Floats:
        """Return steps of the place, or of the speed with order 1, between the A-scans."""
        times = np.clip(self.times_s + delay_s, *self._range)
        return np.diff(np.asarray(self._curve(times, order), dtype=np.float64))


def _steps(parts: Sequence[_Part], delay_s: float, order: int = 0) -> Floats:
    return np.concatenate([part.steps(delay_s, order) for part in parts])


def _predicted(
    parts: Sequence[_Part], seen: Floats, used: Bools, delay_s: float
) -> tuple[Floats, float, Floats]:
    """Return steps by the fit (n,), its scale, and what a delay alone would change (n,)."""
    moved = _steps(parts, delay_s)
    power = float(moved[used] @ moved[used])
    scale = float(moved[used] @ seen[used]) / power if power > 0.0 else 0.0
    slope = scale * _steps(parts, delay_s, 1)
    imitated = float(moved[used] @ slope[used]) / power if power > 0.0 else 0.0
    return scale * moved, -scale, slope - imitated * moved  # what no other scale could imitate


def _best_delay(parts: Sequence[_Part], seen: Floats, used: Bools) -> float:
    def cost(delay_s: float) -> float:
        left = (seen - _predicted(parts, seen, used, float(delay_s))[0])[used]
        return float(left @ left)

    delays = np.arange(-MAX_DELAY_S, MAX_DELAY_S + STEP_S / 2.0, STEP_S)
    best = float(delays[int(np.argmin([cost(float(d)) for d in delays]))])
    found: Any = minimize_scalar(
        cost, bounds=(best - STEP_S, best + STEP_S), method="bounded", options={"xatol": 1e-7}
    )
    return float(found.x)


def segment_places(points_base: ArrayLike, axes_base: ArrayLike, near: int) -> Floats:
    """Return places (m,) of faces (m, 3) along the axis of one of them."""
    points, axes = np.asarray(points_base), np.asarray(axes_base)
    return np.asarray((points - points[near]) @ axes[near], dtype=np.float64)
