"""The certified motion of a scan with room along the tool axis, for the force loop to move in.

The band holds the joint angles of the certified motion at several corrections along the tool
axis. Execution interpolates inside it and stops at its edge, so what is executed has been checked.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from rona_core.devices.settings import ContactSettings
from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Bools, Floats, Ints, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.force_control.controller import MOST_MM_PER_S
from rona_core.robot.kinematics.arm import wrapped
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory, motion_digest
from rona_core.robot.verification.certificate import Certificate, Check, robot_digest

LEVELS = 5  # corrections at which the joint angles are kept, odd: the middle is the motion itself
NARROWEST_MM = 3.0  # with less, neither set point nor map error fits in
NARROWER_MM = 0.5
OFF_LINE_MM, OFF_LINE_RAD = 0.05, 0.004  # how straight the line before and after the path is
POSITION_MM, TILT_RAD = 0.02, 0.0005  # of the probe, from where the correction should bring it
STEP_RAD = float(np.deg2rad(10.0))
THINNING = 8  # every so many samples are looked at by the independent kinematics


@dataclass(frozen=True, slots=True, eq=False)
class CorrectionCorridor:
    """Joint angles of a motion for several corrections along the tool axis."""

    times_s: Floats  # (n,) of the certified motion
    travels_mm: Floats  # (m,) corrections, positive into the surface, symmetric about 0
    qs_rad: Floats  # (n, m, 6); outside ``guided`` all corrections are alike
    guided: Bools  # (n,) samples at which a correction may be made
    certificate: Certificate

    @property
    def travel_mm(self) -> float:
        """How far the correction may go either way."""
        return float(self.travels_mm[-1])


def correction_corridor(
    model: RobotModel,
    trajectory: Trajectory,
    settings: ContactSettings,
    world: CollisionWorld | None = None,
) -> CorrectionCorridor:
    """Return the widest band within the settings that holds, and its certificate.

    Args:
        model: The robot with its tool.
        trajectory: The certified motion of the scan.
        settings: How far the correction may go.
        world: Robot, tool and what stands around them; None: the robot alone.

    Raises:
        NotReachableError: not even the narrowest band holds; it says what stops it.
    """
    width_mm, refused = settings.travel_mm, ""
    while width_mm >= NARROWEST_MM - 1e-9 or not refused:
        band = band_is_safe(model, trajectory, width_mm, world)
        if band.certificate.certified:
            return band
        refused = "; ".join(check.sentence for check in band.certificate.failures())
        width_mm -= NARROWER_MM
    raise NotReachableError(
        f"the probe cannot be pressed on: a correction of ±{width_mm + NARROWER_MM:g} mm along "
        f"its axis is refused: {refused}"
    )


def band_is_safe(
    model: RobotModel,
    trajectory: Trajectory,
    width_mm: float,
    world: CollisionWorld | None = None,
) -> CorrectionCorridor:
    """Return the band of one width with a certificate that says whether it holds, and why not."""
    probes = model.forward(trajectory.qs_rad) @ model.T_flange_probe
    guided = straight_line(trajectory, probes)
    samples = np.flatnonzero(guided)
    band = _Band(
        model,
        samples,
        trajectory.times_s[samples],
        probes.select(samples),
        np.linspace(-width_mm, width_mm, LEVELS),
        np.repeat(trajectory.qs_rad[samples, None], LEVELS, axis=1),
    )
    reached = np.ones(len(samples), dtype=np.bool_)
    for level, travel_mm in enumerate(band.travels_mm):
        if level != LEVELS // 2:
            band.qs_rad[:, level], valid = _nearest(
                model, band.moved(travel_mm), trajectory.qs_rad[samples]
            )
            reached &= valid
    checks = [*_joint_checks(band, reached), *_probe_checks(band)]
    world = world or CollisionWorld(model)
    checks.append(_touch_check(band, world))
    qs = np.repeat(trajectory.qs_rad[:, None, :], LEVELS, axis=1)
    qs[samples] = band.qs_rad
    around, robot = world.obstacles.digest(), robot_digest(model)
    certificate = Certificate(
        model.name,
        all(check.holds for check in checks),
        tuple(checks),
        motion_digest(robot, trajectory.times_s, qs, around),
        robot,
        tolerances="",  # its checks have limits of their own
        obstacles=around,
    )
    return CorrectionCorridor(
        trajectory.times_s, readonly(band.travels_mm), readonly(qs), guided, certificate
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Band:
    """The guided part of a motion with its corrections."""

    model: RobotModel
    samples: Ints  # (k,) of the whole motion
    times_s: Floats  # (k,)
    probes: Poses  # (k,) where the motion has the probe
    travels_mm: Floats  # (m,)
    qs_rad: Floats  # (k, m, 6)

    def moved(self, travel_mm: float) -> Poses:
        """Return where the probe ought to be with a correction."""
        rotations = self.probes.rotations
        return Poses(rotations, self.probes.translations + travel_mm * rotations[:, :, 2])

    def joints(self, travel_mm: float) -> Floats:
        """Return joint angles (k, 6) with a correction, by the polynomial through the levels."""
        return BarycentricInterpolator(self.travels_mm, self.qs_rad, axis=1)(travel_mm)

    def looked_at(self) -> Floats:
        """Return all corrections and those halfway between, the motion itself first."""
        halfway = (self.travels_mm[1:] + self.travels_mm[:-1]) / 2.0
        corrections = np.concatenate((self.travels_mm, halfway))
        return corrections[np.argsort(np.abs(corrections), kind="stable")]


def straight_line(trajectory: Trajectory, probes: Poses) -> Bools:
    """Return which samples (n,) belong to the path or the straight lines before and after it."""
    times = trajectory.times_s
    first = int(np.searchsorted(times, trajectory.scan_start_s - 1e-9))
    last = int(np.searchsorted(times, trajectory.scan_end_s + 1e-9)) - 1
    before, after = _on_line(probes, first)[:first], _on_line(probes, last)[last + 1 :]
    path = np.ones(last + 1 - first, dtype=np.bool_)
    # only as far as the line goes without a gap
    reached_before = np.logical_and.accumulate(before[::-1])[::-1]
    return np.concatenate((reached_before, path, np.logical_and.accumulate(after)))


def _on_line(probes: Poses, end: int) -> Bools:
    """Return which poses (n,) lie on the line back along the probe axis of one of them."""
    axis = probes.rotations[end, :, 2]
    away = probes.translations - probes.translations[end]
    depth = away @ axis
    off = np.linalg.norm(away - depth[:, None] * axis, axis=1)
    turned = np.linalg.norm(np.cross(probes.rotations[:, :, 2], axis), axis=1)
    return (off < OFF_LINE_MM) & (turned < OFF_LINE_RAD) & (depth < OFF_LINE_MM)


def _nearest(model: RobotModel, Ts_base_probe: Poses, qs_rad: Floats) -> tuple[Floats, Bools]:
    """Return the solutions (n, 6) next to given joint angles, and where there is one."""
    found = model.inverse(Ts_base_probe @ model.T_flange_probe.inv())
    steps = wrapped(found.qs_rad - qs_rad[:, None, :])
    size = np.where(found.valid, np.abs(steps).max(axis=2), np.inf)
    best = np.argmin(size, axis=1)
    rows = np.arange(len(qs_rad))
    valid = np.isfinite(size[rows, best])
    return qs_rad + np.where(valid[:, None], steps[rows, best], 0.0), valid


def _joint_checks(band: _Band, reached: Bools) -> list[Check]:
    """Return the checks of the joints over the band."""
    model, sheet, samples = band.model, band.qs_rad, band.samples
    room = np.rad2deg(model.limits.clearance_rad(sheet).min(axis=(1, 2)))
    along, across = np.abs(np.diff(sheet, axis=0)), np.abs(np.diff(sheet, axis=1))
    steps = across.max(axis=(1, 2))
    steps[1:] = np.maximum(steps[1:], along.max(axis=(1, 2), initial=0.0))
    per_mm = across.max(axis=1) / (band.travels_mm[1] - band.travels_mm[0])
    speeds = along.max(axis=1) / np.diff(band.times_s)[:, None] + MOST_MM_PER_S * per_mm[1:]
    share = 100.0 * (speeds / model.speed_rad_per_s).max(axis=1)
    step_deg, largest_deg = np.rad2deg(steps), float(np.rad2deg(STEP_RAD))
    return [
        _check("poses of the band out of reach", ~reached, 0.0, "", samples),
        _check("lack of margin to the joint limits in the band", -room, 0.0, "°", samples),
        _check("joint step in the band", step_deg, largest_deg, "°", samples),
        _check("joint speed in the band", share, 100.0, "%", samples),
    ]


def _probe_checks(band: _Band) -> list[Check]:
    """Look by Pinocchio where the probe really is, at the corrections and between them."""
    some = slice(None, None, THINNING)
    arm, samples = PinocchioArm(band.model), band.samples[some]
    off, tilt = np.zeros((2, len(samples)))
    for travel_mm in band.looked_at():
        real = arm.tool(band.joints(travel_mm)[some], band.model.T_flange_probe)
        wanted = band.moved(travel_mm).select(some)
        off = np.maximum(off, np.linalg.norm(real.translations - wanted.translations, axis=1))
        turned = np.cross(real.rotations[:, :, 2], wanted.rotations[:, :, 2])
        tilt = np.maximum(tilt, np.linalg.norm(turned, axis=1))
    tilt_deg, largest_deg = np.rad2deg(tilt), float(np.rad2deg(TILT_RAD))
    return [
        _check("distance from the tool axis in the band", off, POSITION_MM, "mm", samples),
        _check("tilt in the band", tilt_deg, largest_deg, "°", samples),
    ]


def _touch_check(band: _Band, world: CollisionWorld) -> Check:
    """Look for collisions at every correction and halfway to the next; name the first found."""
    corrections = band.looked_at()
    sheets = np.stack([band.joints(travel_mm) for travel_mm in corrections])
    # first all that lie next to each other together, which is quicker to bound
    safe = world.first_hit(sheets.swapaxes(0, 1).reshape(-1, sheets.shape[2])) < 0
    for travel_mm, qs in () if safe else zip(corrections, sheets, strict=True):
        touching = world.first_hit(qs)
        if touching >= 0:
            pair = world.report(qs[touching][None]).closest_pair(0)
            name, index = "clearance in the band", int(band.samples[touching])
            sentence = (
                f"{name} fails: corrected by {travel_mm:g} mm, {pair.first} and {pair.second} are "
                f"{pair.apart_mm:.1f} mm apart at sample {index}, {pair.least_mm:.1f} mm must be "
                f"kept"
            )
            return Check(name, pair.apart_mm, pair.least_mm, "mm", index, False, sentence)
    return _check("samples that touch something in the band", np.zeros(1), 0.0, "", band.samples)


def _check(name: str, values: Floats | Bools, limit: float, unit: str, samples: Ints) -> Check:
    worst = int(np.argmax(values))
    value, index = float(values[worst]), int(samples[worst])
    holds = value <= limit + 1e-9
    words = f"{value:.4g} {unit}".rstrip()
    verdict = "holds" if holds else "fails"
    sentence = f"{name} {verdict}: {words} at sample {index}, {limit:.4g} allowed"
    return Check(name, value, limit, unit, index, holds, sentence)
