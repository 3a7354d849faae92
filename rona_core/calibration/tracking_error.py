"""Errors of a tracker: of single markers and the poses fitted to them, and over its volume.

Error of single markers, and the covariance of the poses that a tracker fits to them. The tracker
fits a pose to the markers without weights, so the error of that pose follows from the error S of
one marker through the pseudo-inverse of J_k = (-[r_k]x, 1): cov = J+ S J+'. In the axes of
``tracker`` and about the centroid of the markers, rotation and shift part:

    cov(shift) = S / m,    cov(turn) = I^-1 (sum [r_k]x S [r_k]x') I^-1,   I = sum |r|^2 1 - r r'

Fixed error of the tracker over its volume, as far as its maker and the pivot tell of it. How large
it is, the maker states. How fast it changes from place to place is not stated, and that alone
counts for a tip that swings, or for two places that were mapped with one registration. But where
the pointer pivots, the tip seems to wander as the field changes under its markers: the residuals
tell the length. The field is taken for a Gaussian process (Rasmussen 2006) whose lengths are
weighted by the likelihood of the residuals; without a pivot each length is as likely.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.distance import cdist

from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_points, readonly
from rona_core.geometry.pose import Poses
from rona_core.geometry.pose_covariance import cross_matrices

MIN_SPREAD = 0.02  # second over first width of 6D markers; first width in mm is checked too
MIN_WIDTH_MM = 1.0
MAX_OFF_LINE_MM = 1e-3
COLLINEAR_MM = 1e-6  # markers closer than this to one line are on it
MAX_DEPTH_RATIO = 20.0


@dataclass(frozen=True, slots=True)
class MarkerNoise:
    """White error of one marker in the frame ``tracker``, whose z axis is the depth.

    A stereo tracker measures depth worst, by about twice the distance over the baseline.
    """

    depth_ratio: float = 3.0  # deviation along z over that along x or y
    sigma_mm: float | None = None  # 3D RMS of one marker; None: taken from the residuals

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidInputError: a ratio outside 1 to 20, or a deviation that is not positive.
        """
        if not 1.0 <= self.depth_ratio <= MAX_DEPTH_RATIO:
            raise InvalidInputError(
                f"depth_ratio must be 1 to {MAX_DEPTH_RATIO:g}, not {self.depth_ratio}"
            )
        if self.sigma_mm is not None and not 0.0 < self.sigma_mm < np.inf:
            raise InvalidInputError(f"sigma_mm must be positive, not {self.sigma_mm}")

    def shape(self) -> Floats:
        """Return the deviations (3,) along tracker x, y, z for a 3D RMS of 1."""
        shares = np.array((1.0, 1.0, self.depth_ratio))
        return readonly(shares / np.linalg.norm(shares))


EVEN = MarkerNoise(depth_ratio=1.0)


@dataclass(frozen=True, slots=True, eq=False)
class TrackedPoses:
    """n poses of ``marker`` in ``tracker`` and the covariance of their errors.

    The true pose is the measured one turned by -turn and moved by -shift, both in ``tracker``; the
    turn is about the point ``reference_marker``, the centroid of all markers.
    """

    Ts_tracker_marker: Poses
    reference_marker: Vector3  # (3,) mm
    covariances: Floats  # (n, 6, 6) of turn (rad) and shift (mm), if the 3D RMS of a marker is 1 mm

    def centers_tracker(self) -> Floats:
        """Return where the reference point was measured (n, 3)."""
        return self.Ts_tracker_marker @ self.reference_marker


def as_marker_positions(positions_marker: ArrayLike, dof: int) -> Floats:
    """Return marker positions (m, 3) after checking that they suit a tool of ``dof`` freedoms.

    Raises:
        InvalidInputError: wrong shape, too few markers, or 5D markers beside the z axis.
        DegenerateGeometryError: markers in one place, or 6D markers on one line.
    """
    p = as_points(positions_marker, at_least=3 if dof == 6 else 2, name="positions_marker")
    widths = np.linalg.svd(p - p.mean(axis=0), compute_uv=False)
    if widths[0] < MIN_WIDTH_MM or (dof == 6 and widths[1] < MIN_SPREAD * widths[0]):
        raise DegenerateGeometryError(
            f"{len(p)} markers lie in one place or on one line ({widths[0]:.3g} x {widths[1]:.3g} "
            f"mm): no {dof}D tool"
        )
    if dof == 5 and np.abs(p[:, :2]).max() > MAX_OFF_LINE_MM:
        raise InvalidInputError("the markers of a 5D tool must lie on the z axis of its frame")
    return p


