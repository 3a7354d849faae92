"""Calibration motion of the tool: pivot about the tool tip, then shifts along tool x and y.

The tip stays in one place while the tool tilts through a spread of directions, so that the marker
moves on a sphere; the shifts at constant orientation give the axes (Section III.A of the paper).
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from rona_core.devices.limits import require
from rona_core.errors import InvalidInputError, NotReachableError
from rona_core.geometry.arrays import Floats, Ints, as_vector3, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.collision.collision_world import CollisionWorld, require_clear
from rona_core.robot.collision.edge_check import Clear
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.redundancy.margins import MarginLimits, compute_margins
from rona_core.robot.trajectory.joint_moves import clear_move, sample_times
from rona_core.robot.trajectory.time_parameterization import SpeedLimits, parameterize_time
from rona_core.robot.trajectory.trajectory import SAMPLE_S, sampled_motion
from rona_core.robot.verification.certificate import Certificate
from rona_core.robot.verification.verifier import verify_motion

PIVOT, ALONG_X, ALONG_Y = 0, 1, 2  # phases of the dwells
TWIST_RAD = np.deg2rad(12.0)  # the tool also turns about its own axis, to and fro
GOLDEN_RAD = np.pi * (3.0 - np.sqrt(5.0))  # between neighbours on a spiral that fills a disc
LEGS = SpeedLimits(speed_mm_per_s=60.0, acceleration_mm_per_s2=250.0, jerk_mm_per_s3=2500.0)
TURN_WAY_MM = 150.0  # turning by a radian counts as this far: the distance of the marker
DENSE_MM = 2.0
NEARLY = 0.8  # of the largest margin is as good


@dataclass(frozen=True, slots=True, eq=False)
class ToolMotion:
    """The calibration motion, when it dwells, and what each dwell is for."""

    times_s: Floats  # (n,)
    qs_rad: Floats  # (n, 6)
    dwell_start_s: Floats  # (k,)
    dwell_end_s: Floats  # (k,)
    phases: Ints  # (k,) 0 pivot, 1 along tool x, 2 along tool y
    T_base_tip_center: Pose  # where the tip pivots, and the upright orientation
    certificate: Certificate


@dataclass(frozen=True, slots=True)
class ToolMotionSettings:
    """How far the tool is tilted and shifted, and at how many dwells."""

    cone_deg: float = 20.0  # largest tilt of the tool from upright
    n_pivot: int = 30  # dwells of the pivot
    n_translate: int = 10  # dwells along each of tool x and tool y; 0: it pivots alone
    length_mm: float = 100.0  # of each shift, half to either side of the middle
    dwell_s: float = 0.5  # the robot stands still at each dwell

    def __post_init__(self) -> None:
        for name, least, most in (
            ("cone_deg", 2.0, 60.0),
            ("n_pivot", 4, 500),
            ("n_translate", 0, 200),
            ("length_mm", 10.0, 400.0),
            ("dwell_s", 0.1, 10.0),
        ):
            value = getattr(self, name)
            require(least <= value <= most, f"{name} must be {least:g} to {most:g}, not {value}")
        require(self.n_translate != 1, "n_translate must be 0, or at least 2")


def plan_tool_motion(
    model: RobotModel,
    settings: ToolMotionSettings | None = None,
    *,
    tip_base: ArrayLike | None = None,
    facing_base: ArrayLike | None = None,
    obstacles: Obstacles = NOTHING_AROUND,
) -> ToolMotion:
    """Plan the calibration motion of the tool, from home and back.

    The tool points down. At the middle of the cone the marker plate looks along ``facing_base``
    (horizontally, and somewhat up): put the tracker there.

    Args:
        model: The robot with its tool.
        settings: How far the tool is moved.
        tip_base: Where the tip pivots (3,), in ``base``; by default as the robot's work area says.
        facing_base: Horizontal direction (3,) in which the marker plate looks; likewise.
        obstacles: All moves go around them, and keep the robot clear of itself.

    Raises:
        InvalidInputError: a wrong shape, or a vertical ``facing_base``.
        NotReachableError: no branch of the arm reaches all poses, something is in the way of one,
            or there is no clear way from one to the next.
    """
    settings = settings or ToolMotionSettings()
    place = model.work_area.pivot_base if tip_base is None else tip_base
    facing = model.work_area.facing_base if facing_base is None else facing_base
    center = _upright(as_vector3(place, name="tip_base"), as_vector3(facing, name="facing"))
    n_pivot, n_translate, length_mm = settings.n_pivot, settings.n_translate, settings.length_mm
    stops = (
        _pivot_stops(center, np.deg2rad(settings.cone_deg), n_pivot)
        + _shift_stops(center, 0, length_mm, n_translate)
        + _shift_stops(center, 1, length_mm, n_translate)
    )
    phases = np.repeat((PIVOT, ALONG_X, ALONG_Y), (n_pivot, n_translate, n_translate))
    legs = [_leg(a, b) for a, b in pairwise(stops)]
    qs_legs = _reach(model, legs)
    clear = CollisionWorld(model, obstacles).clear
    require_clear(model, obstacles, model.home_rad, "rests")
    q_stops = np.array([qs[0] for qs in qs_legs] + [qs_legs[-1][-1]])
    for stop in np.flatnonzero(~clear(q_stops))[:1].tolist():
        place = f"is to rest at place {stop + 1} of {len(q_stops)} (a smaller cone may help)"
        require_clear(model, obstacles, q_stops[stop], place)
    qs, starts, ends = _samples(model, legs, qs_legs, settings.dwell_s, clear)
    motion = sampled_motion(qs)
    return ToolMotion(
        times_s=motion.times_s,
        qs_rad=motion.qs_rad,
        dwell_start_s=readonly(motion.times_s[starts]),
        dwell_end_s=readonly(motion.times_s[ends]),
        phases=readonly(phases.astype(np.int64)),
        T_base_tip_center=center,
        certificate=verify_motion(model, motion, obstacles=obstacles),
    )


def _samples(
    model: RobotModel,
    legs: list[Poses],
    qs_legs: list[Floats],
    dwell_s: float,
    clear: Clear,
) -> tuple[Floats, Ints, Ints]:
    """Return samples (m, 6) from home through all stops and back, and those of each dwell.

    Args:
        model: The robot with its tool.
        legs: Tool poses from each stop to the next.
        qs_legs: Joint angles of the legs.
        dwell_s: How long the robot stands still at each stop.
        clear: Maps joint angles (n, 6) to where nothing is touched.
    """
    parts, dwells = [clear_move(model, model.home_rad, qs_legs[0][0], clear)], []
    length = len(parts[0])
    for i in range(len(legs) + 1):
        q_stop = qs_legs[i][0] if i < len(legs) else qs_legs[-1][-1]
        stay = np.repeat(q_stop[None], int(np.ceil(dwell_s / SAMPLE_S - 1e-9)), axis=0)
        dwells.append((length - 1, length - 1 + len(stay)))
        leg = q_stop[None][:0]
        if i < len(legs):
            leg = _drive(model, legs[i], qs_legs[i])
            if not clear(leg).all():  # no measurement on the way
                leg = clear_move(model, leg[0], leg[-1], clear)
            leg = leg[1:]
        parts += [stay, leg]
        length += len(stay) + len(leg)
    parts.append(clear_move(model, qs_legs[-1][-1], model.home_rad, clear)[1:])
    starts, ends = np.array(dwells).T
    return np.concatenate(parts), starts, ends


def _upright(tip_base: Floats, facing_base: Floats) -> Pose:
    """Return the tip's pose with the tool pointing down and the marker plate (tip -x) facing."""
    level = np.array((facing_base[0], facing_base[1], 0.0))
    if np.linalg.norm(level) < 1e-6:
        raise InvalidInputError("facing_base must not be vertical")
    x_base = -level / np.linalg.norm(level)
    z_base = np.array((0.0, 0.0, -1.0))
    return Pose(np.column_stack((x_base, np.cross(z_base, x_base), z_base)), tip_base)


