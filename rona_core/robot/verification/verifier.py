"""Verification of a finished motion, independent of how it was planned.

Forward kinematics come from Pinocchio, at four times the density of the motion, linear in between
as the robot drives it. What it certifies may be executed, nothing else may. See
docs/algorithms/robot/verification_and_timing.md.

Verification of a cutting motion: as any motion, and that the burr cuts only along its path. The tip
follows the path at its feeds, the burr never goes below the planned floor, it goes sideways in the
air over the bone only, and after every part the way home is the certified one. See
docs/algorithms/implant/robot_milling.md.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import (
    BurrPlaces,
    CuttingPath,
    TimedMotion,
    Trajectory,
    motion_digest,
)
from rona_core.robot.verification.certificate import Certificate, Check, robot_digest
from rona_core.robot.verification.motion_checks import (
    DenseMotion,
    check,
    clearance,
    dense_motion,
    joint_checks,
    per_sample,
    singular_checks,
    tool_checks,
)
from rona_core.robot.verification.tolerances import (
    DENSITY,
    EXACT,
    EXCESS,
    NEAR_MM,
    SAME_MM,
    SIDEWAYS_MM,
    CuttingTolerances,
    Tolerances,
    tolerances_digest,
)


def verify_motion(
    model: RobotModel,
    motion: TimedMotion,
    tolerances: Tolerances | None = None,
    obstacles: Obstacles | None = None,
) -> Certificate:
    """Certify any motion: joints, the way of the tool and collisions, from rest to rest.

    Args:
        model: The robot with its tool.
        motion: Joint angles in time; linear in between.
        tolerances: What to insist on.
        obstacles: What stands around; None: only the robot itself is looked at, which certifies
            nothing.

    Raises:
        InvalidInputError: arrays of the wrong shape, or values that are not finite.
    """
    allowed = tolerances or Tolerances()
    return certify(model, motion, allowed, tolerances_digest(allowed), obstacles, lambda _: [])


def verify_scan(
    model: RobotModel,
    trajectory: Trajectory,
    path: Path5D,
    roll_rad: float | Floats,
    scan_speed_mm_per_s: float,
    tolerances: Tolerances | None = None,
    obstacles: Obstacles | None = None,
) -> Certificate:
    """Certify the motion of a scan: as ``verify_motion``, and that it follows the path.

    Args:
        model: The robot with its tool.
        trajectory: The motion with the way along the path that it claims at each sample.
        path: The 5D path in ``base`` that the probe is to follow.
        roll_rad: Roll about the probe axis, from the transported reference of the path: one for
            all, or one for each path point (n,).
        scan_speed_mm_per_s: Speed along the path that was asked for.
        tolerances: What to insist on.
        obstacles: What stands around; None: only the robot itself is looked at, which certifies
            nothing.

    Raises:
        InvalidInputError: arrays of the wrong shape, or values that are not finite.
    """
    allowed = tolerances or Tolerances()

    def scan_checks(dense: DenseMotion) -> list[Check]:
        scan = _scan_part(trajectory, dense)
        return [
            *_path_checks(scan, path, roll_rad, allowed),
            *_speed_checks(scan, trajectory, path, scan_speed_mm_per_s, allowed),
            *singular_checks(dense.arm, scan.qs_rad, scan.first, allowed),
            _dip_check(trajectory, dense, path, allowed),
        ]

    insisted = tolerances_digest(allowed)
    return certify(model, trajectory, allowed, insisted, obstacles, scan_checks)


def certify(
    model: RobotModel,
    motion: TimedMotion,
    allowed: Tolerances,
    insisted: str,
    obstacles: Obstacles | None,
    task_checks: Callable[[DenseMotion], list[Check]],
) -> Certificate:
    """Return the certificate of a motion: joints, tool, what its task asks for, and collisions.

    Where time runs backwards the joints alone are looked at: there are no speeds to speak of.
    Clearance is looked at where all else holds. The robot is always held against itself; a motion
    is certified among known obstacles alone.
    ``insisted`` is the digest of the tolerances, those of the task included.
    """
    checks = joint_checks(model, motion, allowed)
    least_mm = None
    if checks[0].holds:
        dense = dense_motion(model, motion)
        checks += tool_checks(dense, allowed)
        checks += task_checks(dense)
        if all(one.holds for one in checks):  # the dearest comes last
            found, least_mm = clearance(model, dense, obstacles or NOTHING_AROUND)
            checks += found
    if obstacles is None:
        checks.append(_not_checked(len(motion.times_s)))
    around = "" if obstacles is None else obstacles.digest()
    robot = robot_digest(model)
    return Certificate(
        model=model.name,
        certified=all(check.holds for check in checks),
        checks=tuple(checks),
        digest=motion_digest(robot, motion.times_s, motion.qs_rad, around, insisted),
        robot=robot,
        tolerances=insisted,
        obstacles=around,
        min_clearance_mm=least_mm,
    )


def _not_checked(n_samples: int) -> Check:
    """Return the check that fails where the surroundings were not given."""
    sentence = (
        "collision: not checked with anything but the robot itself: give the obstacles that stand "
        "around, NOTHING_AROUND where there are none"
    )
    return Check("collision", 0.0, float(n_samples), "samples", 0, False, sentence)


@dataclass(frozen=True, slots=True, eq=False)
class _Scan:
    """The part of a motion in which the probe scans, at four times its density."""

    first: int  # sample of the whole motion
    poses: Poses  # Ts_base_probe (m,)
    qs_rad: Floats  # (m, 6)
    times_s: Floats  # (m,)
    way_mm: Floats  # (m,) along the path, as claimed


def _scan_part(trajectory: Trajectory, dense: DenseMotion) -> _Scan:
    times = trajectory.times_s
    inside = np.flatnonzero(
        (times >= trajectory.scan_start_s - EXACT) & (times <= trajectory.scan_end_s + EXACT)
    )
    if len(inside) < 2:
        raise InvalidInputError("the trajectory has no scan: scan_end_s must follow scan_start_s")
    first, last = int(inside[0]), int(inside[-1])
    rows = slice(first * DENSITY, last * DENSITY + 1)
    return _Scan(
        first=first,
        poses=Poses(dense.rotations[rows], dense.places_base[rows]),
        qs_rad=dense.qs_rad[rows],
        times_s=dense.times_s[rows],
        way_mm=np.interp(dense.numbers[rows], np.arange(len(times)), trajectory.path_mm),
    )


def _expected(path: Path5D, way_mm: Floats, roll_rad: float | Floats) -> Poses:
    """Return where the probe ought to be at ways (m,) along the path, by interpolation."""
    steps = np.linalg.norm(np.diff(path.points_base, axis=0), axis=1)
    places = np.concatenate(([0.0], np.cumsum(steps)))
    i = np.clip(np.searchsorted(places, way_mm, side="right") - 1, 0, max(0, len(path) - 2))
    j = np.minimum(i + 1, len(path) - 1)
    length = np.maximum(places[j] - places[i], EXACT)
    share = np.clip((way_mm - places[i]) / length, 0.0, 1.0)[:, None]
    points = path.points_base[i] * (1 - share) + path.points_base[j] * share
    frames = path.Ts_base_probe(roll_rad).rotations
    mixed = frames[i] * (1 - share[:, None]) + frames[j] * share[:, None]
    z = mixed[:, :, 2] / np.linalg.norm(mixed[:, :, 2], axis=1, keepdims=True)
    x = mixed[:, :, 0] - np.einsum("ij,ij->i", mixed[:, :, 0], z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return Poses(np.stack((x, np.cross(z, x), z), axis=2), points)


def _path_checks(
    scan: _Scan, path: Path5D, roll_rad: float | Floats, allowed: Tolerances
) -> list[Check]:
    wanted = _expected(path, scan.way_mm, roll_rad)
    position = np.linalg.norm(scan.poses.translations - wanted.translations, axis=1)
    turned = np.swapaxes(wanted.rotations, 1, 2) @ scan.poses.rotations
    axis = np.rad2deg(np.arctan2(np.hypot(turned[:, 0, 2], turned[:, 1, 2]), turned[:, 2, 2]))
    roll = np.rad2deg(
        np.abs(np.arctan2(turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1]))
    )
    limits = (allowed.position_mm, *np.rad2deg((allowed.axis_rad, allowed.roll_rad)))
    return [
        check(name, per_sample(values), float(limit), unit, first=scan.first)
        for name, values, limit, unit in (
            ("distance from the path", position, limits[0], "mm"),
            ("tilt of the probe", axis, limits[1], "°"),
            ("roll of the probe", roll, limits[2], "°"),
        )
    ]


def _speed_checks(
    scan: _Scan,
    trajectory: Trajectory,
    path: Path5D,
    scan_speed_mm_per_s: float,
    allowed: Tolerances,
) -> list[Check]:
    way, gaps = trajectory.path_mm, np.diff(trajectory.times_s)
    total = float(np.linalg.norm(np.diff(path.points_base, axis=0), axis=1).sum())
    missing = np.array((abs(scan.way_mm[0]), abs(total - scan.way_mm[-1])))
    fastest = scan_speed_mm_per_s * (1.0 + allowed.speed_excess)
    uneven = scan_speed_mm_per_s * (1.0 + allowed.uneven_excess)
    places = scan.poses.translations
    ends = places[::DENSITY]
    between = np.diff(scan.times_s[::DENSITY])
    mean = np.linalg.norm(np.diff(ends, axis=0), axis=1) / between
    speed = np.linalg.norm(np.diff(places, axis=0), axis=1) / np.diff(scan.times_s)
    acceleration = np.zeros(1)
    if len(places) > 2 * DENSITY:
        speeds = np.diff(ends, axis=0) / between[:, None]
        spans = (between[1:] + between[:-1]) / 2.0
        acceleration = np.linalg.norm(np.diff(speeds, axis=0), axis=1) / spans
    probe = "speed of the probe"
    most = allowed.path_acceleration_mm_per_s2 * (1.0 + EXCESS)
    return [
        check("scan speed", np.diff(way) / gaps, fastest, "mm/s", first=1),
        check(probe, mean, fastest, "mm/s", first=scan.first + 1),
        check(f"{probe} between samples", per_sample(speed), uneven, "mm/s", first=scan.first),
        check("acceleration of the probe", acceleration, most, "mm/s²", first=scan.first + 1),
        check("step back along the path", -np.diff(way), 0.0, "mm", first=1),
        check("part of the path left out", missing, allowed.position_mm, "mm"),
    ]


def _dip_check(
    trajectory: Trajectory, dense: DenseMotion, path: Path5D, allowed: Tolerances
) -> Check:
    """Look whether the probe dips into the bone near the path while approaching or leaving."""
    times = dense.times_s
    outside = (times <= trajectory.scan_start_s) | (times >= trajectory.scan_end_s)
    tips_base = dense.places_base[outside]
    distance, nearest = KDTree(path.points_base).query(tips_base)
    rays = tips_base - path.points_base[nearest]
    depth = np.einsum("ij,ij->i", rays, path.axes_base[nearest])
    depth = np.where(distance < NEAR_MM, depth, -NEAR_MM)
    values = np.full(len(times), -NEAR_MM)
    values[outside] = depth
    return check("dip into the bone off the path", per_sample(values), allowed.dip_mm, "mm")


def verify_cutting(
    model: RobotModel,
    trajectory: Trajectory,
    path: CuttingPath,
    tolerances: CuttingTolerances | None = None,
    obstacles: Obstacles | None = None,
) -> Certificate:
    """Certify the motion of a burr: as ``verify_motion``, and that it cuts along the path.

    Args:
        model: The robot with its spindle.
        trajectory: The motion with the way along the path that it claims at each sample.
        path: What the burr is to follow, and where it rests.
        tolerances: What to insist on.
        obstacles: What stands around; None: only the robot itself is looked at, which certifies
            nothing.

    Raises:
        InvalidInputError: arrays of the wrong shape, or values that are not finite.
    """
    allowed = tolerances or CuttingTolerances()

    def cutting_checks(dense: DenseMotion) -> list[Check]:
        claim = _Claim(trajectory, dense, path)
        complete = _completeness_checks(claim, allowed)
        if not all(one.holds for one in complete):  # the planned place of the burr is unknown
            return complete
        return [
            *complete,
            *_place_checks(claim, allowed),
            *_feed_checks(claim, allowed),
            *_rest_checks(model, claim, allowed),
            *_singular_checks(dense, claim, allowed),
        ]

    insisted = tolerances_digest(allowed)
    return certify(model, trajectory, allowed.motion, insisted, obstacles, cutting_checks)


class _Claim:
    """What a motion says of its way along the path, and where the burr really is."""

    def __init__(self, trajectory: Trajectory, dense: DenseMotion, path: CuttingPath) -> None:
        self.path, self.times_s, self.qs_rad = path, trajectory.times_s, trajectory.qs_rad
        self.way_mm = trajectory.path_mm  # (n,)
        self.rests_mm = path.way_mm()[path.rests]
        samples = np.arange(len(trajectory.times_s))
        self.dense_way_mm: Floats = np.interp(dense.numbers, samples, trajectory.path_mm)
        self.moves = path.moves_at(self.dense_way_mm)  # (m,) that are under way
        self.away = self._away()  # (m,)
        T_bed_base = path.T_base_bed.inv()
        self.tips_bed = T_bed_base @ dense.places_base
        self.axes_bed = T_bed_base.rotate(dense.rotations[:, :, 2])
        behind = path.radii_mm[self.moves][:, None] * (self.axes_bed + (0.0, 0.0, 1.0))
        self.bottoms_bed = self.tips_bed - behind

    def _away(self) -> Bools:
        """Return where it is on its way from home or back: its claim stays at such a rest."""
        homes = np.concatenate(([True], self.path.changes()[1:-1], [True]))
        stays = np.diff(self.way_mm) == 0.0
        at_home = np.abs(self.way_mm[:-1, None] - self.rests_mm[homes]).min(axis=1) <= SAME_MM
        return np.append(np.repeat(stays & at_home, DENSITY), True)


def _completeness_checks(claim: _Claim, allowed: CuttingTolerances) -> list[Check]:
    way, total = claim.way_mm, claim.rests_mm[-1]
    missing = np.array((abs(way[0]), abs(total - way[-1])))
    unrested = np.array([np.abs(way - rest).min() for rest in claim.rests_mm])
    return [
        check("step back along the path", -np.diff(way), 0.0, "mm", first=1),
        check("part of the path left out", missing, SAME_MM, "mm"),
        check("rest left out", unrested, SAME_MM, "mm"),
        check("way between samples", np.diff(way), allowed.way_mm, "mm", first=1),
    ]


def _place_checks(claim: _Claim, allowed: CuttingTolerances) -> list[Check]:
    """Check where the burr is: on its path, not below it, over the bone in the air and away."""
    path, away = claim.path, claim.away
    wanted: BurrPlaces = path.at(claim.dense_way_mm)
    off = np.linalg.norm(claim.tips_bed - wanted.tips_bed, axis=1)
    below = wanted.bottoms_bed[:, 2] - claim.bottoms_bed[:, 2]
    below = np.where(path.in_air[claim.moves], 0.0, below)
    cosines = np.einsum("ij,ij->i", claim.axes_bed, wanted.axes_bed)
    tilt = np.rad2deg(np.arccos(np.clip(cosines, -1.0, 1.0)))
    steps = np.diff(path.bottoms_bed[:, :2], axis=0, prepend=path.bottoms_bed[:1, :2])
    sideways = path.in_air & (np.linalg.norm(steps, axis=1) > SIDEWAYS_MM)
    over = claim.bottoms_bed[:, 2] - path.surface_mm
    over = np.where(sideways[claim.moves] & ~away, over, NEAR_MM)
    rest = path.at(np.zeros(1))
    near = np.linalg.norm(claim.tips_bed - rest.tips_bed, axis=1) < NEAR_MM
    dip = np.where(away & near, rest.bottoms_bed[0, 2] - claim.bottoms_bed[:, 2], -NEAR_MM)
    return [
        check(name, per_sample(np.where(away, 0.0, values)), limit, unit)
        for name, values, limit, unit in (
            ("distance of the tip from the path", off, allowed.position_mm, "mm"),
            ("burr below the planned floor", below, allowed.below_mm, "mm"),
            ("tilt of the burr", tilt, float(np.rad2deg(allowed.axis_rad)), "°"),
        )
    ] + [
        check("height over the bone in the air", -per_sample(-over), 0.0, "mm", least=True),
        check("dip towards the bone off the path", per_sample(dip), allowed.motion.dip_mm, "mm"),
    ]


def _feed_checks(claim: _Claim, allowed: CuttingTolerances) -> list[Check]:
    """Check that each stretch takes at least as long as the feeds of its moves say, in percent."""
    path, gaps = claim.path, np.diff(claim.times_s)
    places_mm = path.way_mm()
    least_s = np.diff(places_mm) / path.feeds_mm_per_s[1:]
    least_s = np.interp(claim.way_mm, places_mm, np.concatenate(([0.0], np.cumsum(least_s))))
    way, least = np.diff(claim.way_mm), np.diff(least_s)
    slowest = np.full(len(way), 1.0 / path.feeds_mm_per_s.min())
    pace = np.divide(least, way, out=slowest, where=way > SAME_MM)  # s a mm
    tips = claim.tips_bed[::DENSITY]
    moved = np.linalg.norm(np.diff(tips, axis=0), axis=1)
    real = np.where(claim.away[:-1:DENSITY], 0.0, moved * pace / gaps)
    most = 100.0 * (1.0 + allowed.feed_excess)
    speeds = np.diff(tips, axis=0) / gaps[:, None]
    spans = (gaps[1:] + gaps[:-1]) / 2.0
    both_on = ~claim.away[:-1:DENSITY][1:] & ~claim.away[:-1:DENSITY][:-1]
    gains = np.where(both_on, np.linalg.norm(np.diff(speeds, axis=0), axis=1) / spans, 0.0)
    fastest = allowed.motion.path_acceleration_mm_per_s2 * (1.0 + EXCESS)
    return [
        check("feed along the path", 100.0 * least / gaps, most, "%", first=1),
        check("feed of the burr", 100.0 * real, most, "%", first=1),
        check("acceleration of the burr", gains, fastest, "mm/s²", first=1),
    ]


def _singular_checks(dense: DenseMotion, claim: _Claim, allowed: CuttingTolerances) -> list[Check]:
    """Check how far the arm stays from losing a freedom, from where it begins to where it ends."""
    on = np.flatnonzero(~claim.away)
    first, last = int(on[0]) // DENSITY, int(on[-1]) // DENSITY + 1
    rows = dense.qs_rad[first * DENSITY : last * DENSITY + 1]
    away = claim.away[first * DENSITY : last * DENSITY + 1]
    rows = np.where(away[:, None], dense.qs_rad[on[0]], rows)  # what is away counts no more
    return singular_checks(dense.arm, rows, first, allowed.motion)


def _rest_checks(model: RobotModel, claim: _Claim, allowed: CuttingTolerances) -> list[Check]:
    """Check that the motion can end at every rest, and go home from there as it does at its end."""
    rows: Ints = np.searchsorted(claim.way_mm, claim.rests_mm - SAME_MM)  # where it arrives
    rows[0] = np.searchsorted(claim.way_mm, claim.rests_mm[0] + SAME_MM) - 1  # where it begins
    leaves = claim.qs_rad[rows[-1]]
    apart = np.rad2deg(np.abs(claim.qs_rad[rows] - leaves).max(axis=1))
    speeds = np.abs(np.diff(claim.qs_rad, axis=0)) / np.diff(claim.times_s)[:, None]
    share = speeds / model.acceleration_rad_per_s2 / np.diff(claim.times_s)[:, None]
    stops = 100.0 * np.append(share[rows[1:] - 1], share[rows[1:-1]], axis=0).max(axis=1)
    most = float(np.rad2deg(allowed.posture_rad)) + EXACT
    return [
        check("rest from where the way home begins", apart, most, "°"),
        check("joint acceleration at a rest", stops, 100.0 * (1.0 + EXCESS), "%"),
    ]
