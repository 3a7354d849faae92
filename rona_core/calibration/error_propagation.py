"""Error propagation from the calibrations to touched points in ``base``, to first order.

    tip_base = T_base_tracker T_tracker_pointermarker tip_pointermarker

Three errors meet: that of the registration (the same for all places), that of the calibrated tip
(turns with the pointer) and that of the single frame (new in each, so averaging reduces it). A bias
that all frames share may be added; averaging does not touch it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from rona_core.calibration.tracking_error import MarkerNoise, fit_covariances
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Floats, Vector3, as_points, as_vector3, readonly
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import as_covariance, cross_matrices, point_jacobians


@dataclass(frozen=True, slots=True, eq=False)
class MapError:
    """Expected errors of places in ``base``: covariances in mm^2 and what they add up to."""

    registration: Floats  # (n, 3, 3) from T_base_tracker
    pointer: Floats  # (n, 3, 3) from the calibrated tip
    frame: Floats  # (n, 3, 3) from the frames that were averaged
    total: Floats  # (n, 3, 3) of these and of the shared bias
    registration_rms_mm: float  # 3D RMS over the places, as all that follow
    pointer_rms_mm: float
    frame_rms_mm: float
    rms_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class MapSetup:
    """What a prediction of the map needs to know."""

    T_base_tracker: Pose
    registration: Floats  # (12, 12) of T_base_tracker and T_toolmarker_tip, or (6, 6)
    tip_pointermarker: Vector3  # (3,)
    tip_covariance: Floats  # (3, 3) mm^2, in pointermarker
    positions_pointermarker: Floats  # (m, 3) markers
    noise: MarkerNoise  # with its size
    n_averaged: int = 1  # frames averaged at each place
    bias_mm: float = 0.0  # 3D RMS that averaging leaves: tracker's volume, robot's workspace

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InvalidInputError: a covariance of the wrong shape, a noise without size, a count or
                bias out of range.
        """
        size = 12 if np.shape(self.registration) == (12, 12) else 6
        object.__setattr__(
            self,
            "registration",
            readonly(as_covariance(self.registration, size, name="covariance")),
        )
        object.__setattr__(
            self,
            "tip_covariance",
            readonly(as_covariance(self.tip_covariance, 3, name="covariance")),
        )
        as_vector3(self.tip_pointermarker, name="tip_pointermarker")
        as_points(self.positions_pointermarker, at_least=3, name="positions_pointermarker")
        if self.noise.sigma_mm is None:
            raise InvalidInputError("the noise needs a size: give MarkerNoise(sigma_mm=...)")
        if self.n_averaged < 1 or self.bias_mm < 0.0:
            raise InvalidInputError("n_averaged must be 1 or more, and bias_mm not negative")


def pose_covariance(
    T_tracker_marker: Pose, positions_marker: ArrayLike, noise: MarkerNoise, n_averaged: int = 1
) -> Floats:
    """Return the covariance (6, 6) of a pose that the tracker fits to its markers.

    Args:
        T_tracker_marker: The pose.
        positions_marker: Markers (m, 3); on one line the turn about it, which moves no tip on that
            line, counts as known.
        noise: Of one marker, with its size.
        n_averaged: Frames averaged.
    """
    positions = as_points(positions_marker, at_least=3, name="positions_marker")
    central = fit_covariances(T_tracker_marker.rotation[None], positions, noise)[0]
    change = np.eye(6)  # from the centroid of the markers to the origin of their frame
    change[3:, :3] = cross_matrices(T_tracker_marker.rotation @ positions.mean(axis=0))
    return (noise.sigma_mm or 0.0) ** 2 / n_averaged * change @ central @ change.T


def predict_map_error(setup: MapSetup, Ts_tracker_pointermarker: Poses) -> MapError:
    """Return the expected error of the touched places for poses of the pointer (n)."""
    tip = np.asarray(setup.tip_pointermarker, dtype=np.float64)
    R_base_tracker = setup.T_base_tracker.rotation
    J = point_jacobians(setup.T_base_tracker, Ts_tracker_pointermarker @ tip)
    registration = J @ setup.registration[:6, :6] @ np.swapaxes(J, 1, 2)
    R_base_pointermarker = R_base_tracker @ Ts_tracker_pointermarker.rotations
    pointer = R_base_pointermarker @ setup.tip_covariance @ np.swapaxes(R_base_pointermarker, 1, 2)
    frame = np.zeros_like(pointer)
    for i, T_tracker_pointermarker in enumerate(Ts_tracker_pointermarker):
        covariance = pose_covariance(
            T_tracker_pointermarker, setup.positions_pointermarker, setup.noise, setup.n_averaged
        )
        J_base = R_base_tracker @ point_jacobians(T_tracker_pointermarker, tip[None])[0]
        frame[i] = J_base @ covariance @ J_base.T
    total = registration + pointer + frame + setup.bias_mm**2 / 3.0 * np.eye(3)
    return MapError(
        registration=readonly(registration),
        pointer=readonly(pointer),
        frame=readonly(frame),
        total=readonly(total),
        registration_rms_mm=_rms_mm(registration),
        pointer_rms_mm=_rms_mm(pointer),
        frame_rms_mm=_rms_mm(frame),
        rms_mm=_rms_mm(total),
    )


def _rms_mm(covariances: Floats) -> float:
    traces = np.trace(covariances, axis1=1, axis2=2)
    return float(np.sqrt(traces.mean())) if len(traces) else 0.0
