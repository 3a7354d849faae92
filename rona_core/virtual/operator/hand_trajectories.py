"""Hand trajectories: plane curves, their projection onto the bone, and the probe held in the hand.

A hand holds a probe worse than a robot does: it leans by a few degrees, and presses it into its
delay line now more, now less.
"""

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3
from rona_core.virtual.pointer_motion import (
    TILT_HZ,
    TREMOR_HZ,
    WANDER_HZ,
    BandLimitedNoise,
    TipTrajectory,
    cross,
    motion_progress,
)
from rona_core.virtual.scene import VirtualScene

MIN_SPACING_MM = 0.2
PIVOT_FROM_SIGHT_RAD = np.deg2rad(80.0)  # between the middle of a pivot and the line of sight
SHAFT_TREMOR_RAD = np.deg2rad(0.1)
SAMPLE_MM = 0.1  # between the points that a curve is given by
STAND_OFF_MM = 40.0  # from where a place is projected onto the bone
MAX_GAP = 0.05  # share of a stroke that may cross holes of the bone
PLAY_MM = 0.05  # of the probe in its bush, RMS along each axis
PLAY_RAD = np.deg2rad(0.1)  # RMS about each axis across
SWING_S = 5.0  # to and fro once
RIM_MM = 1.0  # the middle of the face goes this far beyond the region
PROBE_TILT_RAD = np.deg2rad(2.0)  # RMS per axis, from the normal of the bone
MOST_TILT_RAD = np.deg2rad(8.0)
PRESSED_MM = (0.0, 1.5)  # into the delay line
PRESSED_RMS_MM = 0.35
SEATED_HZ = 20.0  # how often the hand feels how the bone lies


def raster_curve(radius_mm: float, spacing_mm: float) -> Floats:
    """Return a meander over a disc about the origin as a dense polyline (n, 2).

    Straight lines along x, ``spacing_mm`` apart, joined by half circles; every point lies in the
    disc. Neighbouring lines end where the half circle between them touches the rim.

    Raises:
        InvalidInputError: the spacing is below 0.2 mm, or fewer than two lines fit.
    """
    if not MIN_SPACING_MM <= spacing_mm <= radius_mm:
        raise InvalidInputError(
            f"spacing_mm must be {MIN_SPACING_MM:g} to {radius_mm:.1f}, not {spacing_mm}"
        )
    n = int(np.floor((2.0 * radius_mm - spacing_mm) / spacing_mm)) + 1
    turn_mm = spacing_mm / 2.0
    y = (np.arange(n) - (n - 1) / 2.0) * spacing_mm
    middles = (y[1:] + y[:-1]) / 2.0
    turns = np.sqrt((radius_mm - turn_mm) ** 2 - middles**2)  # half length where a turn begins
    start, end = -np.sqrt(radius_mm**2 - y[0] ** 2), np.sqrt(radius_mm**2 - y[-1] ** 2)
    pieces: list[Floats] = []
    x = start
    side = 1.0  # the line runs towards +x or -x
    for i in range(n):
        stop = side * (turns[i] if i < n - 1 else end)
        count = max(int(np.ceil(abs(stop - x) / SAMPLE_MM)), 1)
        line_x = np.linspace(x, stop, count, endpoint=i == n - 1)
        pieces.append(np.column_stack((line_x, np.full(len(line_x), y[i]))))
        if i < n - 1:
            count = max(int(np.ceil(np.pi * turn_mm / SAMPLE_MM)), 8)
            angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, count, endpoint=False)
            arc_x = stop + side * turn_mm * np.cos(angle)
            pieces.append(np.column_stack((arc_x, middles[i] + turn_mm * np.sin(angle))))
        x, side = stop, -side
    return np.concatenate(pieces)


