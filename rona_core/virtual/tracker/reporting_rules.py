"""Tracking status of a tool, by NDI's documented order of checks.

Marker angle, then volume, then number of markers, then largest 3D error, then spread; a tool that
passes none of these has no pose, and its status names the first rule it broke.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rona_core.devices.marker_geometry import MarkerGeometry
from rona_core.devices.samples import ToolStatus
from rona_core.geometry.arrays import Bools, Floats
from rona_core.virtual.tracker.marker_fit import MarkerFit, fit_body, fit_line

MIN_MARKERS = {6: 3, 5: 2}  # by degrees of freedom of the tool
MAX_3D_ERROR_MM = 2.0  # of a marker from where the fit has it: what tool files have by default
MIN_SPREAD_MM = 10.0  # extent of the markers used; of 6D tools also across


@dataclass(frozen=True, slots=True, eq=False)
class ToolReport:
    """What the tracker makes of one tool in one frame; ``fit`` is None while it is not seen."""

    status: ToolStatus
    fit: MarkerFit | None = None


def report_tool(
    geometry: MarkerGeometry,
    measured_tracker: Floats,
    *,
    facing: Bools,
    inside: Bools,
    clear: Bools,
    swapped: Sequence[int] | None = None,
) -> ToolReport:
    """Return the status of a tool, and its pose if it has one.

    Args:
        geometry: Markers of the tool.
        measured_tracker: Measured positions (m, 3).
        facing: Which markers (m,) look at the cameras.
        inside: Which lie in the volume.
        clear: Which both cameras see, with nothing in between.
        swapped: Two markers that are taken for each other, the third being lost; None as a rule.
    """
    if not facing.any():
        return ToolReport("out_of_view")
    if not inside.any():
        return ToolReport("out_of_volume")
    seen = facing & inside & clear
    if np.count_nonzero(seen) < MIN_MARKERS[geometry.dof]:
        hidden = (facing & inside).any() and not seen.any()
        return ToolReport("missing" if hidden else "too_few_markers")
    result = fit_markers(geometry, measured_tracker, seen, swapped)
    if result.fit is not None and (facing & ~inside).any():
        return ToolReport("partially_out_of_volume", result.fit)
    return result


def fit_markers(
    geometry: MarkerGeometry,
    measured_tracker: Floats,
    seen: Bools,
    swapped: Sequence[int] | None = None,
) -> ToolReport:
    """Return the pose from the markers that are seen, without those that are too far off."""
    numbers = np.flatnonzero(seen)
    model = geometry.positions_marker
    if swapped is not None:
        numbers = np.array(swapped if seen[list(swapped)].all() else numbers[:2])
        return ToolReport("ok", fit_line(model[numbers], measured_tracker[numbers[::-1]]))
    fit_tool = fit_body if geometry.dof == 6 else fit_line
    while True:
        fit = fit_tool(model[numbers], measured_tracker[numbers])
        # no residual exceeds the root of the sum of their squares
        if fit.rms_error_mm * np.sqrt(len(numbers)) > MAX_3D_ERROR_MM:
            off = fit.T_tracker_marker @ model[numbers] - measured_tracker[numbers]
            errors_mm = np.linalg.norm(off, axis=1)
            if errors_mm.max() > MAX_3D_ERROR_MM:
                if len(numbers) == MIN_MARKERS[geometry.dof]:
                    return ToolReport("bad_fit")
                numbers = np.delete(numbers, np.argmax(errors_mm))
                continue
        used = model[numbers]
        if not _spread(used.tobytes(), geometry.dof):
            return ToolReport("low_spread")
        return ToolReport("ok", fit)


@lru_cache(maxsize=256)
def _spread(positions_marker: bytes, dof: int) -> bool:
    """Return whether markers (m, 3) lie far enough apart; they are hashed as bytes."""
    points = np.frombuffer(positions_marker).reshape(-1, 3)
    axes = np.linalg.svd(points - points.mean(axis=0))[2]
    extent = np.ptp(points @ axes.T, axis=0)
    return bool((extent[: 2 if dof == 6 else 1] >= MIN_SPREAD_MM).all())
