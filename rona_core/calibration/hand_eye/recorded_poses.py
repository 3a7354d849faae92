"""Hand-eye calibration from poses recorded elsewhere: sensor on the robot, or beside it.

A robot moves either the sensor (eye-in-hand) or a marker (eye-to-hand); both are the equation of
``hand_eye.py``, for eye-in-hand with the robot's poses inverted. How large the errors of the sensor
are, nothing says: deviations of turn and shift, along its axis and across, are estimated from the
residuals as variance components (Förstner 2016), and so is the point of the marker
about which turn and shift err independently (its centroid; the origin may be a corner). Those of a
camera grow with the distance, its depth with the square.
"""

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from rona_core.calibration.hand_eye.hand_eye import (
    DOF,
    MIN_POSES,
    UNKNOWNS,
    HandEyeFit,
    Observations,
    first_guess,
    jacobians,
    refine,
    residuals,
)
from rona_core.calibration.hand_eye.hand_eye_convention import require_convention
from rona_core.calibration.hand_eye.quality import (
    GOOD_TURN_DEG,
    MAX_REJECTED,
    in_words,
    registration_sigma_mm,
    require_two_axes,
    turns_deg,
)
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import cross_matrices, rotation_vectors

Setup = Literal["eye-to-hand", "eye-in-hand"]
SensorNoise = Literal["tracker", "camera"]
SETUPS: tuple[Setup, ...] = get_args(Setup)
NOISES: tuple[SensorNoise, ...] = get_args(SensorNoise)
GOOD_MM = {"tracker": 0.3, "camera": 1.0}  # predicted error of a good calibration
WEAK = 4.0  # times that, up to which it is of use at all
DEPTH = {"tracker": 3.0, "camera": 5.0}  # expected deviation in depth over across
SCALED = {"tracker": (0, 0, 0, 0), "camera": (1, 1, 1, 2)}  # powers of the distance, of the groups
GROUPS = ((0, 1), (2,), (3, 4), (5,))  # turn across and along the axis, shift across and along
SAME = {0: 1, 1: 0, 2: 3, 3: 2}  # the other group of the same kind
PRIOR = 12.0  # residuals that the expected ratio of two groups counts as
ROUNDS = 12  # of fit and variances
SETTLED = 1e-3  # relative change of the deviations
LEAST = np.array((1e-9, 1e-9, 1e-6, 1e-6))  # rad, mm
LEVER_MM = 200.0  # typical distance of a marker's origin from its centroid
FEW_POSES = 10
CENTRED = 20  # poses from which the point of independent errors is estimated, not the origin
GROSS = 50.0  # squared distance of a gross error; errors of cameras are no bell curve
ESTIMATED = 8  # freedoms of the residuals that the noise and the weights by it take
N_WORST = 5
NEXT_DEG = (20.0, 40.0)


@dataclass(frozen=True, slots=True, eq=False)
class NextPose:
    """The motion that would tell most: a turn of the tool that leaves the marker where it is."""

    angle_deg: float
    axis_tip: Floats  # (3,) in the tool's frame, from its middle pose
    T_base_tip: Pose  # where the robot would be
    sigma_mm: float  # predicted error of the calibration with one more pose there


@dataclass(frozen=True, slots=True, eq=False)
class HandEyeCalibration:
    """Poses of the sensor and of the marker, how well they are known, and what the data leave over.

    Of eye-in-hand the sensor is in ``tip`` and the marker in ``base``; of eye-to-hand the sensor is
    in ``base`` and the marker in ``tip``.
    """

    setup: Setup
    noise: SensorNoise
    sensor: Pose
    marker: Pose
    covariance: Floats  # (12, 12) of the deviations of sensor, then marker: pose_covariance.py
    sigma_mm: float  # predicted 3D RMS error of places about the marker, mapped by the sensor
    turn_sigma_rad: Floats  # (2,) of one measured pose: across the sensor's axis, along it
    shift_sigma_mm: Floats  # (2,) likewise, at the middle distance
    used: Bools  # (n,) False for gross errors
    shifts_mm: Floats  # (n,) residual of each pose
    turns_deg: Floats  # (n,)
    left_out_mm: Floats  # (n,) residual of each pose by the calibration without it
    left_out_deg: Floats  # (n,)
    verdict: Literal["good", "weak", "bad"]
    reasons: tuple[str, ...]  # why it is not good, and what to do
    next_pose: NextPose

    def worst(self) -> tuple[int, ...]:
        """Return the numbers of the poses that fit worst, gross errors first."""
        order = np.lexsort((-self.left_out_mm, self.used))
        return tuple(int(i) for i in order[:N_WORST])


