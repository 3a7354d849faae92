"""Virtual operator with the tracked probe: rotation in a bush, scan over the bone.

A hand holds a probe worse than a robot does: it leans by a few degrees, and presses it into its
delay line now more, now less.
"""

import numpy as np
from scipy.interpolate import CubicSpline

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.virtual.operator.hand_trajectories import (
    points_along,
    project_onto_bone,
    raster_curve,
    tangent_axes,
    tilted,
)
from rona_core.virtual.pointer_motion import (
    TILT_HZ,
    WANDER_HZ,
    BandLimitedNoise,
    TipTrajectory,
    motion_progress,
)
from rona_core.virtual.scene import VirtualScene

PLAY_MM = 0.05  # of the probe in its bush, RMS along each axis
PLAY_RAD = np.deg2rad(0.1)  # RMS about each axis across
SWING_S = 5.0  # to and fro once
RIM_MM = 1.0  # the middle of the face goes this far beyond the region
PROBE_TILT_RAD = np.deg2rad(2.0)  # RMS per axis, from the normal of the bone
MOST_TILT_RAD = np.deg2rad(8.0)
PRESSED_MM = (0.0, 1.5)  # into the delay line
PRESSED_RMS_MM = 0.35
SEATED_HZ = 20.0  # how often the hand feels how the bone lies


def rotation_in_bush(
    place: Vector3,
    axis: Vector3,
    half_turn_rad: float,
    times: Floats,
    generator: np.random.Generator,
) -> TipTrajectory:
    """Return the probe turned to and fro about an axis (3,) through a place (3,), with some play.

    The play is what the bush leaves: the axis wanders in it while the hand turns.
    """
    x, y, z = tangent_axes(axis, np.eye(3)[np.argmin(np.abs(axis))])
    share = motion_progress(times, generator)
    swings = max(2.0, round(float(times[-1]) / SWING_S))
    rolls = half_turn_rad * np.sin(2.0 * np.pi * swings * share)
    tips = place + BandLimitedNoise.draw(generator, WANDER_HZ, PLAY_MM, 3).at(times)
    play = BandLimitedNoise.draw(generator, WANDER_HZ, PLAY_RAD, 2).at(times)
    shafts = tilted(np.broadcast_to(z, tips.shape), x, y, play)
    return TipTrajectory(times, tips, shafts, rolls)


def slide_over_region(
    scene: VirtualScene,
    times: Floats,
    generator: np.random.Generator,
    spacing_mm: float,
    shake: Floats,
) -> TipTrajectory:
    """Return the face slid over the region in lines, pressed on, nearly upright on the bone.

    Args:
        scene: Where the bone lies.
        times: Times (n,) of the motion.
        generator: Of what is random in it.
        spacing_mm: Between the lines.
        shake: By how much (n, 2) the hand misses what it aims at.

    Raises:
        InvalidInputError: too many or too few lines, or the bone has large holes.
    """
    center, normal, radius_mm = scene.region_base()
    curve = raster_curve(radius_mm + RIM_MM, spacing_mm)
    aim = points_along(curve, motion_progress(times, generator)) + shake
    x, y, z = tangent_axes(normal, scene.T_base_tracker.translation - center)
    points = center + aim[:, :1] * x + aim[:, 1:] * y
    seats = project_onto_bone(scene, times, points, np.broadcast_to(z, points.shape))
    outward = _normals(scene, times, seats)
    x, y, _ = tangent_axes(outward, scene.T_base_tracker.translation - seats)
    tilt = BandLimitedNoise.draw(generator, TILT_HZ, PROBE_TILT_RAD, 2).at(times)
    size = np.linalg.norm(tilt, axis=1)
    tilt *= (np.minimum(size, MOST_TILT_RAD) / np.maximum(size, 1e-9))[:, None]
    shafts = tilted(outward, x, y, tilt)
    swing = BandLimitedNoise.draw(generator, WANDER_HZ, PRESSED_RMS_MM, 1).at(times)
    pressed = np.clip(np.mean(PRESSED_MM) + swing, *PRESSED_MM)
    return TipTrajectory(times, seats - pressed * shafts, shafts)


def _normals(scene: VirtualScene, times: Floats, points_base: Floats) -> Floats:
    """Return the outward normals (n, 3) of the bone along a stroke, as a hand feels them."""
    count = max(int(np.ceil(times[-1] * SEATED_HZ)), 8)
    felt = np.unique(np.linspace(0, len(times) - 1, count).round().astype(np.int64))
    touched = scene.T_base_skull.inv() @ points_base[felt]
    normals = scene.T_base_skull.rotate(scene.specimen.normal(touched))
    smooth = CubicSpline(times[felt], normals)(times)
    return smooth / np.linalg.norm(smooth, axis=1, keepdims=True)