def spiral_tilts(times_s: Floats, cone_rad: float, generator: np.random.Generator) -> Floats:
    """Return the tilts (n, 2) of a shaft that swings in a spiral over a cone, out and in."""
    share = motion_progress(times_s, generator)
    tremor = BandLimitedNoise.draw(generator, TREMOR_HZ, SHAFT_TREMOR_RAD, 2).at(times_s)
    angle = cone_rad * np.sin(np.pi * share)
    turns = max(4.0, round(float(times_s[-1]) / 2.0))
    around = 2.0 * np.pi * turns * share + generator.uniform(0.0, 2.0 * np.pi)
    return angle[:, None] * np.column_stack((np.cos(around), np.sin(around))) + tremor


def pivot_axis(sight: Vector3) -> Vector3:
    """Return a direction near the vertical that leaves the markers well in view.

    Args:
        sight: Unit direction (3,) to the tracker.
    """
    x, _, _ = tangent_axes(sight, np.array((0.0, 0.0, 1.0)))
    return np.cos(PIVOT_FROM_SIGHT_RAD) * sight + np.sin(PIVOT_FROM_SIGHT_RAD) * x


def interpolating_curve(points: Floats) -> Floats:
    """Return a smooth curve (m, d) through points (n, d) in their order, without overshoot.

    Repeated points are passed once; a single point gives a curve that stays there.
    """
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    kept = points[np.concatenate(([True], steps > 1e-9))]
    if len(kept) == 1:
        return np.repeat(kept, 2, axis=0)
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(kept, axis=0), axis=1))))
    count = max(int(np.ceil(along[-1] / SAMPLE_MM)), 2)
    where = np.union1d(np.linspace(0.0, along[-1], count), along)  # every point itself is passed
    if len(kept) == 2:
        return kept[0] + (where / along[-1])[:, None] * (kept[1] - kept[0])
    return PchipInterpolator(along, kept)(where)


def points_along(curve: Floats, shares: Floats) -> Floats:
    """Return positions (n, d) at shares (n,) in 0..1 of the length of a polyline (m, d)."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    if along[-1] <= 0.0:
        return np.repeat(curve[:1], len(shares), axis=0)
    keep = np.concatenate(([True], steps > 0.0))
    return np.column_stack(
        [np.interp(shares * along[-1], along[keep], column[keep]) for column in curve.T]
    )


def project_onto_bone(
    scene: VirtualScene, times: Floats, points: Floats, outward: Floats
) -> Floats:
    """Return points (n, 3) of a stroke brought onto the bone along ``-outward`` (n, 3).

    Raises:
        InvalidInputError: more than a twentieth of them miss the bone.
    """
    T_base_skull = scene.T_base_skull
    T_skull_base = T_base_skull.inv()
    starts = points + STAND_OFF_MM * outward
    depths = scene.specimen.ray(T_skull_base @ starts, T_skull_base.rotate(-outward))
    met = np.isfinite(depths) & (np.abs(depths - STAND_OFF_MM) < STAND_OFF_MM)
    if np.count_nonzero(~met) > MAX_GAP * len(met):
        raise InvalidInputError(
            f"{np.mean(~met):.0%} of the stroke lies beyond the specimen or over holes of it: "
            "choose another region or other places"
        )
    depths = np.interp(times, times[met], depths[met])  # the tip passes over a small hole
    return starts - depths[:, None] * outward


def tangent_axes(z: Floats, towards: Floats) -> tuple[Floats, Floats, Floats]:
    """Return right-handed axes (..., 3) with this z, x as near to ``towards`` as that allows."""
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    x = towards - (towards * z).sum(axis=-1, keepdims=True) * z
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return x, cross(z, x), z


def tilted(z: Floats, x: Floats, y: Floats, lean_rad: Floats) -> Floats:
    """Return z (n, 3) leaned by angles (n, 2) towards x and y, along great circles."""
    angle = np.linalg.norm(lean_rad, axis=1)[:, None]
    direction = lean_rad[:, :1] * x + lean_rad[:, 1:] * y
    return np.cos(angle) * z + np.sinc(angle / np.pi) * direction


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