def calibrate_hand_eye(
    Ts_base_tip: Poses,
    Ts_tracker_marker: Poses,
    *,
    setup: Setup = "eye-to-hand",
    noise: SensorNoise = "tracker",
) -> HandEyeCalibration:
    """Return where the sensor is, from poses of robot and sensor in pairs.

    Args:
        Ts_base_tip: Poses of the robot's flange or tool in its base, n >= 5.
        Ts_tracker_marker: Poses of the marker (or board) in the sensor, the same n.
        setup: "eye-to-hand" (sensor beside the robot) or "eye-in-hand" (sensor on it).
        noise: "tracker" (errors alike at all distances) or "camera" (they grow with it).

    Raises:
        InvalidInputError: different numbers of poses, too few, or poses in another convention,
            with its name.
        DegenerateGeometryError: the motion leaves something open, or too few poses agree.
    """
    if setup not in SETUPS or noise not in NOISES:
        raise InvalidInputError(
            f"setup is {' or '.join(SETUPS)}, noise {' or '.join(NOISES)}, not {setup!r}, {noise!r}"
        )
    n = len(Ts_base_tip)
    if n != len(Ts_tracker_marker):
        raise InvalidInputError(f"{n} robot poses and {len(Ts_tracker_marker)} sensor poses")
    if n <= MIN_POSES:
        raise InvalidInputError(f"a calibration needs at least {MIN_POSES + 1} poses, not {n}")
    require_motion(Ts_base_tip, Ts_tracker_marker)
    require_convention(Ts_base_tip, Ts_tracker_marker, in_hand=setup == "eye-in-hand")
    Ts_b_a = Ts_base_tip.inv() if setup == "eye-in-hand" else Ts_base_tip
    fit, observations, sigmas = _fit(Ts_b_a, Ts_tracker_marker, noise)
    return _assembled(fit, observations, sigmas, setup, noise)


def require_motion(Ts_base_tip: Poses, Ts_tracker_marker: Poses) -> None:
    """Refuse poses that stand still, or turn about one axis only.

    Raises:
        DegenerateGeometryError: they do; it says whose, and what to do.
    """
    for poses, whose in ((Ts_base_tip, "robot"), (Ts_tracker_marker, "sensor")):
        turn = float(turns_deg(poses.rotations)[0][0])
        travel = float(np.ptp(poses.translations, axis=0).max())
        if turn < 0.05 and travel < 0.5:
            raise DegenerateGeometryError(
                f"the poses of the {whose} stand still ({turn:.2g} degrees, {travel:.2g} mm): "
                "record each pose anew"
            )
    require_two_axes(Ts_base_tip.rotations, Ts_tracker_marker.rotations)


# ------------------------------------------------------------------ fit and noise


