"""Timing of a cutting path: each part from rest to rest at its feeds, and the ways there and back.

Parts begin and end at one posture above the bed. From there the way home is always the same, so
that the motion may end after any of them. See docs/algorithms/implant/robot_milling.md.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require_within
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.path5d import Path5D, UpheldPath5D, subdivided
from rona_core.robot.collision.edge_check import Clear, outside_bone
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.joint_moves import chain, clear_move
from rona_core.robot.trajectory.scan_timing import (
    ScanSettings,
    retract_line,
    sample_path,
    timed_line,
)
from rona_core.robot.trajectory.time_parameterization import SpeedLimits, blend_corners, kept
from rona_core.robot.trajectory.trajectory import SAMPLE_S, CuttingPath, Trajectory

DENSE_MM = 0.3  # of way, between places whose joint angles are solved
LONGEST = 16  # samples that one straight stretch may stand for,
THIN_MM, THIN_RAD = 0.02, 1e-3  # as long as tip, way and joints are off by no more,
BEND_MM = 0.05  # and the tip is by no more off a straight line


@dataclass(frozen=True, slots=True)
class CuttingSettings:
    """How a cutting path is driven; what is assumed is so for the reason given."""

    path_acceleration_mm_per_s2: float = 250.0  # like a scan
    jerk_mm_per_s3: float = 2500.0
    standoff_mm: float = 30.0  # straight along the axis, before and after
    approach_speed_mm_per_s: float = 15.0
    corner_deviation_mm: float = 0.04  # small beside the clearances of a bed, 0.3 mm

    def __post_init__(self) -> None:
        require_within("corner_deviation_mm", self.corner_deviation_mm, 0.01, 0.09)

    def lines(self) -> ScanSettings:
        """Return how the straight lines to the bed and away from it are driven."""
        return ScanSettings(
            path_acceleration_mm_per_s2=self.path_acceleration_mm_per_s2,
            jerk_mm_per_s3=self.jerk_mm_per_s3,
            standoff_mm=self.standoff_mm,
            approach_speed_mm_per_s=self.approach_speed_mm_per_s,
        )


def dense_ways(path: CuttingPath, step_mm: float = DENSE_MM) -> Floats:
    """Return ways (m,) along a path, its own places and others in between."""
    way = path.way_mm()
    way = way[kept(way)]
    counts = np.maximum(1, np.ceil(np.diff(way) / step_mm - 1e-9)).astype(np.int64)
    segment, share = subdivided(counts)
    return np.append(way[segment] + np.diff(way)[segment] * share, way[-1])


def path5d_at(path: CuttingPath, ways_mm: Floats) -> UpheldPath5D:
    """Return tip and axis of the burr at ways (m,), in ``base``; roll zero is along x of the bed.

    Raises:
        DegenerateGeometryError: an axis that lies nearly level in the bed.
    """
    places, T_base_bed = path.at(ways_mm), path.T_base_bed
    return UpheldPath5D(
        T_base_bed @ places.tips_bed,
        T_base_bed.rotate(places.axes_bed),
        T_base_bed.rotation[:, 0],
    )


def time_cutting(
    path: CuttingPath,
    ways_mm: Floats,
    qs_rad: Floats,
    model: RobotModel,
    settings: CuttingSettings,
    *,
    clear: Clear | None = None,
) -> Trajectory:
    """Return the whole motion, from rest to rest: home, the parts of the path, home.

    Where another burr is put in, the robot goes home and comes back.

    Args:
        path: What the burr is to follow.
        ways_mm: Ways (m,) along it, growing, those of its rests among them.
        qs_rad: Joint angles (m, 6) there, continuous, one branch.
        model: The robot with its spindle.
        settings: How to drive.
        clear: Maps joint angles (n, 6) to where nothing is touched; None: nothing is known.

    Raises:
        InvalidInputError: not one joint vector for each way, or rests at different postures.
        NotReachableError: the burr cannot be drawn back, or there is no clear way.
    """
    if qs_rad.shape != (len(ways_mm), 6):
        raise InvalidInputError(f"qs_rad must have shape ({len(ways_mm)}, 6), not {qs_rad.shape}")
    rests = path.way_mm()[path.rests]
    rows = np.searchsorted(ways_mm, rests - 1e-9)
    if np.abs(qs_rad[rows] - qs_rad[0]).max() > 1e-6:
        raise InvalidInputError("the burr must rest at one and the same pose")
    qs = qs_rad.copy()
    qs[rows] = qs_rad[0]
    there, back = _there_and_back(path, qs[0], model, settings, clear)
    motion = [_still(there, rests[0])]
    for k, changed in enumerate(path.changes()[1:]):
        part = slice(int(rows[k]), int(rows[k + 1]) + 1)
        motion.append(_timed_part(path, ways_mm[part], qs[part], model, settings))
        if changed:
            motion += [_still(back, rests[k + 1]), _still(there, rests[k + 1])]
    motion.append(_still(back, rests[-1]))
    times, driven = _joined(motion)
    first, last = len(there) - 1, len(times) - len(back)
    return Trajectory(
        times_s=readonly(times),
        qs_rad=readonly(driven[:, :6]),
        scan_start_s=float(times[first]),
        scan_end_s=float(times[last]),
        path_mm=readonly(driven[:, 6]),
    )


# Samples (n, 8): time from the start of the part, joint angles, way along the path.
Part = tuple[Floats, Floats]


def _there_and_back(
    path: CuttingPath,
    q_rest: Floats,
    model: RobotModel,
    settings: CuttingSettings,
    clear: Clear | None,
) -> tuple[Floats, Floats]:
    """Return samples (n, 6) from home to the rest above the bed, and back."""
    lines = settings.lines()
    up = retract_line(model, q_rest, settings.standoff_mm, clear)
    start = path5d_at(path, np.zeros(1))
    free = outside_bone(Path5D(start.points_base, start.axes_base), model, clear)
    home = model.home_rad
    there = chain((clear_move(model, home, up[-1], free), timed_line(up[::-1], lines, model)))
    back = chain((timed_line(up, lines, model), clear_move(model, up[-1], home, free)))
    return there, back


def _still(qs: Floats, way_mm: float) -> Part:
    """Return samples (n, 6) of a motion that is not along the path."""
    times = SAMPLE_S * np.arange(len(qs), dtype=np.float64)
    return times, np.column_stack((qs, np.full(len(qs), way_mm)))


def _timed_part(
    path: CuttingPath, ways: Floats, qs: Floats, model: RobotModel, settings: CuttingSettings
) -> Part:
    """Return one part from rest to rest, its corners rounded, as few samples as will do."""
    rounded = blend_corners(ways, qs, model, settings.corner_deviation_mm)
    feeds = path.feeds_mm_per_s[path.moves_at(rounded.way_mm)]
    limits = SpeedLimits(
        float(feeds.max()), settings.path_acceleration_mm_per_s2, settings.jerk_mm_per_s3
    )
    at_mm, driven = sample_path(
        rounded.way_mm, rounded.qs_rad, rounded.points_base, limits, model, feeds
    )
    rows = thinned(driven, at_mm, model)
    return SAMPLE_S * rows.astype(np.float64), np.column_stack((driven, at_mm))[rows]


def thinned(qs_rad: Floats, ways_mm: Floats, model: RobotModel) -> Ints:
    """Return which samples (k,) of joints (n, 6) and ways (n,) to keep, linear in between.

    Samples are taken together in twos, fours and so on, as long as the tip stays where it was and
    goes nearly straight, and the way is passed as evenly.
    """
    n = len(qs_rad)
    tips = (model.forward(qs_rad) @ model.T_flange_probe).translations
    keep = np.ones(n, dtype=np.bool_)
    whole = np.ones(n, dtype=np.bool_)  # stretches that are straight at the last length
    length = 2
    while length <= LONGEST:
        starts = np.arange(0, n - length, length)
        starts = starts[whole[starts] & whole[starts + length // 2]]
        if not len(starts):
            break
        rows = starts[:, None] + np.arange(1, length)
        q, tip, way = (_chords(v, starts, length) for v in (qs_rad, tips, ways_mm[:, None]))
        real = (model.forward(q.reshape(-1, 6)) @ model.T_flange_probe).translations
        real = real.reshape(tip.shape)
        off = np.maximum.reduce(
            (
                np.linalg.norm(real - tips[rows], axis=2) / THIN_MM,
                np.abs(way[:, :, 0] - ways_mm[rows]) / THIN_MM,
                np.linalg.norm(real - tip, axis=2) / BEND_MM,
                np.abs(q - qs_rad[rows]).max(axis=2) / THIN_RAD,
            )
        ).max(axis=1)
        straight = starts[off <= 1.0]
        keep[(straight[:, None] + np.arange(1, length)).ravel()] = False
        whole = np.zeros(n, dtype=np.bool_)
        whole[straight] = True
        length *= 2
    return np.flatnonzero(keep)


def _chords(values: Floats, starts: Ints, length: int) -> Floats:
    """Return what lies evenly between values (n, c) at starts (k,) and so much later."""
    share = (np.arange(1, length) / length)[None, :, None]
    return values[starts, None] * (1.0 - share) + values[starts + length, None] * share


def _joined(parts: list[Part]) -> tuple[Floats, Floats]:
    """Return times (n,) and samples (n, 7) of parts that follow each other."""
    times, samples = [parts[0][0]], [parts[0][1]]
    for after_s, values in parts[1:]:
        times.append(times[-1][-1] + after_s[1:])
        samples.append(values[1:])
    return np.concatenate(times), np.concatenate(samples)
