"""Pivots from files: what was read, checked and calibrated, for terminal, REST and page alike."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from rona_core.calibration.handheld.pointer import (
    MIN_POSES,
    PointerCalibration,
    RecordedPivotCalibration,
    calibrate_recorded_pivot,
    pointer_calibration,
    solve_recorded_pivot,
)
from rona_core.calibration.pivot.motion_extent import require_swing
from rona_core.calibration.pivot.pivot_calibration import PivotMethod
from rona_core.calibration.pivot.pose_convention import require_convention
from rona_core.calibration.tracking_error import MarkerNoise
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.recorded_poses import PLAIN, RecordedPivot, read_pivot
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Poses
from rona_core.session.captures import PointerCapture


@dataclass(frozen=True, slots=True, eq=False)
class PivotReport:
    """What was read, and what follows from it."""

    pivot: RecordedPivot
    calibration: RecordedPivotCalibration

    def figures(self) -> dict[str, Any]:
        """Return the figures as plain values: mm, tip in marker and pivot in tracker."""
        found = self.calibration
        return {
            "tip_mm": None if found.tip_marker is None else found.tip_marker.tolist(),
            "pivot_mm": None if found.pivot_tracker is None else found.pivot_tracker.tolist(),
            "sigma_mm": found.sigma_mm,
            "rmse_mm": found.rmse_mm,
            "n_used": found.n_used,
            "n_rejected": found.n_rejected,
            "n_repeated": found.n_repeated,
            "verdict": found.verdict,
            "reasons": list(found.reasons),
            "notes": list(self.pivot.poses.notes),
        }


def report_pivot(
    files: Sequence[NamedFile | Path | str],
    layout: PoseLayout = PLAIN,
    *,
    geometry: NamedFile | None = None,
    dof: int = 6,
    method: str = "ml",
) -> PivotReport:
    """Read files as `read_pivot` does, and calibrate the tip.

    Raises:
        InvalidInputError: the files hold no poses, it says which line; or poses in another
            convention, with its name.
        DegenerateGeometryError: markers that determine no pose.
    """
    pivot = read_pivot(files, layout, geometry=geometry, dof=dof)
    geometry_marker, noise = known_markers(pivot.track.tool, pivot.poses.geometry_marker)
    try:
        calibration = calibrate_recorded_pivot(
            pivot.track.Ts_tracker_marker,
            dof=dof,
            method=method,
            geometry_marker=geometry_marker,
            noise=noise,
            direction_known=pivot.direction_known,
        )
    except InvalidInputError as error:
        raise InvalidInputError(f"{pivot.poses.name}: {error}", **error.data) from error
    return PivotReport(pivot, calibration)


def require_marker_poses(poses: Poses, name: str, *, dof: int, direction_known: bool) -> None:
    """Refuse a pivot from a file as `report_pivot` would, where its convention is another.

    Too few poses, or poses that turned too little to show it, are left to the calibration.

    Raises:
        InvalidInputError: the convention, with its name.
    """
    if len(poses) < MIN_POSES:
        return
    try:
        require_swing(poses.rotations, dof)
        require_convention(poses, dof=dof, direction_known=direction_known)
    except DegenerateGeometryError:
        return
    except InvalidInputError as error:
        raise InvalidInputError(f"{name}: {error}", **error.data) from error


def known_markers(
    tool: str, geometry_marker: Floats | None
) -> tuple[Floats | None, MarkerNoise | None]:
    """Return markers (m, 3) and what is known of their noise: those of a file, or of our tools."""
    if geometry_marker is None and tool in GEOMETRIES:
        return GEOMETRIES[tool].positions_marker, MarkerNoise()
    return geometry_marker, None


def calibrate_imported(
    capture: PointerCapture, *, method: PivotMethod, exclude: ArrayLike | None
) -> PointerCalibration:
    """Return the calibration of an imported pivot: tip, verdict and reasons of `report_pivot`.

    Raises:
        InvalidInputError: too few poses.
        DegenerateGeometryError: the poses determine no tip.
    """
    dof = GEOMETRIES[capture.pointer].dof
    geometry_marker, noise = known_markers(capture.marker.tool, capture.geometry_marker)
    fit = solve_recorded_pivot(
        capture.marker.Ts_tracker_marker,
        dof=dof,
        method=method,
        geometry_marker=geometry_marker,
        noise=noise,
        exclude=exclude,
    )
    return pointer_calibration(fit, pointer=capture.pointer, dof=dof, method=method)
