"""The certified motion of a scan with room along the tool axis, for the force loop to move in.

The band holds the joint angles of the certified motion at several corrections along the tool
axis. Execution interpolates inside it and stops at its edge, so what is executed has been checked.
"""

from dataclasses import dataclass

import numpy as np

from rona_core.devices.settings import ContactSettings
from rona_core.errors import NotReachableError
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.force_control.controller import MOST_MM_PER_S
from rona_core.robot.kinematics.joint_limits import TURN_RAD
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm
from rona_core.robot.kinematics.robot_model import RobotModel
from rona_core.robot.trajectory.trajectory import Trajectory, motion_digest
from rona_core.robot.verification.certificate import Certificate, Check

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
        world: Robot, tool and what stands around them; None looks at no collisions.

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
    travels = np.linspace(-width_mm, width_mm, LEVELS)
    probes = model.forward(trajectory.qs_rad) @ model.T_flange_probe
    guided = straight_line(trajectory, probes)
    qs = np.repeat(trajectory.qs_rad[:, None, :], LEVELS, axis=1)
    at = np.flatnonzero(guided)
    reached = np.ones(len(at), dtype=np.bool_)
    for level in range(LEVELS):
        if level != LEVELS // 2:
            moved = _moved(probes, at, float(travels[level]))
            qs[at, level], valid = _nearest(model, moved, trajectory.qs_rad[at])
            reached &= valid
    checks = _checks(model, trajectory, travels, qs, at, reached)
    checks += _placed_checks(model, trajectory, travels, qs, at, probes)
    if world is not None:
        checks.append(_touch_check(world, travels, qs, at))
    holds = all(check.holds for check in checks)
    around = "" if world is None else world.obstacles.digest()
    digest = motion_digest(model.name, trajectory.times_s, qs, around)
    certificate = Certificate(model.name, holds, tuple(checks), digest, obstacles=around)
    return CorrectionCorridor(
        trajectory.times_s, readonly(travels), readonly(qs), guided, certificate
    )


def straight_line(trajectory: Trajectory, probes: Poses) -> Bools:
    """Return which samples (n,) belong to the path or the straight lines before and after it."""
    times = trajectory.times_s
    first = int(np.searchsorted(times, trajectory.scan_start_s - 1e-9))
    last = int(np.searchsorted(times, trajectory.scan_end_s + 1e-9)) - 1
    guided = np.zeros(len(times), dtype=np.bool_)
    guided[first : last + 1] = True
    for end, samples in ((first, range(first - 1, -1, -1)), (last, range(last + 1, len(times)))):
        axis = probes.rotations[end, :, 2]
        away = probes.translations - probes.translations[end]
        depth = away @ axis
        off = np.linalg.norm(away - depth[:, None] * axis, axis=1)
        turned = np.linalg.norm(np.cross(probes.rotations[:, :, 2], axis), axis=1)
        straight = (off < OFF_LINE_MM) & (turned < OFF_LINE_RAD) & (depth < OFF_LINE_MM)
        for i in samples:
            if not straight[i]:
                break
            guided[i] = True
    return guided


def _moved(probes: Poses, at: np.typing.NDArray[np.int64], travel_mm: float) -> Poses:
    axes = probes.rotations[at, :, 2]
    return Poses(probes.rotations[at], probes.translations[at] + travel_mm * axes)


def _nearest(model: RobotModel, Ts_base_probe: Poses, qs_rad: Floats) -> tuple[Floats, Bools]:
    """Return the solutions (n, 6) next to given joint angles, and where there is one."""
    found = model.inverse(Ts_base_probe @ model.T_flange_probe.inv())
    steps = found.qs_rad - qs_rad[:, None, :]
    steps -= TURN_RAD * np.round(steps / TURN_RAD)
    size = np.where(found.valid, np.abs(steps).max(axis=2), np.inf)
    best = np.argmin(size, axis=1)
    rows = np.arange(len(qs_rad))
    valid = np.isfinite(size[rows, best])
    return qs_rad + np.where(valid[:, None], steps[rows, best], 0.0), valid