def tracked_from_poses(
    Ts_tracker_marker: Poses, positions_marker: ArrayLike, noise: MarkerNoise, *, dof: int
) -> TrackedPoses:
    """Return poses with the covariance of an unweighted fit of all markers, as trackers make it.

    Args:
        Ts_tracker_marker: n measured poses.
        positions_marker: Marker geometry (m, 3) in mm.
        noise: What is assumed about single markers.
        dof: 6; or 5 for markers on the z axis of ``marker``, whose roll means nothing.

    Raises:
        InvalidInputError, DegenerateGeometryError: as in :func:`as_marker_positions`.
    """
    p = as_marker_positions(positions_marker, dof)
    covariances = fit_covariances(Ts_tracker_marker.rotations, p, noise)
    return TrackedPoses(
        Ts_tracker_marker=Ts_tracker_marker,
        reference_marker=readonly(p.mean(axis=0)),
        covariances=readonly(covariances),
    )


def fit_covariances(rotations: Floats, positions_marker: Floats, noise: MarkerNoise) -> Floats:
    """Return the covariances (n, 6, 6) of poses fitted to markers with an error of 1 mm 3D RMS.

    Args:
        rotations: Of the marker body in ``tracker`` (n, 3, 3).
        positions_marker: Markers (m, 3); on one line the turn about it counts as known.
        noise: Its shape; the size is 1.

    Returns:
        Covariances of (turn, shift of the centroid) in the axes of ``tracker``, rad and mm.
    """
    variances = np.asarray(noise.shape()) ** 2
    offsets = positions_marker - positions_marker.mean(axis=0)
    levers = np.einsum("nij,mj->nmi", rotations, offsets)
    crossed = cross_matrices(levers)
    inertia = np.einsum("nmij,nmkj->nik", crossed, crossed)
    torque = np.einsum("nmij,j,nmkj->nik", crossed, variances, crossed)
    if np.linalg.matrix_rank(offsets, tol=COLLINEAR_MM) < 2:
        inverse = np.linalg.pinv(inertia, rcond=1e-9, hermitian=True)
    else:
        inverse = np.linalg.inv(inertia)
    covariances = np.zeros((len(rotations), 6, 6))
    covariances[:, :3, :3] = inverse @ torque @ inverse
    covariances[:, 3:, 3:] = np.diag(variances) / len(offsets)
    return covariances


def fit_matrices(rotations: Floats, positions_marker: Floats) -> Floats:
    """Return what an error of each marker makes of an unweighted fit: (n, m, 6, 3).

    Args:
        rotations: Of the marker body in ``tracker`` (n, 3, 3).
        positions_marker: Markers (m, 3); on one line the turn about it counts as known.

    Returns:
        Derivatives of (turn, shift of the centroid) by the place of each marker, all in the axes of
        ``tracker``, in rad and mm.
    """
    offsets = positions_marker - positions_marker.mean(axis=0)
    crossed = cross_matrices(np.einsum("nij,mj->nmi", rotations, offsets))
    inertia = np.einsum("nmij,nmkj->nik", crossed, crossed)
    inverse = np.linalg.pinv(inertia, rcond=1e-9, hermitian=True)
    fits = np.zeros((*crossed.shape[:2], 6, 3))
    fits[:, :, :3] = inverse[:, None] @ crossed
    fits[:, :, 3:] = np.eye(3) / len(offsets)
    return fits


TYPICAL_DEPTH_MM = 1950.0  # at which the stated error of a tracker holds (RMS over its volume)
FIELD_LENGTH_MM = 400.0  # over which the fixed error of a tracker changes
# from a tenth of the width of a measuring volume to well beyond its depth, a quarter apart
LENGTHS_MM = readonly(np.geomspace(150.0, 2400.0, 13))
EVEN_WEIGHTS = readonly(np.full(len(LENGTHS_MM), 1.0 / len(LENGTHS_MM)))
NEGLIGIBLE = 0.01  # weight of a length that is left out
AT_ONCE = 64  # points whose distances to all are held together