def _fit(
    Ts_b_a: Poses, Ts_tracker_marker: Poses, noise: SensorNoise
) -> tuple[HandEyeFit, Observations, Floats]:
    """Return the fit, its observations, and the deviations (4,) of the groups."""
    guess = first_guess(Ts_b_a, Ts_tracker_marker)
    observed = _observed(Ts_b_a, Ts_tracker_marker, np.zeros(3), np.ones(4), noise)
    e = np.median(np.abs(residuals(observed, *guess)), axis=0) / 0.6745
    turn, shift = float(np.hypot.reduce(e[:3])), float(np.hypot.reduce(e[3:]))
    sigmas = np.maximum(np.array((turn, turn, shift, shift)) / np.sqrt(3.0), LEAST)
    sigmas *= 3.0  # a guess that fits few poses exactly would make the others gross errors
    center = np.zeros(3)
    for _ in range(ROUNDS):
        observed = _observed(Ts_b_a, Ts_tracker_marker, center, sigmas, noise)
        fit = refine(observed, *guess)
        guess = fit.T_base_tracker, fit.T_toolmarker_tip
        before = sigmas
        if fit.used.sum() >= CENTRED:
            center = _center(observed, fit)
        sigmas = _components(observed, fit, sigmas, noise)
        if np.abs(np.log(sigmas / before)).max() < SETTLED:
            break
    observed = _observed(Ts_b_a, Ts_tracker_marker, center, sigmas, noise)
    return refine(observed, *guess), observed, sigmas


def _scales(distances: Floats, noise: SensorNoise) -> Floats:
    """Return the deviations (n, 6) of poses at distances (n,) in units of those of the groups."""
    ratio = distances / max(float(np.median(distances)), 1e-9)
    scales = np.ones((len(ratio), 6))
    for group, power in zip(GROUPS, SCALED[noise], strict=True):
        scales[:, group] = (ratio**power)[:, None]
    return scales


def _observed(
    Ts_b_a: Poses,
    Ts_tracker_marker: Poses,
    center_marker: Floats,
    sigmas: Floats,
    noise: SensorNoise,
) -> Observations:
    centers = Ts_tracker_marker @ center_marker
    scales = _scales(np.abs(Ts_tracker_marker.translations[:, 2]) + 1e-3, noise)
    for group, sigma in zip(GROUPS, sigmas, strict=True):
        scales[:, group] *= sigma
    covariances = scales[:, :, None] ** 2 * np.eye(6)
    return Observations(
        Ts_b_a, Ts_tracker_marker, center_marker, centers, covariances, (0.0, 0.0), GROSS
    )


def _center(observed: Observations, fit: HandEyeFit) -> Floats:
    """Return the point (3,) of the marker whose shift errs independently of the turn."""
    weights = 1.0 / np.sqrt(np.einsum("nii->ni", observed.unit_covariances)[fit.used, 3:])
    e = fit.residuals[fit.used]
    R = observed.Ts_tracker_toolmarker.rotations[fit.used]
    A = (weights[:, :, None] * (cross_matrices(e[:, :3]) @ R)).reshape(-1, 3)
    b = -(weights * e[:, 3:]).ravel()
    step = np.linalg.solve(A.T @ A + np.eye(3) / LEVER_MM**2, A.T @ b)
    return observed.centroid_toolmarker + step


def _components(
    observed: Observations, fit: HandEyeFit, sigmas: Floats, noise: SensorNoise
) -> Floats:
    """Return the deviations (4,) of the groups: squares of residuals over their redundancy."""
    used = fit.used
    variances = np.einsum("nii->ni", observed.unit_covariances)[used]
    J = jacobians(observed, *_pair(fit), fit.residuals[:, :3], fit.center_base)[used]
    information = np.einsum("nij,ni,nik->jk", J, 1.0 / variances, J)
    leverage = np.einsum("nij,jk,nik->ni", J, np.linalg.inv(information), J) / variances
    squares = fit.residuals[used] ** 2 / variances
    sums = np.array([squares[:, group].sum() for group in GROUPS])
    free = np.array([(1.0 - leverage[:, group]).sum() for group in GROUPS])
    found = np.zeros(4)
    expected = np.array((1.0, 1.0, 1.0, DEPTH[noise]))
    for k in range(4):
        # what both groups of turn, or of shift, say together, if their ratio is as expected
        both = sums[k] * sigmas[k] ** 2 / expected[k] ** 2
        both += sums[SAME[k]] * sigmas[SAME[k]] ** 2 / expected[SAME[k]] ** 2
        common = both / max(free[k] + free[SAME[k]], 1e-9) * expected[k] ** 2
        found[k] = (sums[k] * sigmas[k] ** 2 + PRIOR * common) / (free[k] + PRIOR)
    return np.maximum(np.sqrt(found), LEAST)


