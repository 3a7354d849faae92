"""Pose fit of a tracked tool from measured markers, as the tracker's firmware does it."""

from dataclasses import dataclass

import numpy as np

from rona_core.geometry.arrays import Floats, Vector3
from rona_core.geometry.pose import Pose


@dataclass(frozen=True, slots=True, eq=False)
class MarkerFit:
    """Pose of ``marker`` in ``tracker`` and how badly the markers fit the known geometry."""

    T_tracker_marker: Pose
    rms_error_mm: float


def fit_body(positions_marker: Floats, points_tracker: Floats) -> MarkerFit:
    """Return the least-squares pose of a 6D tool from at least three markers (n, 3) not in a line.

    Kabsch 1976 by singular value decomposition.
    """
    model_mean, mean = positions_marker.mean(axis=0), points_tracker.mean(axis=0)
    model = positions_marker - model_mean
    u, _, vt = np.linalg.svd((points_tracker - mean).T @ model)
    u[:, 2] *= np.linalg.det(u) * np.linalg.det(vt)
    rotation = u @ vt
    translation = mean - rotation @ model_mean
    return _result(rotation, translation, positions_marker, points_tracker)


def fit_line(positions_marker: Floats, points_tracker: Floats) -> MarkerFit:
    """Return the pose of a 5D tool from at least two markers (n, 3) on the z axis of ``marker``.

    Position and direction are least squares. The roll about the line cannot be seen: the rotation
    returned is the smallest one that takes the z axis of ``tracker`` to the line.
    """
    along = positions_marker[:, 2]
    centred = along - along.mean()
    direction = centred @ points_tracker
    direction /= np.linalg.norm(direction)
    translation = points_tracker.mean(axis=0) - along.mean() * direction
    return _result(smallest_rotation(direction), translation, positions_marker, points_tracker)


def smallest_rotation(direction: Vector3) -> Floats:
    """Return the smallest rotation (3, 3) that takes (0, 0, 1) to a unit vector (3,).

    For the opposite direction, where it is not unique, the half turn about x is taken.
    """
    x, y, z = direction
    lateral = x * x + y * y
    if z < 0.0 and lateral < 1e-24:
        return np.diag((1.0, -1.0, -1.0))
    a = 1.0 / (1.0 + z) if z > 0.0 else (1.0 - z) / lateral  # the same, without cancellation
    return np.array(
        (
            (1.0 - a * x * x, -a * x * y, x),
            (-a * x * y, 1.0 - a * y * y, y),
            (-x, -y, z),
        )
    )


def _result(rotation: Floats, translation: Vector3, model: Floats, points: Floats) -> MarkerFit:
    residuals = model @ rotation.T + translation - points
    rms_error_mm = float(np.sqrt((residuals**2).sum() / len(points)))
    return MarkerFit(Pose(rotation, translation), rms_error_mm)
