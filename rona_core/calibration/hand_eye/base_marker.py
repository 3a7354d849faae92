"""Detection of a moved tracker by the marker on the robot base, and update of the registration.

At the registration the tracker sees the base marker in the mean at M1, later at M2. What leads from
the tracker now to the tracker then is D = M1 inv(M2); the registration carried over is

    T_base_tracker = T_base_tracker_then D

As long as M1 and M2 agree within their noise nothing is carried over: then the fixed errors of the
tracker stay where they were, and cancel. Carried over, they no longer do. The field of a marker's
error is taken to change smoothly over the volume; what it does to the four markers turns the plate,
and acts at the head with the lever from the robot base to there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.tracker_field import TrackerErrorField
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, as_points, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import cross_matrices, point_jacobians, rotation_vectors

MIN_FRAMES = 10
CHI2_LIMIT = 27.9  # 6 degrees of freedom; noise alone exceeds it once in 10 000 captures
FLOOR_MM, FLOOR_DEG = 0.02, 0.005  # per axis: what a room does by itself, warmth and floor
OUTLIER = 5.0  # medians of the distance from the mean; frames beyond do not count


@dataclass(frozen=True, slots=True, eq=False)
class SeenBase:
    """Where the tracker saw the base marker over a capture, in the mean."""

    T_tracker_basemarker: Pose
    covariance: Floats  # (6, 6) of the mean, from the scatter of the frames
    n_frames: int


@dataclass(frozen=True, slots=True, eq=False)
class BaseReference:
    """The base marker at the registration: what a tracker that was moved is found again by."""

    T_base_basemarker: Pose
    seen: SeenBase


@dataclass(frozen=True, slots=True, eq=False)
class Movement:
    """How the base marker of a capture compares with that of the registration."""

    T_a_b: Pose  # D: the tracker of the capture in that of the registration
    chi2: float  # squared distance in standard deviations, 6 degrees of freedom
    moved: bool
    shift_mm: float  # of the tracker
    turn_deg: float


def mean_base(Ts_tracker_basemarker: Poses) -> SeenBase:
    """Return the mean of a base marker that stood still, gross errors left out.

    Raises:
        DegenerateGeometryError: it was seen in fewer than 10 frames.
    """
    n = len(Ts_tracker_basemarker)
    if n < MIN_FRAMES:
        raise DegenerateGeometryError(
            f"the base marker was seen in {n} frames, {MIN_FRAMES} are the least: uncover it"
        )
    middle = np.median(Ts_tracker_basemarker.translations, axis=0)
    away = np.linalg.norm(Ts_tracker_basemarker.translations - middle, axis=1)
    kept = Ts_tracker_basemarker.select(away <= OUTLIER * np.median(away) + 1e-6)
    mean = kept.mean()
    turns = rotation_vectors(kept.rotations @ mean.rotation.T)
    scatter = np.hstack((turns, kept.translations - mean.translation))
    covariance = scatter.T @ scatter / max(len(kept) - 1, 1) / len(kept)
    return SeenBase(mean, readonly(covariance), len(kept))


def detect_tracker_movement(registered: SeenBase, now: SeenBase) -> Movement:
    """Return whether the tracker has moved: chi^2 of the two means with noise and a floor."""
    then, later = registered.T_tracker_basemarker, now.T_tracker_basemarker
    turn = rotation_vectors((then.rotation @ later.rotation.T)[None])[0]
    off = np.concatenate((turn, then.translation - later.translation))
    floor = np.repeat((np.deg2rad(FLOOR_DEG), FLOOR_MM), 3) ** 2
    spread = registered.covariance + now.covariance + np.diag(floor)
    chi2 = float(off @ np.linalg.solve(spread, off))
    T_a_b = then @ later.inv()
    return Movement(
        T_a_b=T_a_b,
        chi2=chi2,
        moved=chi2 > CHI2_LIMIT,
        shift_mm=float(np.linalg.norm(T_a_b.translation)),
        turn_deg=float(np.rad2deg(np.linalg.norm(turn))),
    )


@dataclass(frozen=True, slots=True, eq=False)
class UpdatedRegistration:
    """A registration for a tracker that stands elsewhere now, and what the way there costs."""

    T_base_tracker: Pose
    covariance: Floats  # (6, 6) of it, the registration's own included
    added: Floats  # (6, 6) the part of the base marker

    def added_sigma_mm(self, points_base: ArrayLike) -> Floats:
        """Return the predicted 3D error (n,) that the base marker adds at places (n, 3)."""
        return point_sigmas_mm(self.T_base_tracker, self.added, points_base)


def point_sigmas_mm(T_base_tracker: Pose, covariance: Floats, points_base: ArrayLike) -> Floats:
    """Return the 3D standard deviations (n,) of places (n, 3) mapped to ``base`` by a pose."""
    J = point_jacobians(T_base_tracker, T_base_tracker.inv() @ as_points(points_base))
    return np.sqrt(np.einsum("nij,jk,nik->n", J, covariance, J))


def update_registration(
    T_base_tracker: Pose,
    covariance: Floats,
    registered: SeenBase,
    now: SeenBase,
    field: TrackerErrorField,
) -> UpdatedRegistration:
    """Return the registration for where the tracker stands now.

    Args:
        T_base_tracker: As registered.
        covariance: Of it (6, 6), as geometry/pose_covariance.py says.
        registered: The base marker then.
        now: The base marker since the tracker was moved.
        field: What averaging does not remove.
    """
    T_a_b = detect_tracker_movement(registered, now).T_a_b
    carried = T_base_tracker @ T_a_b
    turn_base, turn_a = T_base_tracker.rotation, T_a_b.rotation
    transport = _shifted(turn_base @ T_a_b.translation)
    axes_a = np.kron(np.eye(2), turn_a)
    deviation = registered.covariance + axes_a @ now.covariance @ axes_a.T
    deviation = deviation + _field_covariance(registered, now, turn_a, field)
    place_base = T_base_tracker @ registered.T_tracker_basemarker.translation
    to_base = np.kron(np.eye(2), turn_base)
    to_marker = _shifted(carried.translation - place_base)
    added = to_marker @ to_base @ deviation @ to_base.T @ to_marker.T
    total = transport @ covariance @ transport.T + added
    return UpdatedRegistration(
        carried,
        readonly((total + total.T) / 2.0),
        readonly((added + added.T) / 2.0),
    )


def _shifted(arm: Floats) -> Floats:
    """Return how a deviation (6,) reads at a place that is ``arm`` (3,) away."""
    change = np.eye(6)
    change[3:, :3] = -cross_matrices(arm)
    return change


def _field_covariance(
    registered: SeenBase, now: SeenBase, turn_a: Floats, field: TrackerErrorField
) -> Floats:
    """Return the covariance (6, 6) of what the error field makes of D, at the marker's middle."""
    levers = GEOMETRIES["basemarker"].positions_marker
    then, later = registered.T_tracker_basemarker, now.T_tracker_basemarker
    spread = field.covariance(np.vstack((then @ levers, later @ levers)))
    arms = cross_matrices(levers @ then.rotation.T)
    inverse = np.linalg.inv(np.einsum("mij,mkj->ik", arms, arms))
    fit = np.vstack((np.hstack(inverse @ arms), np.tile(np.eye(3) / len(levers), len(levers))))
    back = np.kron(np.eye(len(levers)), turn_a)  # errors of now, along the axes of then
    both = np.hstack((fit, -fit @ back))
    return both @ spread @ both.T
