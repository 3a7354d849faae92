"""Motions of the joints that come from elsewhere, and what lies between their samples.

A controller decides what it drives between two samples; ROS joins positions linearly, with
velocities by a cubic, with accelerations as well by a quintic (``joint_trajectory_controller``).
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from rona_core.devices.limits import require
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.robot.trajectory.trajectory import SAMPLE_S

Interpolation = Literal["linear", "cubic", "quintic"]
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
FINE_S = SAMPLE_S / 2.0  # between places that are looked at on a curve
MOST_PLACES = 200_000  # that are looked at, by default


@dataclass(frozen=True, slots=True, eq=False)
class JointMotion:
    """Joint angles at n samples as a file states them, with what it states of their change."""

    times_s: Floats  # (n,) from 0
    qs_rad: Floats  # (n, 6)
    speeds_rad_per_s: Floats | None = None  # (n, 6)
    accelerations_rad_per_s2: Floats | None = None  # (n, 6)
    remarks: tuple[str, ...] = ()  # what the reader did with the file

    def __post_init__(self) -> None:
        n = len(self.times_s)
        require(n >= 2, f"a motion needs at least 2 samples, not {n}")
        for name in ("qs_rad", "speeds_rad_per_s", "accelerations_rad_per_s2"):
            values = getattr(self, name)
            if values is not None:
                require(values.shape == (n, 6), f"{name} must be ({n}, 6), not {values.shape}")
                _require_finite(values, name)
                object.__setattr__(self, name, readonly(values))
        _require_finite(self.times_s, "times_s")
        object.__setattr__(self, "times_s", readonly(self.times_s - self.times_s[0]))

    def stated(self) -> Interpolation:
        """Return how ROS joins samples that state as much as these."""
        if self.speeds_rad_per_s is None:
            return "linear"
        return "cubic" if self.accelerations_rad_per_s2 is None else "quintic"


@dataclass(frozen=True, slots=True, eq=False)
class DrivenMotion:
    """What is driven, linear between its places: a ``TimedMotion``."""

    times_s: Floats  # (m,)
    qs_rad: Floats  # (m, 6)
    numbers: Floats  # (m,) which sample of the file that is, with fractions in between


def driven(motion: JointMotion, kind: Interpolation) -> DrivenMotion:
    """Return a motion as it is driven: its samples, on a curve also places in between.

    Args:
        motion: As the file states it, times growing.
        kind: How a controller joins the samples.

    Raises:
        InvalidInputError: a cubic without speeds, or a quintic without accelerations.
    """
    n = len(motion.times_s)
    if kind == "linear":
        return DrivenMotion(motion.times_s, motion.qs_rad, np.arange(n, dtype=np.float64))
    lacking = motion.speeds_rad_per_s is None or (
        kind == "quintic" and motion.accelerations_rad_per_s2 is None
    )
    if lacking:
        what = "speeds" if kind == "cubic" else "speeds and accelerations"
        raise InvalidInputError(f"a {kind} needs {what} at each sample, the file states none")
    counts = _counts(motion)
    segment = np.repeat(np.arange(n - 1), counts)
    starts = np.cumsum(counts) - counts
    share = (np.arange(len(segment)) - starts[segment]) / counts[segment]
    qs = np.append(_curve(motion, kind, segment, share), motion.qs_rad[-1:], axis=0)
    gaps = np.diff(motion.times_s)
    times = np.append(motion.times_s[segment] + gaps[segment] * share, motion.times_s[-1])
    return DrivenMotion(times, qs, np.append(segment + share, float(n - 1)))


def require_places(motion: JointMotion, kind: Interpolation, most: int) -> None:
    """Raise InvalidInputError where far more places are to be looked at than can be meant."""
    n = len(motion.times_s) if kind == "linear" else int(_counts(motion).sum())
    if n > most:
        raise InvalidInputError(
            f"the motion lasts {motion.times_s[-1]:.0f} s and has {len(motion.times_s)} samples: "
            f"{n} places would be looked at, {most} are the most; cut it in parts (are the times "
            "in seconds?)"
        )


def _counts(motion: JointMotion) -> Ints:
    """Return in how many parts (n - 1,) each stretch of a curve is looked at."""
    return np.maximum(1, np.ceil(np.diff(motion.times_s) / FINE_S - 1e-6)).astype(np.int64)


def _curve(motion: JointMotion, kind: Interpolation, segment: Ints, share: Floats) -> Floats:
    """Return joint angles (m, 6) on Hermite curves, at shares (m,) of their segments (m,)."""
    span = np.diff(motion.times_s)[segment][:, None]
    u = share[:, None]
    q, speeds = motion.qs_rad, motion.speeds_rad_per_s
    speeds = np.zeros_like(q) if speeds is None else speeds
    q0, q1 = q[segment], q[segment + 1]
    v0, v1 = span * speeds[segment], span * speeds[segment + 1]
    if kind == "cubic":
        bend = 3.0 * (q1 - q0) - 2.0 * v0 - v1
        return q0 + u * (v0 + u * (bend + u * (2.0 * (q0 - q1) + v0 + v1)))
    rates = motion.accelerations_rad_per_s2
    rates = np.zeros_like(q) if rates is None else rates
    a0, a1 = span**2 * rates[segment], span**2 * rates[segment + 1]
    third = 10.0 * (q1 - q0) - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    fourth = -15.0 * (q1 - q0) + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    fifth = 6.0 * (q1 - q0) - 3.0 * (v0 + v1) - 0.5 * (a0 - a1)
    return q0 + u * (v0 + u * (0.5 * a0 + u * (third + u * (fourth + u * fifth))))


def _require_finite(values: Floats, name: str) -> None:
    bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
    if bad.any():
        sample = int(np.argmax(bad))
        value = values[sample]
        joint = "" if value.ndim == 0 else f" of joint {int(np.argmin(np.isfinite(value))) + 1}"
        raise InvalidInputError(f"{name}{joint} is not a finite number at sample {sample}")
