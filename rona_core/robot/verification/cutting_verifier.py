"""Verification of a cutting motion: as any motion, and that the burr cuts only along its path.

The tip follows the path at its feeds, the burr never goes below the planned floor, it goes sideways
in the air over the bone only, and after every part the way home is the certified one. See
docs/algorithms/implant/robot_milling.md.
"""

import numpy as np

from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.cutting_path import BurrPlaces, CuttingPath
from rona_core.robot.trajectory.trajectory import Trajectory
from rona_core.robot.verification.certificate import Certificate, Check
from rona_core.robot.verification.motion_checks import (
    DenseMotion,
    check,
    per_sample,
    singular_checks,
)
from rona_core.robot.verification.tolerances import (
    DENSITY,
    EXACT,
    EXCESS,
    NEAR_MM,
    SAME_MM,
    SIDEWAYS_MM,
    CuttingTolerances,
    tolerances_digest,
)
from rona_core.robot.verification.verifier import certify


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