def _pair(fit: HandEyeFit) -> tuple[Pose, Pose]:
    return fit.T_base_tracker, fit.T_toolmarker_tip


# ------------------------------------------------------------------ covariance and verdict


def _assembled(
    fit: HandEyeFit, observed: Observations, sigmas: Floats, setup: Setup, noise: SensorNoise
) -> HandEyeCalibration:
    n_used = int(fit.used.sum())
    freedom = DOF * n_used - UNKNOWNS
    covariance = fit.covariance * freedom / max(freedom - ESTIMATED, 1)
    change = np.eye(12)
    change[6:, 6:] = _inverted(fit.T_toolmarker_tip)
    covariance_out = change @ covariance @ change.T
    sigma_mm = _sigma_mm(fit, observed, covariance)
    left_out = _left_out(fit, observed)
    robot = observed.Ts_base_tip if setup == "eye-to-hand" else observed.Ts_base_tip.inv()
    suggested = _next_pose(fit, observed, covariance, in_hand=setup == "eye-in-hand")
    second_deg = float(turns_deg(robot.rotations[fit.used])[0][1])
    verdict, reasons = _judged(sigma_mm, noise, fit.used, second_deg, suggested)
    return HandEyeCalibration(
        setup=setup,
        noise=noise,
        sensor=fit.T_base_tracker,
        marker=fit.T_toolmarker_tip.inv(),
        covariance=readonly((covariance_out + covariance_out.T) / 2.0),
        sigma_mm=sigma_mm,
        turn_sigma_rad=readonly(sigmas[:2]),
        shift_sigma_mm=readonly(sigmas[2:]),
        used=fit.used,
        shifts_mm=readonly(np.linalg.norm(fit.residuals[:, 3:], axis=1)),
        turns_deg=readonly(np.rad2deg(np.linalg.norm(fit.residuals[:, :3], axis=1))),
        left_out_mm=readonly(np.linalg.norm(left_out[:, 3:], axis=1)),
        left_out_deg=readonly(np.rad2deg(np.linalg.norm(left_out[:, :3], axis=1))),
        verdict=verdict,
        reasons=reasons,
        next_pose=suggested,
    )


def _inverted(T_b_a: Pose) -> Floats:
    """Return the matrix (6, 6) from the deviation of a pose to that of its inverse."""
    back = T_b_a.rotation.T
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = -back
    change[3:, :3] = -back @ cross_matrices(T_b_a.translation)
    return change


def _sigma_mm(fit: HandEyeFit, observed: Observations, covariance: Floats) -> float:
    """Return the predicted error of places about the middle of the seen markers."""
    centers = fit.T_base_tracker @ observed.centroids_tracker[fit.used]
    return registration_sigma_mm(fit.T_base_tracker, covariance[:6, :6], centers.mean(axis=0))


def _left_out(fit: HandEyeFit, observed: Observations) -> Floats:
    """Return the residual (n, 6) of each pose by the calibration without it, to first order."""
    J = jacobians(observed, *_pair(fit), fit.residuals[:, :3], fit.center_base)
    deviations = np.sqrt(np.einsum("nii->ni", observed.unit_covariances))
    white = J / deviations[:, :, None]
    inverse = np.linalg.inv(np.einsum("nij,nik->jk", white[fit.used], white[fit.used]))
    found = fit.residuals.copy()
    for i in np.flatnonzero(fit.used):
        kept = np.eye(6) - white[i] @ inverse @ white[i].T
        found[i] = deviations[i] * (np.linalg.pinv(kept) @ (found[i] / deviations[i]))
    return found


