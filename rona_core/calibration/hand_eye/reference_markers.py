"""Markers that show what has moved: the tracker by that on the robot base, the head by its own.

Detection of a moved tracker by the marker on the robot base, and update of the registration. At the
registration the tracker sees the base marker in the mean at M1, later at M2. What leads from the
tracker now to the tracker then is D = M1 inv(M2); the registration carried over is

    T_base_tracker = T_base_tracker_then D

As long as M1 and M2 agree within their noise nothing is carried over: then the fixed errors of the
tracker stay where they were, and cancel. Carried over, they no longer do. The field of a marker's
error is taken to change smoothly over the volume; what it does to the four markers turns the plate,
and acts at the head with the lever from the robot base to there.

Head motion: how the marker on the head has moved since a reference, and how to take it back. The
tracker sees the head marker at H_ref in the mean of a reference capture, at H(t) in another. What
carries the head from there to where it is now is, in the base,

    X(t) = T_base_tracker H(t) inv(H_ref) inv(T_base_tracker)

and what was measured on the head at t belongs at ``inv(X(t)) @ p``. The registration only turns a
shift of less than a millimetre, so that its own error does not count; neither do the fixed errors
of the tracker, which stay the same for a marker that hardly moves.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from rona_core.calibration.tracking_error import TrackerErrorField
from rona_core.devices.samples import ToolTrack
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, Vector3, as_floats, as_points, readonly
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


WINDOW_S = 2.0  # over which poses are averaged: a breath takes about twice as long
GAP_S = 5.0  # hidden for longer than this, the head's motion meanwhile is unknown
ROUNDING = 1e-6  # rad and mm, below which a tracker without noise is not believed
FALSE_ALARM = 1e-3  # share of captures in which noise alone counts as motion


@dataclass(frozen=True, slots=True, eq=False)
class HeadReference:
    """Where the head marker was in the mean of the capture to which all others are corrected."""

    T_tracker_headmarker: Pose
    covariance: Floats  # (6, 6) of a single frame: noise alone, from successive frames
    n_frames: int


@dataclass(frozen=True, slots=True, eq=False)
class HeadMotion:
    """Motion of the head over a capture, relative to the reference; all in ``base``.

    A point p of the resting head is at ``center + shift + R (p - center)``, R by the turn.
    """

    times_s: Floats  # (k,) of the capture
    turns_rad: Floats  # (k, 3) rotation vectors
    shifts_mm: Floats  # (k, 3) of the marker
    center_base: Vector3  # (3,) of the marker at the reference
    covariance: Floats  # (6, 6) of the mean turn and shift, by the noise of the tracker
    chi2: float  # of the means over each window, had the head not moved
    limit: float  # beyond it the head has moved

    @property
    def moved(self) -> bool:
        """Whether noise alone does not explain it."""
        return self.chi2 > self.limit

    def back(self, times_s: ArrayLike) -> Poses:
        """Return inv(X) (n,) at times (n,), linear between frames.

        It leads points and poses measured at those times to where they belong on the head as it
        lay at the reference.
        """
        times = as_floats(times_s, name="times_s")
        turns, shifts = (
            np.stack([np.interp(times, self.times_s, column) for column in columns.T], axis=1)
            for columns in (self.turns_rad, self.shifts_mm)
        )
        rotations = Rotation.from_rotvec(turns).as_matrix()
        center = self.center_base
        return Poses.unchecked(rotations, center + shifts - rotations @ center).inv()

    def shift_at(self, point_base: ArrayLike) -> Vector3:
        """Return the mean shift (3,) of a point (3,) of the head in mm."""
        return self._lever(point_base) @ np.concatenate(
            (self.turns_rad.mean(axis=0), self.shifts_mm.mean(axis=0))
        )

    def sigma_at(self, point_base: ArrayLike) -> Vector3:
        """Return the standard deviations (3,) in mm of the mean shift of a point (3,)."""
        lever = self._lever(point_base)
        return np.sqrt(np.diag(lever @ self.covariance @ lever.T))

    def range_at(self, point_base: ArrayLike) -> float:
        """Return the largest distance in mm of a point (3,) from its mean place meanwhile."""
        ways = np.hstack((self.turns_rad, self.shifts_mm)) @ self._lever(point_base).T
        return float(np.linalg.norm(ways - ways.mean(axis=0), axis=1).max())

    @property
    def turn_deg(self) -> float:
        """Angle in degrees by which the head is turned in the mean."""
        return float(np.rad2deg(np.linalg.norm(self.turns_rad.mean(axis=0))))

    def _lever(self, point_base: ArrayLike) -> Floats:
        """Return how a turn and a shift of the marker (6,) move a point (3,): (3, 6)."""
        arm = as_floats(point_base, name="point_base") - self.center_base
        return np.hstack((-cross_matrices(arm), np.eye(3)))


def head_reference(track: ToolTrack) -> HeadReference:
    """Return the mean of the head marker over a capture, and the noise of a frame.

    Raises:
        DegenerateGeometryError: it was seen in fewer than 10 frames.
    """
    _require_frames(track)
    seen = track.Ts_tracker_marker
    steps = _deviations(seen, seen.mean())
    steps = np.diff(steps, axis=0)
    noise = steps.T @ steps / (2.0 * len(steps))
    return HeadReference(seen.mean(), readonly(noise), len(seen))


def head_motion(
    reference: HeadReference, track: ToolTrack, T_base_tracker: Pose, span_s: tuple[float, float]
) -> HeadMotion:
    """Return how the head moved over a capture; the tracker stands where it stood.

    Args:
        reference: Where it lay.
        track: The head marker in the capture.
        T_base_tracker: The registration.
        span_s: First and last time for which the motion is wanted.

    Raises:
        DegenerateGeometryError: the marker was seen in fewer than 10 frames, or hidden for more
            than 5 s of the time that is wanted.
    """
    _require_frames(track)
    times = track.times_s
    known = np.concatenate(([span_s[0]], times[(times > span_s[0]) & (times < span_s[1])]))
    gap_s = float(np.diff(np.append(known, span_s[1])).max())
    if gap_s > GAP_S:
        raise DegenerateGeometryError(
            f"the head marker was hidden for {gap_s:.0f} s, {GAP_S:.0f} are allowed: uncover it"
        )
    deviations = _deviations(track.Ts_tracker_marker, reference.T_tracker_headmarker)
    chi2, limit = _chi2(reference, times, deviations)
    axes = np.kron(np.eye(2), T_base_tracker.rotation)
    mean = reference.covariance * (1.0 / len(times) + 1.0 / reference.n_frames)
    smooth = _moving_mean(times, deviations) @ axes.T
    return HeadMotion(
        times_s=times,
        turns_rad=readonly(smooth[:, :3]),
        shifts_mm=readonly(smooth[:, 3:]),
        center_base=readonly(T_base_tracker @ reference.T_tracker_headmarker.translation),
        covariance=readonly(axes @ mean @ axes.T),
        chi2=chi2,
        limit=limit,
    )


def _require_frames(track: ToolTrack) -> None:
    if len(track.times_s) < MIN_FRAMES:
        raise DegenerateGeometryError(
            f"the head marker was seen in {len(track.times_s)} of {track.n_frames} frames, "
            f"{MIN_FRAMES} are the least"
        )


def _deviations(seen: Poses, mean: Pose) -> Floats:
    """Return turns and shifts (n, 6) of poses from a mean, along the axes of the tracker."""
    turns = rotation_vectors(seen.rotations @ mean.rotation.T)
    return np.hstack((turns, seen.translations - mean.translation))


def _chi2(reference: HeadReference, times_s: Floats, deviations: Floats) -> tuple[float, float]:
    """Return the squared distance of the means over windows from rest, and its limit."""
    window = ((times_s - times_s[0]) // WINDOW_S).astype(np.int64)
    counts = np.bincount(window)
    sums = np.stack([np.bincount(window, d) for d in deviations.T], axis=1)
    full = counts > 0
    means = sums[full] / counts[full][:, None]
    weighed = np.linalg.solve(reference.covariance + ROUNDING**2 * np.eye(6), means.T).T
    weights = 1.0 / (1.0 / counts[full] + 1.0 / reference.n_frames)
    chi2 = float((weights * (means * weighed).sum(axis=1)).sum())
    return chi2, float(chdtri(6 * len(means), FALSE_ALARM))


def _moving_mean(times_s: Floats, values: Floats) -> Floats:
    """Return the means (n, c) of values (n, c) over a window about each time (n,)."""
    first = np.searchsorted(times_s, times_s - WINDOW_S / 2.0 - 1e-9)
    last = np.searchsorted(times_s, times_s + WINDOW_S / 2.0 + 1e-9)
    sums = np.vstack((np.zeros(values.shape[1]), np.cumsum(values, axis=0)))
    return (sums[last] - sums[first]) / (last - first)[:, None]