def _checks(
    model: RobotModel,
    trajectory: Trajectory,
    travels: Floats,
    qs: Floats,
    at: np.typing.NDArray[np.int64],
    reached: Bools,
) -> list[Check]:
    """Return the checks of the joints over the band."""
    sheet, times = qs[at], trajectory.times_s[at]
    room = np.rad2deg(model.limits.clearance_rad(sheet).min(axis=(1, 2)))
    jumps = np.abs(np.diff(sheet, axis=0)).max(axis=(1, 2), initial=0.0)
    across = np.abs(np.diff(sheet, axis=1))
    along = np.abs(np.diff(sheet, axis=0)).max(axis=1) / np.diff(times)[:, None]
    per_mm = across.max(axis=1) / (travels[1] - travels[0])
    share = (along + MOST_MM_PER_S * per_mm[1:]) / model.speed_rad_per_s
    steps = np.maximum(np.concatenate(([0.0], jumps)), across.max(axis=(1, 2)))
    return [
        _check("poses of the band out of reach", ~reached, 0.0, "", at),
        _check("lack of room to the joint limits in the band", -room, 0.0, "°", at),
        _check("joint step in the band", np.rad2deg(steps), float(np.rad2deg(STEP_RAD)), "°", at),
        _check("joint speed in the band", 100.0 * share.max(axis=1), 100.0, "%", at),
    ]


def _placed_checks(
    model: RobotModel,
    trajectory: Trajectory,
    travels: Floats,
    qs: Floats,
    at: np.typing.NDArray[np.int64],
    probes: Poses,
) -> list[Check]:
    """Look by Pinocchio where the probe really is, at the corrections and between them."""
    thin = at[::THINNING]
    between = (travels[1:] + travels[:-1]) / 2.0
    arm = PinocchioArm(model)
    off, tilt = np.zeros(len(thin)), np.zeros(len(thin))
    for travel in (*travels, *between):
        weights = interpolation_weights(travels, float(travel))
        real = arm.tool(np.einsum("m,nmj->nj", weights, qs[thin]), model.T_flange_probe)
        wanted = _moved(probes, thin, float(travel))
        off = np.maximum(off, np.linalg.norm(real.translations - wanted.translations, axis=1))
        turned = np.cross(real.rotations[:, :, 2], wanted.rotations[:, :, 2])
        tilt = np.maximum(tilt, np.linalg.norm(turned, axis=1))
    return [
        _check("distance from the tool axis in the band", off, POSITION_MM, "mm", thin),
        _check("tilt in the band", np.rad2deg(tilt), float(np.rad2deg(TILT_RAD)), "°", thin),
    ]


def _touch_check(
    world: CollisionWorld, travels: Floats, qs: Floats, at: np.typing.NDArray[np.int64]
) -> Check:
    """Look for collisions at every correction and halfway to the next; name the first found."""
    halfway = (travels[1:] + travels[:-1]) / 2.0
    for travel in sorted((*travels, *halfway), key=abs):  # the motion itself first
        weights = interpolation_weights(travels, float(travel))
        sheet = np.einsum("m,nmj->nj", weights, qs[at])
        touching = np.flatnonzero(~world.clear(sheet))
        if len(touching):
            first = int(touching[0])
            pair = world.report(sheet[first : first + 1]).closest_pair(0)
            name, index = "clearance in the band", int(at[first])
            sentence = (
                f"{name} fails: corrected by {travel:g} mm, {pair.first} and {pair.second} are "
                f"{pair.apart_mm:.1f} mm apart at sample {index}, {pair.least_mm:.1f} mm must be "
                f"kept"
            )
            return Check(name, pair.apart_mm, pair.least_mm, "mm", index, False, sentence)
    return _check("samples that touch something in the band", np.zeros(1), 0.0, "", at)


def interpolation_weights(travels_mm: Floats, travel_mm: float) -> Floats:
    """Return weights (m,) of the polynomial through values at some corrections, at another."""
    weights = np.ones(len(travels_mm))
    for i, own in enumerate(travels_mm):
        others = np.delete(travels_mm, i)
        weights[i] = np.prod((travel_mm - others) / (own - others))
    return weights


def _check(
    name: str,
    values: Floats | Bools,
    limit: float,
    unit: str,
    samples: np.typing.NDArray[np.int64],
) -> Check:
    worst = int(np.argmax(values))
    value, index = float(values[worst]), int(samples[min(worst, len(samples) - 1)])
    holds = value <= limit + 1e-9
    said = f"{value:.4g} {unit}".rstrip()
    verdict = "holds" if holds else "fails"
    sentence = f"{name} {verdict}: {said} at sample {index}, {limit:.4g} allowed"
    return Check(name, value, limit, unit, index, holds, sentence)