def _pivot_stops(center: Pose, cone_rad: float, count: int) -> list[Pose]:
    """Return tool poses about the fixed tip: tilts on a spiral that fills the cone evenly."""
    stops = []
    for i in range(count):
        tilt_rad = cone_rad * np.sqrt((i + 0.5) / (count - 0.5))
        azimuth_rad = i * GOLDEN_RAD
        twist_rad = TWIST_RAD * np.sin(0.5 * azimuth_rad)
        axis = (tilt_rad * np.cos(azimuth_rad), tilt_rad * np.sin(azimuth_rad), 0.0)
        stops.append(center @ Pose.from_rotvec(axis) @ Pose.from_rotvec((0.0, 0.0, twist_rad)))
    return stops


def _shift_stops(center: Pose, axis: int, length_mm: float, count: int) -> list[Pose]:
    """Return tool poses along tool x (0) or y (1), evenly spaced about the middle."""
    offsets = np.zeros((count, 3))
    offsets[:, axis] = np.linspace(-length_mm / 2.0, length_mm / 2.0, count)
    return [center @ Pose.from_translation(offset) for offset in offsets]


def _leg(start: Pose, end: Pose) -> Poses:
    """Return poses from one stop to the next: straight in position, evenly turning."""
    turn = Rotation.from_matrix(start.rotation.T @ end.rotation).as_rotvec()
    way_mm = max(
        float(np.linalg.norm(end.translation - start.translation)),
        TURN_WAY_MM * float(np.linalg.norm(turn)),
    )
    shares = np.linspace(0.0, 1.0, max(4, int(np.ceil(way_mm / DENSE_MM)) + 1))[:, None]
    rotations = start.rotation @ Rotation.from_rotvec(shares * turn).as_matrix()
    return Poses(rotations, start.translation + shares * (end.translation - start.translation))


