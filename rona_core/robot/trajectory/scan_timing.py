"""Timing of a scan: approach, scan at constant speed where the joints allow, retract.

Straight and curved pieces are sampled so that all limits are kept.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.limits import require
from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.edge_check import Clear, outside_bone
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.joint_moves import chain, clear_move, sample_times
from rona_core.robot.trajectory.time_parameterization import (
    MERGED,
    SpeedLimits,
    TimedPath,
    blend_corners,
    kept,
    parameterize_time,
)
from rona_core.robot.trajectory.trajectory import SAMPLE_S, Trajectory, sampled_motion

LINE_STEP_MM = 1.0  # between the places of a straight line
LEAST_STANDOFF_MM = 5.0  # of a scan, at both ends of the path
JUMP_RAD = float(np.deg2rad(10.0))  # within a millimetre: another branch of the arm


def retract_line(
    model: RobotModel, q_contact_rad: Floats, standoff_mm: float, clear: Clear | None
) -> Floats:
    """Return joint angles (m, 6) straight back along the probe axis, ``LINE_STEP_MM`` apart.

    The line ends at the stand-off, or earlier where the joints allow no more or something is
    touched.

    Raises:
        NotReachableError: not even the shortest stand-off is possible.
    """
    line, back_mm = line_back(model, q_contact_rad, standoff_mm, clear)
    require_standoff(back_mm)
    return line


def require_standoff(back_mm: float) -> None:
    """Raise NotReachableError where a line back is shorter than the shortest stand-off."""
    if back_mm < LEAST_STANDOFF_MM:
        raise NotReachableError(
            f"the tool can only be drawn back by {back_mm:g} mm from "
            f"one end of the path, {LEAST_STANDOFF_MM:g} mm are needed"
        )


def line_back(
    model: RobotModel, q_rad: Floats, most_mm: float, clear: Clear | None
) -> tuple[Floats, float]:
    """Return joint angles (m, 6) straight back as far as possible, and that distance."""
    return clear_part(lines_back(model, q_rad[None], most_mm)[0], clear)


def clear_part(line: Floats, clear: Clear | None) -> tuple[Floats, float]:
    """Return how much of a line back (m, 6) touches nothing, and that distance."""
    free = np.ones(len(line), dtype=np.bool_) if clear is None else clear(line)
    line = line if free.all() else line[: int(np.argmin(free))]
    return line, max(0, len(line) - 1) * LINE_STEP_MM


def lines_back(model: RobotModel, qs_rad: Floats, most_mm: float) -> list[Floats]:
    """Return joint angles (m, 6) straight back from each of k postures (k, 6), whatever is there.

    Each begins with its posture and goes as far as the joints allow.
    """
    Ts_base_probe = model.forward(qs_rad) @ model.T_flange_probe
    backs_mm = np.arange(LINE_STEP_MM, most_mm + LINE_STEP_MM / 2.0, LINE_STEP_MM)
    axes = Ts_base_probe.rotations[:, :, 2]
    places = Ts_base_probe.translations[:, None] - backs_mm[:, None] * axes[:, None]
    rotations = np.repeat(Ts_base_probe.rotations, len(backs_mm), axis=0)
    probes = Poses.unchecked(rotations, places.reshape(-1, 3))
    ways = model.follow_each(probes @ model.T_flange_probe.inv(), qs_rad, JUMP_RAD)
    return [np.vstack((q_rad, way)) for q_rad, way in zip(qs_rad, ways, strict=True)]


SLOWER = 6  # times that a motion is slowed down until its samples keep all limits
SHARE_ASKED = 1.0 - 1e-9
RESERVE, BESIDE = 1.005, 2  # of the speed, and stretches before and after, where it is slowed
TURN_WAY_MM = 10.0  # a turn of one radian on the spot counts as this much way


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """How the scan path is driven."""

    scan_speed_mm_per_s: float = 20.0
    path_acceleration_mm_per_s2: float = 250.0
    jerk_mm_per_s3: float = 2500.0
    standoff_mm: float = 30.0  # straight along the probe axis, before and after contact
    approach_speed_mm_per_s: float = 15.0
    corner_deviation_mm: float = 0.2  # the probe may cut corners by this much

    def __post_init__(self) -> None:
        for name in ("scan_speed_mm_per_s", "approach_speed_mm_per_s"):
            value = getattr(self, name)
            require(0.5 <= value <= 100.0, f"{name} must be 0.5 to 100, not {value}")
        for name in ("path_acceleration_mm_per_s2", "jerk_mm_per_s3"):
            value = getattr(self, name)
            require(10.0 <= value <= 1e5, f"{name} must be 10 to 100000, not {value}")
        require(
            5.0 <= self.standoff_mm <= 200.0,
            f"standoff_mm must be 5 to 200, not {self.standoff_mm}",
        )
        require(
            0.05 <= self.corner_deviation_mm <= 0.25,  # the verifier allows 0.3 in all
            f"corner_deviation_mm must be 0.05 to 0.25, not {self.corner_deviation_mm}",
        )


def speed_limits(settings: ScanSettings, speed_mm_per_s: float) -> SpeedLimits:
    """Return the limits along a path that is driven at some speed."""
    return SpeedLimits(
        speed_mm_per_s, settings.path_acceleration_mm_per_s2, settings.jerk_mm_per_s3
    )


def sample_path(
    way_mm: Floats,
    qs_rad: Floats,
    points_base: Floats,
    limits: SpeedLimits,
    model: RobotModel,
    feeds_mm_per_s: Floats | None = None,
) -> tuple[Floats, Floats]:
    """Return way (m,) and joints (m, 6) at samples ``SAMPLE_S`` apart, from rest to rest.

    Limits are planned with some reserve at every point of the way. Should the samples, driven
    linearly, still exceed one of the joints or of the acceleration, the whole motion is slowed down
    until they do not; where the tool is faster than asked, the motion is slowed down there alone.
    """
    asked = np.full(len(way_mm), limits.speed_mm_per_s)
    asked = asked if feeds_mm_per_s is None else np.minimum(asked, feeds_mm_per_s)
    feeds, slower = feeds_mm_per_s, 1.0
    timed = parameterize_time(way_mm, qs_rad, points_base, limits, model.limits, feeds)
    ways, qs = _sampled(timed, timed.duration_s, qs_rad)
    for _ in range(SLOWER):
        tips = (model.forward(qs) @ model.T_flange_probe).translations
        excess = _excess(qs, tips, limits, model)
        shares = _speed_shares(ways, tips, way_mm, asked)
        if excess > SHARE_ASKED:
            slower *= 1.001 * np.sqrt(excess)
        elif (shares > SHARE_ASKED).any():
            feeds = _slowed(asked if feeds is None else feeds, way_mm, ways, shares)
            timed = parameterize_time(way_mm, qs_rad, points_base, limits, model.limits, feeds)
        else:
            break
        ways, qs = _sampled(timed, slower * timed.duration_s, qs_rad)
    return ways, qs


def _excess(qs_rad: Floats, tips_base: Floats, limits: SpeedLimits, model: RobotModel) -> float:
    """Return the largest share of a limit that samples (m, 6), (m, 3) need, as an acceleration."""
    speeds = np.diff(qs_rad, axis=0) / SAMPLE_S
    resting = np.vstack((np.zeros(6), speeds, np.zeros(6)))
    gains = np.abs(np.diff(resting, axis=0)) / SAMPLE_S
    moving = np.vstack((np.zeros(3), np.diff(tips_base, axis=0) / SAMPLE_S, np.zeros(3)))
    felt = np.linalg.norm(np.diff(moving, axis=0), axis=1).max() / SAMPLE_S
    return max(
        float((np.abs(speeds) / model.speed_rad_per_s).max()) ** 2,
        float((gains / model.acceleration_rad_per_s2).max()),
        float(felt / limits.acceleration_mm_per_s2),
    )


def _speed_shares(ways: Floats, tips_base: Floats, way_mm: Floats, asked: Floats) -> Floats:
    """Return the share of the speed asked for that the tool needs up to each sample, (m - 1,)."""
    least_s = np.concatenate(([0.0], np.cumsum(np.diff(way_mm) / asked[1:])))
    driven_mm, least = np.diff(ways), np.diff(np.interp(ways, way_mm, least_s))
    moved_mm = np.linalg.norm(np.diff(tips_base, axis=0), axis=1)
    stretch = np.divide(moved_mm, driven_mm, out=np.ones(len(driven_mm)), where=driven_mm > MERGED)
    return np.maximum(stretch, 1.0) * least / SAMPLE_S


def _slowed(feeds: Floats, way_mm: Floats, ways: Floats, shares: Floats) -> Floats:
    """Return feeds (n,), lower on the stretches on which samples need more than all of them."""
    slowed = feeds.copy()
    for sample in np.flatnonzero(shares > SHARE_ASKED).tolist():
        first = int(np.searchsorted(way_mm, ways[sample], side="right"))
        last = int(np.searchsorted(way_mm, ways[sample + 1]))
        part = slice(max(first - BESIDE, 0), last + 1 + BESIDE)
        slowed[part] = np.minimum(slowed[part], feeds[part] / (RESERVE * shares[sample]))
    return slowed


def _sampled(timed: TimedPath, duration_s: float, qs_rad: Floats) -> tuple[Floats, Floats]:
    """Return way (m,) and joints (m, 6) at whole samples, a little slower to fill the last one."""
    times = sample_times(duration_s)
    ways = timed.way_at(times * (timed.duration_s / times[-1]))
    ways[0], ways[-1] = timed.way_mm[[0, -1]]
    qs = timed.joints(ways)
    qs[0], qs[-1] = qs_rad[0], qs_rad[-1]
    return ways, qs


def timed_line(qs_rad: Floats, settings: ScanSettings, model: RobotModel) -> Floats:
    """Return samples (m, 6) of a straight line, driven at approach speed from rest to rest."""
    points = (model.forward(qs_rad) @ model.T_flange_probe).translations
    way_mm = LINE_STEP_MM * np.arange(len(qs_rad), dtype=np.float64)
    slow = speed_limits(settings, settings.approach_speed_mm_per_s)
    return sample_path(way_mm, qs_rad, points, slow, model)[1]


def time_scan(
    path: Path5D,
    qs_rad: Floats,
    model: RobotModel,
    settings: ScanSettings,
    *,
    clear: Clear | None = None,
) -> Trajectory:
    """Return the whole motion of a scan, from rest to rest.

    From home in joint space to the stand-off, straight down to the first path point, along the
    path, straight up from the last point, and home again. Where the joints do not allow the whole
    stand-off, it is as long as they do.

    Args:
        path: The dense scan path in ``base``.
        qs_rad: Joint angles (n, 6) that follow it, continuous, one branch.
        model: The robot with its tool.
        settings: Speeds and stand-off.
        clear: Maps joint angles (n, 6) to where nothing is touched. Approach and retract go
            around what is in the way. None: nothing is known but the bone under the path.

    Raises:
        InvalidInputError: not one joint vector for each path point, or a path without length.
        NotReachableError: the probe cannot be drawn back from an end of the path, or there is no
            clear way from the start or back.
    """
    if qs_rad.shape != (len(path), 6):
        raise InvalidInputError(f"qs_rad must have shape ({len(path)}, 6), not {qs_rad.shape}")
    down = retract_line(model, qs_rad[0], settings.standoff_mm, clear)[::-1]
    up = retract_line(model, qs_rad[-1], settings.standoff_mm, clear)
    way, along = _way(path), path.arc_length_mm()
    scan_ways, scan = _timed_scan(way, qs_rad, model, settings)
    free, home = outside_bone(path, model, clear), model.home_rad
    before = chain((clear_move(model, home, down[0], free), timed_line(down, settings, model)))
    after = chain((timed_line(up, settings, model), clear_move(model, up[-1], home, free)))
    qs = chain((before, scan, after))
    path_mm = np.full(len(qs), along[-1])
    path_mm[: len(before)] = 0.0
    first, last = len(before) - 1, len(before) + len(scan) - 2
    path_mm[first : last + 1] = np.interp(scan_ways, way, along)
    return Trajectory(
        times_s=readonly(np.arange(len(qs), dtype=np.float64) * SAMPLE_S),
        qs_rad=readonly(qs),
        scan_start_s=SAMPLE_S * first,
        scan_end_s=SAMPLE_S * last,
        path_mm=readonly(path_mm),
    )


CORNER_MM_PER_S = 8.0  # speed at which a way point is passed, about
FROM_HOME_S = 4.5  # a move between home and the stand-off takes so long, about


def expected_duration_s(path: Path5D, way_points: int, settings: ScanSettings) -> float:
    """Return how long a scan will take from home to home, before a motion is planned.

    The path at scan speed, a brake at each way point, the lines at both stand-offs, the moves from
    and to home. Error within 10 %: three of patients, a spiral and rasters at 10 to 40 mm/s, with
    the RX90.

    Args:
        path: To scan.
        way_points: So many has it, both ends among them.
        settings: Of the drive.
    """
    speed, jerk = settings.scan_speed_mm_per_s, settings.jerk_mm_per_s3
    acceleration = settings.path_acceleration_mm_per_s2
    braked = max(speed - CORNER_MM_PER_S, 0.0)
    ramp_s = braked / acceleration + acceleration / jerk
    if braked < acceleration**2 / jerk:
        ramp_s = 2.0 * float(np.sqrt(braked / jerk))
    on_path_s = float(_way(path)[-1]) / speed + max(way_points - 2, 0) * ramp_s * braked / speed
    return on_path_s + 2.0 * (settings.standoff_mm / settings.approach_speed_mm_per_s + FROM_HOME_S)


def _timed_scan(
    way_mm: Floats, qs_rad: Floats, model: RobotModel, settings: ScanSettings
) -> tuple[Floats, Floats]:
    """Return way (m,) and joints (m, 6) of the scan, its corners rounded."""
    keep = kept(way_mm)
    if np.count_nonzero(keep) < 2 or way_mm[-1] <= MERGED:
        raise InvalidInputError("a path without length cannot be timed; it needs two places")
    rounded = blend_corners(way_mm[keep], qs_rad[keep], model, settings.corner_deviation_mm)
    limits = speed_limits(settings, settings.scan_speed_mm_per_s)
    return sample_path(rounded.way_mm, rounded.qs_rad, rounded.points_base, limits, model)


def _way(path: Path5D) -> Floats:
    """Return the way (n,) along the path: its length, or where it turns on the spot, the turn."""
    steps_mm, turns_rad = path.steps()
    turns_rad[turns_rad < 1e-6] = 0.0  # rounding, not a turn
    return np.concatenate(([0.0], np.cumsum(np.maximum(steps_mm, TURN_WAY_MM * turns_rad))))


RETRACT_AFTER_STOP_MM = 30.0  # as far as the stand-off of a scan


def retract_after_stop(
    model: RobotModel, q_rad: Floats, clear: Clear, retract_mm: float = RETRACT_AFTER_STOP_MM
) -> Trajectory:
    """Plan the motion straight back along the probe axis, at the speed of an approach.

    Args:
        model: The robot with its tool.
        q_rad: Joint angles (6,) where it stands.
        clear: Maps joint angles (n, 6) to where nothing is touched that must not be.
        retract_mm: How far to go.

    Raises:
        NotReachableError: the joints or something in the way do not allow the whole way.
    """
    line, back_mm = line_back(model, q_rad, retract_mm, clear)
    if back_mm < retract_mm - LINE_STEP_MM / 2.0:
        raise NotReachableError(
            f"the probe can be drawn back by {back_mm:g} mm only from where it stands, "
            f"{retract_mm:g} mm are needed: move the robot away by hand"
        )
    return sampled_motion(timed_line(line, ScanSettings(), model))
