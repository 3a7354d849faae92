"""Calibrate a pivot from files without a session: for the command line and scripts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from rona_core.calibration.handheld.imported_pivot import (
    RecordedPivotCalibration,
    calibrate_recorded_pivot,
)
from rona_core.devices.files.poses.pivot_recordings import RecordedPivot, read_pivot
from rona_core.devices.files.text_tables import NamedFile


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
            "verdict": found.verdict,
            "reasons": list(found.reasons),
        }


def report_pivot(
    files: Sequence[NamedFile],
    *,
    geometry: NamedFile | None = None,
    tool: str | None = None,
    dof: int = 6,
    method: str = "ml",
) -> PivotReport:
    """Read files as ``devices.pivot_files.read_pivot`` does, and calibrate the tip.

    Raises:
        InvalidInputError: the files hold no poses; it says which line.
        DegenerateGeometryError: markers that determine no pose.
    """
    pivot = read_pivot(files, geometry=geometry, tool=tool, dof=dof)
    calibration = calibrate_recorded_pivot(
        pivot.track.Ts_tracker_marker,
        dof=dof,
        method=method,
        geometry_marker=pivot.geometry_marker,
    )
    return PivotReport(pivot, calibration)
