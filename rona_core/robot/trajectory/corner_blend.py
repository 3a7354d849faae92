"""Round the corners of a joint path, as far as the tool may leave the path and no farther.

Each joint is averaged over a window of the way that is as wide as the allowed deviation of the
tool permits: wide along smooth stretches, narrow at corners, closed at both ends. A path that is
straight in pieces gets a continuous second derivative, so that it can be driven at a steady speed.
See docs/algorithms/robot/verification_and_timing.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.robot_model import RobotModel

WIDEST_MM = 6.0  # half the window where nothing speaks against it
NARROWEST_MM = 0.05  # a window narrower than this changes nothing
SLOPE = 0.5  # change of the half width with the way, at most
TURN_RAD = float(np.deg2rad(0.25))  # the tool may turn away by this much
ROUNDS = 12  # of narrowing the windows
AIM = 0.95  # of the deviation; the rest is for what lies between the points looked at
ENOUGH = 1.0 + 1e-6  # rounding must not decide
KNOTS_A_WIDTH, WIDEST_KNOT_MM = 4.0, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class BlendedPath:
    """A joint path without corners, and how far it strays from the one it was made of."""

    way_mm: Floats  # (k,) along the path that was given
    qs_rad: Floats  # (k, 6)
    points_base: Floats  # (k, 3) position of the probe
    deviation_mm: float  # largest distance of the probe from where it was meant to be
    turn_rad: float  # largest angle between the two orientations


def blend(
    way_mm: Floats,
    qs_rad: Floats,
    model: RobotModel,
    deviation_mm: float,
    turn_rad: float = TURN_RAD,
) -> BlendedPath:
    """Return the joint path with its corners rounded.

    Args:
        way_mm: Way along the path (n,), strictly growing.
        qs_rad: Joint angles (n, 6), linear in between.
        model: The robot, whose probe is watched.
        deviation_mm: How far the probe may be from where the given path has it at the same way.
        turn_rad: How far the probe may be turned away from its given orientation.

    Raises:
        InvalidInputError: fewer than two places, or a way that does not grow.
    """
    if len(way_mm) < 2 or qs_rad.shape != (len(way_mm), 6) or np.diff(way_mm).min() <= 0.0:
        raise InvalidInputError("a joint path needs two places, its way must grow between them")
    meant = _probe(model, qs_rad)
    half = np.minimum(WIDEST_MM, SLOPE * np.minimum(way_mm - way_mm[0], way_mm[-1] - way_mm))
    average = _Average(way_mm, qs_rad)
    for attempt in range(ROUNDS):
        off, turned = _apart(_probe(model, average(way_mm, half)), meant)
        excess = np.maximum(off / deviation_mm, turned / turn_rad) / AIM
        if excess.max() <= ENOUGH:
            break
        closed = attempt >= ROUNDS // 2  # windows that narrowing did not help
        narrower = half / np.maximum(1.0, excess)
        half = _sloped(way_mm, np.where(excess > ENOUGH, 0.0, half) if closed else narrower)
    knots = _knots(way_mm, half)
    qs = average(knots, np.interp(knots, way_mm, half))
    qs[0], qs[-1] = qs_rad[0], qs_rad[-1]
    probe = _probe(model, qs)
    given = np.stack([np.interp(knots, way_mm, q) for q in qs_rad.T], axis=1)
    off, turned = _apart(probe, _probe(model, given))
    return BlendedPath(knots, qs, probe.translations, float(off.max()), float(turned.max()))


class _Average:
    """The mean of a joint path under a triangle of any half width, exact between its points."""

    def __init__(self, way_mm: Floats, qs_rad: Floats) -> None:
        steps = np.diff(way_mm)[:, None]
        self.way, self.qs = way_mm, qs_rad
        self.slopes = np.diff(qs_rad, axis=0) / steps
        zero = np.zeros((1, qs_rad.shape[1]))
        first = np.cumsum(steps * (qs_rad[1:] + qs_rad[:-1]) / 2.0, axis=0)
        self.once = np.vstack((zero, first))
        second = (
            self.once[:-1] * steps + qs_rad[:-1] * steps**2 / 2.0 + self.slopes * steps**3 / 6.0
        )
        self.twice = np.vstack((zero, np.cumsum(second, axis=0)))

    def __call__(self, at_mm: Floats, half_mm: Floats) -> Floats:
        wide = half_mm >= NARROWEST_MM
        w = np.where(wide, half_mm, 1.0)[:, None]
        middle, plain = self._integral(at_mm)
        ends = self._integral(at_mm + w[:, 0])[0] + self._integral(at_mm - w[:, 0])[0]
        return np.where(wide[:, None], (ends - 2.0 * middle) / w**2, plain)

    def _integral(self, at_mm: Floats) -> tuple[Floats, Floats]:
        """Return the second integral of the joints (m, 6) at ways (m,), and the joints."""
        i = np.clip(np.searchsorted(self.way, at_mm, side="right") - 1, 0, len(self.slopes) - 1)
        u = (at_mm - self.way[i])[:, None]
        q, slope = self.qs[i], self.slopes[i]
        twice = self.twice[i] + u * (self.once[i] + u * (q / 2.0 + u * slope / 6.0))
        return twice, q + u * slope


def _probe(model: RobotModel, qs_rad: Floats) -> Poses:
    return model.forward(qs_rad) @ model.T_flange_probe


def _apart(real: Poses, meant: Poses) -> tuple[Floats, Floats]:
    """Return distance (mm) and angle (rad), each (n,), between two sequences of poses."""
    off = np.linalg.norm(real.translations - meant.translations, axis=1)
    chord = np.linalg.norm(real.rotations - meant.rotations, axis=(1, 2))
    return off, 2.0 * np.arcsin(np.minimum(1.0, chord / np.sqrt(8.0)))


def _sloped(way_mm: Floats, half_mm: Floats) -> Floats:
    """Return half widths (n,) lowered until they change by no more than ``SLOPE``."""
    lean = SLOPE * way_mm
    up = np.minimum.accumulate(half_mm - lean) + lean
    return np.minimum.accumulate((up + lean)[::-1])[::-1] - lean


def _knots(way_mm: Floats, half_mm: Floats) -> Floats:
    """Return the ways (k,) at which the rounded path is kept: closely where windows are narrow."""
    least = np.minimum(half_mm[1:], half_mm[:-1])
    inside = np.clip(least / KNOTS_A_WIDTH, 2.0 * NARROWEST_MM, WIDEST_KNOT_MM)
    steps = np.diff(way_mm)
    counts = np.maximum(1, np.ceil(steps / inside - 1e-9)).astype(np.int64)
    segment = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[
        segment
    ]
    return np.append(way_mm[segment] + steps[segment] * share, way_mm[-1])
