"""Tracking status and pose of a tool in many frames, by NDI's documented order of checks.

Marker angle, then volume, then number of markers, then their spread, then the largest 3D error; a
tool that passes none of these has no pose, and its status names the first rule it broke.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rona_core.devices.samples import ToolColumn, ToolStatus
from rona_core.devices.trackers import MarkerGeometry
from rona_core.geometry.arrays import Bools, Floats, Ints
from rona_core.geometry.pose import Poses
from rona_core.geometry.rigid_fit import ManyFits, fit_line_many, fit_rigid_many

MIN_MARKERS = {6: 3, 5: 2}  # by degrees of freedom of the tool
MAX_3D_ERROR_MM = 2.0  # of a marker from where the fit has it: what tool files have by default
MIN_SPREAD_MM = 10.0  # extent of the markers used; of 6D tools also across


def report_tool(
    geometry: MarkerGeometry,
    measured_tracker: Floats,
    *,
    facing: Bools,
    inside: Bools,
    clear: Bools,
    swapped: Ints | None = None,
) -> ToolColumn:
    """Return the status of a tool in n frames, and its pose where it has one.

    Args:
        geometry: Markers of the tool.
        measured_tracker: Measured positions (n, m, 3).
        facing: Which markers (n, m) look at the cameras.
        inside: Which lie in the volume.
        clear: Which both cameras see, with nothing in between.
        swapped: Two markers (n, 2) that are taken for each other, the third being lost; -1 where
            none are.
    """
    seen = facing & inside & clear
    few = seen.sum(axis=1) < MIN_MARKERS[geometry.dof]
    hidden = (facing & inside).any(axis=1) & ~seen.any(axis=1)
    checks: dict[ToolStatus, Bools] = {
        "out_of_view": np.asarray(~facing.any(axis=1)),
        "out_of_volume": np.asarray(~inside.any(axis=1)),
        "missing": np.asarray(few & hidden),
        "too_few_markers": np.asarray(few),
    }
    n = len(measured_tracker)
    statuses = np.full(n, "ok", dtype=object)
    for status, broken in reversed(checks.items()):  # the first rule broken has the last word
        statuses[broken] = status
    poses = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3)), np.zeros(n)
    rows = np.flatnonzero(statuses == "ok")
    if swapped is not None:
        turned = rows[(swapped[rows] >= 0).all(axis=1)]
        rows = np.setdiff1d(rows, turned)
        if len(turned):
            pairs = _fit_swapped(geometry, measured_tracker, seen, swapped, turned)
            _keep(poses, turned, pairs)
    _fit_rows(geometry, measured_tracker, seen, rows, statuses, poses)
    fitted = np.asarray(statuses == "ok")
    partly = fitted & np.asarray((facing & ~inside).any(axis=1))
    statuses[partly] = "partially_out_of_volume"
    rotations, translations, rms_error_mm = poses
    Ts_tracker_marker = Poses.unchecked(rotations, translations)
    return ToolColumn(geometry.tool, statuses.tolist(), fitted, Ts_tracker_marker, rms_error_mm)


def _keep(poses: tuple[Floats, Floats, Floats], rows: Ints, fits: ManyFits) -> None:
    """Enter fits into rotations, translations and RMS errors."""
    for kept, found in zip(
        poses, (fits.Ts_b_a.rotations, fits.Ts_b_a.translations, fits.rms_mm), strict=True
    ):
        kept[rows] = found


def _fit_rows(
    geometry: MarkerGeometry,
    measured_tracker: Floats,
    seen: Bools,
    rows: Ints,
    statuses: NDArray[np.object_],
    poses: tuple[Floats, Floats, Floats],
) -> None:
    """Enter the fits of some frames; the marker that is furthest off goes first, while one is."""
    used = seen.copy()
    while len(rows):
        spread = _spread_enough(geometry, used[rows])
        statuses[rows[~spread]] = "low_spread"
        rows = rows[spread]
        if not len(rows):
            return
        fits = _fit(geometry, measured_tracker[rows], used[rows])
        misfits_mm = _misfits_mm(geometry, fits, measured_tracker[rows], used[rows])
        off = misfits_mm.max(axis=1) > MAX_3D_ERROR_MM
        _keep(poses, rows[~off], ManyFits(fits.Ts_b_a.select(~off), fits.rms_mm[~off]))
        least = used[rows].sum(axis=1) == MIN_MARKERS[geometry.dof]
        statuses[rows[off & least]] = "bad_fit"
        again = off & ~least
        used[rows[again], misfits_mm[again].argmax(axis=1)] = False
        rows = rows[again]


def _fit(geometry: MarkerGeometry, measured_tracker: Floats, used: Bools) -> ManyFits:
    """Return the least-squares poses from the markers used (n, m)."""
    if geometry.dof == 6:
        return fit_rigid_many(geometry.positions_marker, measured_tracker, used)
    return fit_line_many(geometry.positions_marker[:, 2], measured_tracker, used)


def _misfits_mm(
    geometry: MarkerGeometry, fits: ManyFits, measured_tracker: Floats, used: Bools
) -> Floats:
    """Return how far (n, m) each marker used lies from where the fit has it; 0 for the others."""
    off = fits.Ts_b_a.map_points(geometry.positions_marker) - measured_tracker
    return np.where(used, np.linalg.norm(off, axis=2), 0.0)


def _fit_swapped(
    geometry: MarkerGeometry, measured_tracker: Floats, seen: Bools, swapped: Ints, frames: Ints
) -> ManyFits:
    """Return the poses of lines in some frames whose two markers are taken for each other.

    Where one of the two is not seen, the first two that are seen are taken.
    """
    measured_tracker, seen, swapped = measured_tracker[frames], seen[frames], swapped[frames]
    rows = np.arange(len(seen))[:, None]
    there = np.asarray(seen[rows, swapped].all(axis=1))[:, None]
    pairs = np.where(there, swapped, np.argsort(~seen, axis=1, kind="stable")[:, :2])
    exchanged = measured_tracker.copy()
    exchanged[rows, pairs] = measured_tracker[rows, pairs[:, ::-1]]
    used = np.zeros_like(seen)
    used[rows, pairs] = True
    return fit_line_many(geometry.positions_marker[:, 2], exchanged, used)


def _spread_enough(geometry: MarkerGeometry, used: Bools) -> Bools:
    """Return in which frames (n,) the markers used (n, m) lie far enough apart."""
    numbers = used @ (1 << np.arange(used.shape[1]))  # of the patterns, as binary digits
    _, first, of_row = np.unique(numbers, return_index=True, return_inverse=True)
    model = geometry.positions_marker
    enough = [_spread(model[pattern].tobytes(), geometry.dof) for pattern in used[first]]
    return np.array(enough, dtype=np.bool_)[of_row]


@lru_cache(maxsize=256)
def _spread(positions_marker: bytes, dof: int) -> bool:
    """Return whether markers (m, 3) lie far enough apart; they are hashed as bytes."""
    points = np.frombuffer(positions_marker).reshape(-1, 3)
    axes = np.linalg.svd(points - points.mean(axis=0))[2]
    extent = np.ptp(points @ axes.T, axis=0)
    return bool((extent[: 2 if dof == 6 else 1] >= MIN_SPREAD_MM).all())
