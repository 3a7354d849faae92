"""What errors of markers and robot that repeat make of a registration of robot and tracker."""

from dataclasses import dataclass

import numpy as np

from rona_core.calibration.hand_eye.hand_eye import TOOL_MARKERS, TYPICAL
from rona_core.calibration.hand_eye.residuals import (
    jacobians,
    observe,
    residuals,
    robot_covariances,
    tangent_at_tracker,
)
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.tracking_error import fit_matrices
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