@dataclass(frozen=True, slots=True)
class TrackerErrorField:
    """What is assumed of the fixed error of a marker in the volume of the tracker."""

    total_mm: float = 0.35  # 3D RMS over the volume, as the maker states it
    depth_ratio: float = 3.0  # in depth over laterally
    length_mm: float = FIELD_LENGTH_MM

    def covariance(self, points_tracker: Floats) -> Floats:
        """Return the covariance (3 n, 3 n) in mm^2 of the errors at points (n, 3)."""
        sigmas = self.sigmas_mm(points_tracker)
        apart = np.linalg.norm(points_tracker[:, None] - points_tracker[None], axis=2)
        alike = np.exp(-0.5 * (apart / self.length_mm) ** 2)
        blocks = np.einsum("nm,ni,mj,ij->nimj", alike, sigmas, sigmas, np.eye(3))
        return blocks.reshape(sigmas.size, sigmas.size)

    def sigmas_mm(self, points_tracker: Floats) -> Floats:
        """Return the standard deviations (n, 3) along the axes of ``tracker`` at points (n, 3)."""
        shares = np.array((1.0, 1.0, self.depth_ratio))
        shares = shares / np.linalg.norm(shares) * self.total_mm
        z = points_tracker[:, 2] / TYPICAL_DEPTH_MM
        return shares * np.stack((z, z, z * z), axis=1)  # two cameras: depth is worst far away


@dataclass(frozen=True, slots=True, eq=False)
class LearnedField:
    """The fixed error of a marker: its size as stated, its lengths as likely as ``weights``."""

    stated: TrackerErrorField  # its length does not count
    weights: Floats = field(default_factory=lambda: EVEN_WEIGHTS)  # (13,) of ``LENGTHS_MM``, sum 1

    def propagate(self, sensitivity: Floats, points_tracker: Floats) -> Floats:
        """Return the covariance (k, k) of what depends linearly on the error at points.

        Args:
            sensitivity: Derivatives (k, n, 3) by the error at each point.
            points_tracker: Places of markers (n, 3).
        """
        sigmas = self.stated.sigmas_mm(points_tracker)
        alike = np.zeros((len(points_tracker), len(points_tracker)))
        for start in range(0, len(points_tracker), AT_ONCE):
            some = slice(start, start + AT_ONCE)
            squares = cdist(points_tracker[some], points_tracker, "sqeuclidean")
            for length_mm, weight in zip(LENGTHS_MM, self.weights, strict=True):
                if weight > NEGLIGIBLE:
                    part = squares * (-0.5 / length_mm**2)
                    np.exp(part, out=part)
                    part *= weight
                    alike[some] += part
        alike /= self.weights[self.weights > NEGLIGIBLE].sum()
        spread = np.zeros((len(sensitivity), len(sensitivity)))
        for axis in range(3):  # one by one: all scaled at once take much memory
            scaled = sensitivity[:, :, axis] * sigmas[:, axis]
            spread += scaled @ alike @ scaled.T
        return spread

    def learn(
        self, residuals: Floats, sensitivity: Floats, points_tracker: Floats, noise: Floats
    ) -> "LearnedField":
        """Return the field with the lengths that explain residuals.

        Args:
            residuals: (k,) with what was fitted taken out.
            sensitivity: Derivatives (k, n, 3) by the error at each point, of the same.
            points_tracker: Places of markers (n, 3).
            noise: Covariance (k, k) of what else is in the residuals.
        """
        if self.stated.total_mm == 0.0:
            return self
        logs = np.zeros(len(LENGTHS_MM))
        for i in range(len(LENGTHS_MM)):
            alone = replace(self, weights=np.eye(len(LENGTHS_MM))[i])
            spread = alone.propagate(sensitivity, points_tracker) + noise
            root = np.linalg.cholesky(spread)
            white = np.linalg.solve(root, residuals)
            logs[i] = -0.5 * white @ white - np.log(np.diag(root)).sum()
        weights = np.exp(logs - logs.max())
        return replace(self, weights=readonly(weights / weights.sum()))
