"""The verifier: looks at a finished motion, knows nothing of how it was planned.

Forward kinematics come from Pinocchio, at four times the density of the motion, linear in between
as the robot drives it. What it certifies may be executed, nothing else may. See
docs/algorithms/verification_and_timing.md.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from rona_core.arrays import Floats, as_floats
from rona_core.devices.settings import require
from rona_core.errors import InvalidInputError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.arm import as_joints
from rona_core.robot.model import RobotModel
from rona_core.robot.pinocchio_model import PinocchioArm
from rona_core.robot.plan import Certificate, Check, TimedMotion, Trajectory, motion_digest

DENSITY = 4  # poses looked at for each sample of the motion
EXACT = 1e-9  # rounding that is forgiven
SHORTEST_S = 1e-4  # least time between samples
NEAR_MM = 60.0  # within this of a path point, the tip must stay outside the bone


@dataclass(frozen=True, slots=True)
class Tolerances:
    """What the verifier insists on."""

    step_rad: float = float(np.deg2rad(10.0))  # largest joint step between samples
    position_mm: float = 0.3  # of the probe face from the path
    axis_rad: float = float(np.deg2rad(0.5))  # of the probe axis from that of the path
    roll_rad: float = float(np.deg2rad(0.5))  # about the probe axis
    singular_rad: float = float(np.deg2rad(4.9))  # of elbow and wrist from straight, on the path
    shoulder_mm: float = 29.0  # of the wrist centre from axis 1, on the path
    speed_excess: float = 0.01  # over the scan speed that was asked for
    dip_mm: float = 0.5  # into the bone while approaching or leaving

    def __post_init__(self) -> None:
        for name in self.__slots__:
            require(getattr(self, name) > 0.0, f"{name} must be positive")


def verify_motion(
    model: RobotModel, motion: TimedMotion, tolerances: Tolerances | None = None
) -> Certificate:
    """Certify any motion: joint limits, steps, speeds and accelerations, from rest to rest.

    Raises:
        InvalidInputError: arrays of the wrong shape, or values that are not finite.
    """
    return _certificate(model, motion, _joint_checks(model, motion, tolerances or Tolerances()))


def verify_scan(
    model: RobotModel,
    trajectory: Trajectory,
    path: Path5D,
    roll_rad: Floats | float,
    scan_speed_mm_per_s: float,
    tolerances: Tolerances | None = None,
) -> Certificate:
    """Certify the motion of a scan: as ``verify_motion``, and that it follows the path.

    Args:
        model: The robot with its tool.
        trajectory: The motion with the way along the path that it claims at each sample.
        path: The 5D path in ``base`` that the probe is to follow.
        roll_rad: Roll about the probe axis, from the transported reference of the path; one for
            all of it, or one at each of its points (n,).
        scan_speed_mm_per_s: Speed along the path that was asked for.
        tolerances: What to insist on.

    Raises:
        InvalidInputError: arrays of the wrong shape, or values that are not finite.
    """
    allowed = tolerances or Tolerances()
    checks = _joint_checks(model, trajectory, allowed)
    if checks[0].holds:  # time runs forwards, so that there are speeds to speak of
        arm = PinocchioArm(model)
        checks += _path_checks(model, arm, trajectory, path, roll_rad, allowed)
        checks += _speed_checks(trajectory, path, scan_speed_mm_per_s, allowed)
        checks += _singular_checks(arm, trajectory, allowed)
        checks.append(_dip_check(model, arm, trajectory, path, allowed))
    return _certificate(model, trajectory, checks)


def _certificate(model: RobotModel, motion: TimedMotion, checks: list[Check]) -> Certificate:
    holds = all(check.holds for check in checks)
    return Certificate(model.name, holds, tuple(checks), motion_digest(model.name, motion))


def _check(
    name: str, values: Floats, limit: float, unit: str, *, least: bool = False, first: int = 0
) -> Check:
    """Return a check that no value exceeds the limit (or, with ``least``, none falls below it)."""
    worst = int(np.argmin(values) if least else np.argmax(values))
    value = float(values[worst])
    holds = bool(value >= limit - EXACT if least else value <= limit + EXACT)
    relation = ("at least" if least else "at most") + f" {limit:.4g} {unit}".rstrip()
    verdict = "holds" if holds else "fails"
    index = first + worst
    sentence = f"{name} {verdict}: {value:.4g} {unit} at sample {index}, {relation} is allowed"
    return Check(name, value, float(limit), unit, index, holds, sentence)


def _joint_checks(model: RobotModel, motion: TimedMotion, allowed: Tolerances) -> list[Check]:
    qs, times = as_joints(motion.qs_rad), as_floats(motion.times_s, name="times_s")
    if times.shape != (len(qs),) or len(qs) < 2:
        raise InvalidInputError(f"a motion needs 2 samples with a time each, not {times.shape}")
    gaps = np.diff(times)
    order = _check("time between samples", gaps, SHORTEST_S, "s", least=True)
    room = np.rad2deg(np.minimum(qs - model.lower_rad, model.upper_rad - qs).min(axis=1))
    steps = np.rad2deg(np.abs(np.diff(qs, axis=0)).max(axis=1))
    checks = [
        order,
        _check("room to the joint limits", room, 0.0, "°", least=True),
        _check("joint step", steps, float(np.rad2deg(allowed.step_rad)), "°", first=1),
    ]
    if not order.holds:
        return checks  # speeds mean nothing
    speeds = np.diff(qs, axis=0) / gaps[:, None]
    resting = np.vstack((np.zeros(6), speeds, np.zeros(6)))  # at rest before and afterwards
    spans = np.concatenate((gaps[:1], (gaps[1:] + gaps[:-1]) / 2.0, gaps[-1:]))
    accelerations = np.diff(resting, axis=0) / spans[:, None]
    speed_share = 100.0 * (np.abs(speeds) / model.speed_rad_per_s).max(axis=1)
    share = 100.0 * (np.abs(accelerations) / model.acceleration_rad_per_s2).max(axis=1)
    checks.append(_check("joint speed", speed_share, 100.0, "%", first=1))
    checks.append(_check("joint acceleration", share, 100.0, "%"))
    return checks


def _dense(trajectory: Trajectory) -> tuple[Floats, Floats, Floats]:
    """Return the scan part of the motion at four times its density: joints, way, sample number."""
    times = trajectory.times_s
    inside = np.flatnonzero(
        (times >= trajectory.scan_start_s - EXACT) & (times <= trajectory.scan_end_s + EXACT)
    )
    if len(inside) < 2:
        raise InvalidInputError("the trajectory has no scan: scan_end_s must follow scan_start_s")
    first, last = int(inside[0]), int(inside[-1])
    numbers = np.arange(first * DENSITY, last * DENSITY + 1) / DENSITY
    samples = np.arange(len(times))
    columns = [np.interp(numbers, samples, q) for q in trajectory.qs_rad.T]
    return np.stack(columns, axis=1), np.interp(numbers, samples, trajectory.path_mm), numbers


def _expected(path: Path5D, way_mm: Floats, roll_rad: Floats | float) -> Poses:
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
    model: RobotModel,
    arm: PinocchioArm,
    trajectory: Trajectory,
    path: Path5D,
    roll_rad: Floats | float,
    allowed: Tolerances,
) -> list[Check]:
    qs, way, numbers = _dense(trajectory)
    first = int(numbers[0])
    real = arm.tool(qs, model.T_flange_probe)
    wanted = _expected(path, way, roll_rad)
    position = np.linalg.norm(real.translations - wanted.translations, axis=1)
    turned = np.swapaxes(wanted.rotations, 1, 2) @ real.rotations
    axis = np.rad2deg(np.arctan2(np.hypot(turned[:, 0, 2], turned[:, 1, 2]), turned[:, 2, 2]))
    roll = np.rad2deg(
        np.abs(np.arctan2(turned[:, 1, 0] - turned[:, 0, 1], turned[:, 0, 0] + turned[:, 1, 1]))
    )
    limits = (allowed.position_mm, *np.rad2deg((allowed.axis_rad, allowed.roll_rad)))
    checks: list[Check] = []
    for name, values, limit, unit in (
        ("distance from the path", position, limits[0], "mm"),
        ("tilt of the probe", axis, limits[1], "°"),
        ("roll of the probe", roll, limits[2], "°"),
    ):
        checks.append(_check(name, _per_sample(values), float(limit), unit, first=first))
    return checks


def _per_sample(dense: Floats) -> Floats:
    """Return the worst of the dense values that follow each sample."""
    return np.maximum.reduceat(dense, np.arange(0, len(dense), DENSITY))


def _speed_checks(
    trajectory: Trajectory, path: Path5D, scan_speed_mm_per_s: float, allowed: Tolerances
) -> list[Check]:
    way, gaps = trajectory.path_mm, np.diff(trajectory.times_s)
    total = float(np.linalg.norm(np.diff(path.points_base, axis=0), axis=1).sum())
    claimed = _dense(trajectory)[1]
    missing = np.array((abs(claimed[0]), abs(total - claimed[-1])))
    fastest = scan_speed_mm_per_s * (1.0 + allowed.speed_excess)
    return [
        _check("scan speed", np.diff(way) / gaps, fastest, "mm/s", first=1),
        _check("step back along the path", -np.diff(way), 0.0, "mm", first=1),
        _check("part of the path left out", missing, allowed.position_mm, "mm"),
    ]


def _singular_checks(arm: PinocchioArm, trajectory: Trajectory, allowed: Tolerances) -> list[Check]:
    qs, _, numbers = _dense(trajectory)
    wrist, elbow, shoulder_mm = arm.singular_margins(qs[::DENSITY])
    least, first = float(np.rad2deg(allowed.singular_rad)), int(numbers[0])
    angles = (np.rad2deg(np.arcsin(np.clip(sine, 0.0, 1.0))) for sine in (wrist, elbow))
    checks = [
        _check(f"{name} from straight", angle, least, "°", least=True, first=first)
        for name, angle in zip(("wrist", "elbow"), angles, strict=True)
    ]
    distance = ("wrist from axis 1", shoulder_mm, allowed.shoulder_mm, "mm")
    checks.append(_check(*distance, least=True, first=first))
    return checks


def _dip_check(
    model: RobotModel,
    arm: PinocchioArm,
    trajectory: Trajectory,
    path: Path5D,
    allowed: Tolerances,
) -> Check:
    """Look whether the probe dips into the bone near the path while approaching or leaving."""
    times = trajectory.times_s
    outside = (times <= trajectory.scan_start_s) | (times >= trajectory.scan_end_s)
    tips_base = arm.tool(trajectory.qs_rad[outside], model.T_flange_probe).translations
    distance, nearest = KDTree(path.points_base).query(tips_base)
    rays = tips_base - path.points_base[nearest]
    depth = np.einsum("ij,ij->i", rays, path.axes_base[nearest])
    depth = np.where(distance < NEAR_MM, depth, -NEAR_MM)
    values = np.full(len(times), -NEAR_MM)
    values[outside] = depth
    return _check("dip into the bone off the path", values, allowed.dip_mm, "mm")
