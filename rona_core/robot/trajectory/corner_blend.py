"""Corner blending of a joint path, as far as the tool may leave the path and no farther.

Each joint is averaged over a window of the way that is as wide as the allowed deviation of the
tool permits. A path that is straight in pieces gets a continuous second derivative, so that it can
be driven at a steady speed.
See docs/algorithms/robot/verification_and_timing.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PPoly

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.path5d import subdivided
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


def blend_corners(
    way_mm: Floats,
    qs_rad: Floats,
    model: RobotModel,
    deviation_mm: float,
) -> BlendedPath:
    """Return the joint path with its corners rounded.

    Args:
        way_mm: Way along the path (n,), strictly growing.
        qs_rad: Joint angles (n, 6), linear in between.
        model: The robot, whose probe is watched.
        deviation_mm: How far the probe may be from where the given path has it at the same way.

    Raises:
        InvalidInputError: fewer than two places, or a way that does not grow.
    """
    if len(way_mm) < 2 or qs_rad.shape != (len(way_mm), 6) or np.diff(way_mm).min() <= 0.0:
        raise InvalidInputError("a joint path needs two places, its way must grow between them")
    meant = _probe(model, qs_rad)
    half = np.minimum(WIDEST_MM, SLOPE * np.minimum(way_mm - way_mm[0], way_mm[-1] - way_mm))
    slopes = np.diff(qs_rad, axis=0) / np.diff(way_mm)[:, None]
    joints = PPoly(np.stack((slopes, qs_rad[:-1])), way_mm)
    for attempt in range(ROUNDS):
        off, turned = _apart(_probe(model, _triangle_mean(joints, way_mm, half)), meant)
        excess = np.maximum(off / deviation_mm, turned / TURN_RAD) / AIM
        if excess.max() <= ENOUGH:
            break
        closed = attempt >= ROUNDS // 2  # windows that narrowing did not help
        narrower = half / np.maximum(1.0, excess)
        half = _sloped(way_mm, np.where(excess > ENOUGH, 0.0, half) if closed else narrower)
    knots = _knots(way_mm, half)
    qs = _triangle_mean(joints, knots, np.interp(knots, way_mm, half))
    qs[0], qs[-1] = qs_rad[0], qs_rad[-1]
    probe = _probe(model, qs)
    off, turned = _apart(probe, _probe(model, joints(knots)))
    return BlendedPath(knots, qs, probe.translations, float(off.max()), float(turned.max()))


def _triangle_mean(joints: PPoly, at_mm: Floats, half_mm: Floats) -> Floats:
    """Return the mean (m, 6) of a joint path under triangles of some half widths (m,).

    The second difference of its second integral, which is exact.
    """
    twice = joints.antiderivative(2)
    wide = half_mm >= NARROWEST_MM
    w = np.where(wide, half_mm, 1.0)
    change = twice(at_mm + w) + twice(at_mm - w) - 2.0 * twice(at_mm)
    return np.where(wide[:, None], change / w[:, None] ** 2, joints(at_mm))


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
    segment, share = subdivided(counts)
    return np.append(way_mm[segment] + steps[segment] * share, way_mm[-1])