def _reach(model: RobotModel, legs: list[Poses]) -> list[Floats]:
    """Return joint angles (m, 6) of each leg, all on one branch of the arm.

    Among the branches with nearly the largest margin it is the one closest to home.

    Raises:
        NotReachableError: no branch reaches all poses without a jump.
    """
    whole = Poses(
        np.concatenate([leg.rotations for leg in legs]),
        np.concatenate([leg.translations for leg in legs]),
    )
    found = compute_margins(model, whole @ model.T_flange_tip.inv(), MarginLimits())
    margins = found.least().min(axis=0)
    if margins.max() < 0.0:
        place = ", ".join(f"{value:.0f}" for value in legs[0].translations[0])
        raise NotReachableError(
            f"the arm cannot move the tool about ({place}) mm through all poses: choose another "
            f"place, another direction for the marker or a smaller cone"
        )
    detours = np.abs(found.qs_rad[0] - model.home_rad).max(axis=1)
    detours[margins < NEARLY * margins.max()] = np.inf
    branch = int(np.argmin(detours))
    cuts = np.cumsum([len(leg) for leg in legs])[:-1]
    return np.split(found.qs_rad[:, branch], cuts)


def _drive(model: RobotModel, leg: Poses, qs_rad: Floats) -> Floats:
    """Return samples (m, 6) of one leg, ``SAMPLE_S`` apart, from rest to rest."""
    markers = (leg @ model.T_flange_tip.inv() @ model.T_flange_toolmarker).translations
    way_mm = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(markers, axis=0), axis=1))))
    timed = parameterize_time(way_mm, qs_rad, markers, LEGS, model.limits)
    times = sample_times(timed.duration_s)
    ways = timed.way_at(times * (timed.duration_s / times[-1]))
    qs = timed.joints(ways)
    qs[0], qs[-1] = qs_rad[0], qs_rad[-1]
    return qs