def _next_pose(
    fit: HandEyeFit, observed: Observations, covariance: Floats, *, in_hand: bool
) -> NextPose:
    """Return the turn about the marker, from the middle pose, that lessens the error most."""
    markers = observed.Ts_tracker_toolmarker.select(fit.used)
    mean = markers.mean().rotation
    off = np.linalg.norm(rotation_vectors(mean.T @ markers.rotations), axis=1)
    middle = markers[int(np.argmin(off))]
    center = middle @ observed.centroid_toolmarker
    axes = np.array([(x, y, z) for x in (0, 1, -1) for y in (0, 1, -1) for z in (0, 1, -1)][1:])
    turns = [
        Pose.from_rotvec(np.deg2rad(angle) * axis / np.linalg.norm(axis))
        for angle in NEXT_DEG
        for axis in axes
    ]
    placed = [
        Pose(t.rotation @ middle.rotation, center - t.rotation @ (center - middle.translation))
        for t in turns
    ]
    poses = Poses.stack(placed)
    left = fit.T_base_tracker @ poses @ fit.T_toolmarker_tip
    unit = np.median(observed.unit_covariances, axis=0)
    extra = replace(
        observed,
        Ts_base_tip=left,
        Ts_tracker_toolmarker=poses,
        centroids_tracker=poses @ observed.centroid_toolmarker,
        unit_covariances=np.tile(unit, (len(poses), 1, 1)),
    )
    J = jacobians(extra, *_pair(fit), np.zeros((len(poses), 3)), fit.T_base_tracker.translation)
    before = np.linalg.inv(covariance)
    gained = np.einsum("nij,ik,nkl->njl", J, np.linalg.inv(unit), J)
    sigmas = [_sigma_mm(fit, observed, np.linalg.inv(before + one)) for one in gained]
    # of turns that tell nearly as much, the smaller one
    best = int(np.argmin(np.array(sigmas) * np.repeat((1.0, 1.01), len(axes))))
    axis_tracker = axes[best % len(axes)] / np.linalg.norm(axes[best % len(axes)])
    if in_hand:
        sensor = fit.T_base_tracker  # here in the tip
        T_base_tip, axis_tip = left[best].inv(), -sensor.rotate(axis_tracker)
    else:
        axis_base = fit.T_base_tracker.rotate(axis_tracker)
        start = fit.T_base_tracker @ middle @ fit.T_toolmarker_tip
        T_base_tip, axis_tip = left[best], start.inv().rotate(axis_base)
    angle = NEXT_DEG[best // len(axes)]
    return NextPose(angle, readonly(axis_tip), T_base_tip, sigmas[best])


def _judged(
    sigma_mm: float, noise: SensorNoise, used: Bools, second_deg: float, suggested: NextPose
) -> tuple[Literal["good", "weak", "bad"], tuple[str, ...]]:
    """Return the verdict, and the reasons with their remedies where it is not good."""
    good_mm, reasons = GOOD_MM[noise], list[str]()
    if sigma_mm > good_mm:
        more = int(np.ceil(used.sum() * (sigma_mm / good_mm) ** 2))
        axis = in_words(suggested.axis_tip)
        reasons.append(
            f"places are expected to be off by {sigma_mm:.2g} mm, {good_mm:g} mm are good: turn "
            f"the tool further, first by {suggested.angle_deg:.0f} degrees about {axis} of its own "
            f"frame, or use about {more} poses"
        )
    if second_deg < GOOD_TURN_DEG:
        reasons.append(
            f"the tool turned by only {second_deg:.1f} degrees (RMS) about its second axis; its "
            "axes are nearly parallel: tilt it about a second one"
        )
    if used.sum() < FEW_POSES:
        reasons.append(f"only {int(used.sum())} poses count: use at least {FEW_POSES}")
    rejected = len(used) - int(used.sum())
    if rejected > MAX_REJECTED * len(used):
        reasons.append(
            f"{rejected} of {len(used)} poses are gross errors: look for hidden markers, for "
            "reflections, and whether robot and sensor were read at the same time"
        )
    bad = sigma_mm > WEAK * good_mm
    return ("bad" if bad else "weak" if reasons else "good"), tuple(reasons)
