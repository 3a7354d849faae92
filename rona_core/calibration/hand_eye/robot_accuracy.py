"""Errors of markers and robot that repeat: effect on a registration, and its residuals.

Test of the robot's stated accuracy on the residuals of its own registration. Errors of the links
vary with the posture, so a part of them is left over by the best registration of robot and tracker.
With what a registration can explain projected out, the residuals y are

    y ~ N(0, V),  V = L L' + F + s1 C1 + s2 C2 + s3 C3

L: links of the stated accuracy; F: field of the tracker as its maker states it; C: markers, and
random turns and shifts of the tool, whose sizes s are not stated and are estimated (restricted
maximum likelihood, Patterson 1971). The score of the size of L is Q = |L' V^-1 y|^2; if the robot
keeps its accuracy, Q is a sum of chi squares with weights w, the eigenvalues of L' V^-1 L, and has
nearly a scaled chi square of the same mean and variance (Satterthwaite 1946).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from rona_core.calibration.hand_eye.hand_eye import (
    TIP_VARIANCE_MM2,
    TOOL_MARKERS,
    TURN_VARIANCE_RAD2,
    TYPICAL,
    UNKNOWNS,
    jacobians,
    observe,
    residuals,
    robot_covariances,
    tangent_at_tracker,
)
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.tracking_error import LearnedField, fit_matrices
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices


@dataclass(frozen=True, slots=True, eq=False)
class RegistrationSensitivity:
    """How the deviation (12,) of a registration follows from errors at its poses.

    It is that of ``ToolRegistration.covariance``; errors of the robot are those of the true tip
    against what the encoders say: (turn, shift) in ``base``.
    """

    points_tracker: Floats  # (p, 3) places of markers
    markers: Floats  # (12, p, 3) derivatives by their errors in ``tracker``
    robot: Floats  # (12, n, 6) by the errors of the robot at the poses that were used
    center_base: Floats  # (3,) mean of the tips there


def registration_sensitivity(
    found: ToolRegistration, Ts_base_tip: Poses, Ts_tracker_toolmarker: Poses
) -> RegistrationSensitivity:
    """Return how errors at its poses (n) move a registration, to first order.

    The weights are those of the method "joint".
    """
    robot_tips, seen = Ts_base_tip.select(found.used), Ts_tracker_toolmarker.select(found.used)
    both = found.T_base_tracker, found.T_toolmarker_tip
    observations = observe(robot_tips, seen, TOOL_MARKERS, TYPICAL)
    turns = residuals(observations, *both)[:, :3]
    center = robot_tips.translations.mean(axis=0)
    J = jacobians(observations, *both, turns, center)
    noise = found.marker_sigma_mm**2 * observations.unit_covariances
    weights = np.linalg.inv(noise + robot_covariances(observations, *both))
    weighted = np.einsum("nij,nik->njk", J, weights)
    solved = np.linalg.solve(np.einsum("nij,njk->ik", weighted, J), weighted)  # (n, 12, 6)
    change = -tangent_at_tracker(found.T_base_tracker, center) @ solved
    n, m = len(robot_tips), len(TOOL_MARKERS)
    by_marker = change[:, None] @ fit_matrices(seen.rotations, TOOL_MARKERS)
    R_tracker_base = found.T_base_tracker.rotation.T
    levers = found.T_base_tracker @ observations.centroids_tracker - robot_tips.translations
    seen_as = np.zeros((n, 6, 6))  # turn and shift of the tip in base, as the tracker sees them
    seen_as[:, :3, :3] = seen_as[:, 3:, 3:] = R_tracker_base
    seen_as[:, 3:, :3] = -R_tracker_base @ cross_matrices(levers)
    points = seen.map_points(TOOL_MARKERS).reshape(-1, 3)
    return RegistrationSensitivity(
        points_tracker=readonly(points),
        markers=readonly(np.moveaxis(by_marker, 2, 0).reshape(12, n * m, 3)),
        robot=readonly(np.moveaxis(change @ seen_as, 1, 0)),
        center_base=readonly(center),
    )


FALSE_ALARM = 0.01  # share of robots as accurate as stated that are contradicted
MOST_POSES = 60  # so many, evenly spread, are looked at: time grows with the cube
LEAST_POSES = 12
SCALE = np.repeat((1e3, 1.0), 3)  # rad to mrad, which are of the size of mm
STEPS, MOST_STEP, SETTLED = 30, 4.0, 1e-2  # of the estimate of variances, their relative change
START, SMALLEST = 0.1, 1e-6  # of the variances that hand_eye.py assumes
RCOND = 1e-9


@dataclass(frozen=True, slots=True)
class AccuracyTest:
    """Whether residuals of a registration contradict the accuracy that is stated of a robot."""

    ratio: float  # estimated error of the robot over the stated one
    chance: float  # of residuals so large from a robot that is as accurate as stated

    @property
    def contradicted(self) -> bool:
        """Whether the robot errs more than stated, at the false alarm rate of this module."""
        return self.chance < FALSE_ALARM

    def words(self, accuracy_mm: float, which: str) -> str:
        """Return what is contradicted by how much, with the remedy.

        Args:
            accuracy_mm: As stated.
            which: Whose residuals these are.
        """
        once = f"{1.0 / max(self.chance, 1e-4):.0f}"
        return (
            f"{which} vary with the posture as with a robot that errs by "
            f"{self.ratio * accuracy_mm:.2f} mm, but {accuracy_mm:.2f} mm are assumed (so much "
            f"comes once in {once}{'' if self.chance > 1e-4 else ' or more'} times by chance): "
            "expected errors in base are too small by that ratio; tighten tool, robot base and "
            "tracker and register again (step 2), and if it stays have the arm calibrated"
        )


def check_robot_accuracy(
    found: ToolRegistration,
    Ts_base_tip: Poses,
    Ts_tracker_toolmarker: Poses,
    links: Floats,
    field: LearnedField,
) -> AccuracyTest | None:
    """Return whether the residuals of a registration contradict the robot's stated accuracy.

    Args:
        found: The registration.
        Ts_base_tip: Tool tip by the robot, the n poses of the registration.
        Ts_tracker_toolmarker: Tool marker by the tracker, the same n poses.
        links: Turns in rad and shifts in mm of the tip in ``base`` (n, 6, k) by k independent
            standard normal errors of the links, as large as stated.
        field: Fixed error of the tracker, as stated.

    Returns:
        The test; None where nothing is stated or too few poses are used.
    """
    rows = np.flatnonzero(found.used)
    if len(rows) < LEAST_POSES or not links.any():
        return None
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_POSES).round().astype(np.int64))]
    keep = np.zeros(len(found.used), dtype=np.bool_)
    keep[rows] = True
    tips, seen = Ts_base_tip.select(keep), Ts_tracker_toolmarker.select(keep)
    n, both = len(tips), (found.T_base_tracker, found.T_toolmarker_tip)
    observations = observe(tips, seen, TOOL_MARKERS, TYPICAL)
    left = residuals(observations, *both)
    J = jacobians(observations, *both, left[:, :3], tips.translations.mean(axis=0))
    # turn in mrad and shift in mm of the tip in base, from turn and shift of the markers' centroid
    R_base_tracker = found.T_base_tracker.rotation
    levers = found.T_base_tracker @ observations.centroids_tracker - tips.translations
    at_tip = np.zeros((n, 6, 6))
    at_tip[:, :3, :3] = at_tip[:, 3:, 3:] = R_base_tracker
    at_tip[:, 3:, :3] = cross_matrices(levers) @ R_base_tracker
    at_tip *= SCALE[:, None]
    explained = (at_tip @ J).reshape(6 * n, UNKNOWNS)
    rest = np.linalg.qr(explained, mode="complete")[0][:, UNKNOWNS:].T.reshape(-1, n, 6)
    by_tip = np.einsum("pni,nij->pnj", rest, at_tip)
    by_marker = np.einsum("pni,nmij->pnmj", by_tip, fit_matrices(seen.rotations, TOOL_MARKERS))
    fixed = field.propagate(
        by_marker.reshape(len(rest), -1, 3), seen.map_points(TOOL_MARKERS).reshape(-1, 3)
    )
    turns, shifts = rest[..., :3].reshape(len(rest), -1), rest[..., 3:].reshape(len(rest), -1)
    chance = (
        np.einsum("pni,nij,qnj->pq", by_tip, observations.unit_covariances, by_tip, optimize=True),
        TURN_VARIANCE_RAD2 * SCALE[0] ** 2 * turns @ turns.T,
        TIP_VARIANCE_MM2 * shifts @ shifts.T,
    )
    by_links = np.einsum("pni,nij->pj", rest, SCALE[:, None] * links[keep])
    y = np.einsum("pni,ni->p", by_tip, left)
    return _score(y, by_links, fixed, chance)


def _score(y: Floats, by_links: Floats, fixed: Floats, chance: tuple[Floats, ...]) -> AccuracyTest:
    """Return the score test of the size of the links.

    Args:
        y: What is left over (p,), of covariance V.
        by_links: L (p, k).
        fixed: Covariance (p, p) that is known.
        chance: Covariances (p, p) whose sizes are estimated.
    """
    known = fixed + by_links @ by_links.T
    sizes = np.full(len(chance), START)
    for _ in range(STEPS):  # Fisher scoring
        inverse = np.linalg.inv(known + sum(s * C for s, C in zip(sizes, chance, strict=True)))
        white = inverse @ y
        products = [inverse @ C for C in chance]
        gradient = np.array(
            [white @ C @ white - np.trace(p) for C, p in zip(chance, products, strict=True)]
        )
        information = np.array([[(a * b.T).sum() for b in products] for a in products])
        before = sizes
        step = np.linalg.lstsq(information, gradient, rcond=RCOND)[0]
        sizes = np.clip(sizes + step, sizes / MOST_STEP, sizes * MOST_STEP)
        sizes = np.maximum(sizes, SMALLEST)
        if np.abs(sizes - before).max() < SETTLED * sizes.max():
            break
    random = sum((s * C for s, C in zip(sizes, chance, strict=True)), np.zeros_like(fixed))
    return score_of_links(y, by_links, fixed + random)


def score_of_links(y: Floats, by_links: Floats, rest: Floats) -> AccuracyTest:
    """Return the score test of the size of errors of the links.

    Args:
        y: Residuals (p,).
        by_links: L (p, k), how they follow from k standard normal errors of the links.
        rest: Covariance (p, p) of all else in them.
    """
    white = np.linalg.solve(rest + by_links @ by_links.T, np.column_stack((y, by_links)))
    q = float(((by_links.T @ white[:, 0]) ** 2).sum())
    weights = np.linalg.eigvalsh(by_links.T @ white[:, 1:])
    mean, half_variance = float(weights.sum()), float((weights**2).sum())
    ratio = np.sqrt(max(0.0, 1.0 + (q - mean) / half_variance))  # by moments
    freedom = mean**2 / half_variance
    return AccuracyTest(float(ratio), float(chdtrc(freedom, q * mean / half_variance)))
