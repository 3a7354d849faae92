"""Figures of steps 5 to 7: demonstrated path, simplification, normals and plan."""

from typing import TYPE_CHECKING

import numpy as np

from rona_core.app.dependencies.staleness import made_of
from rona_core.evaluation.figures import Figures
from rona_core.evaluation.truth import Truth
from rona_core.geometry.arrays import Floats, Ints
from rona_core.path.path_samples import filter_path
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.ultrasound.probe.probe_model import probe_model

if TYPE_CHECKING:
    from rona_core.geometry.path5d import Path5D
    from rona_core.robot.planning.plan import RobotPlan
    from rona_core.session.document import Session

PATTERN = "GenerateScanPattern"  # the message that makes a path without a demonstration


def smoothing_figures(session: "Session") -> Figures:
    """Return the number of points left, and K1 to the samples before and after filtering.

    The filter is no result of its own: it is applied again with the settings of the simplification.
    """
    smoothing, raw, capture = session.results.smoothing, session.results.path, session.captures.path
    figures: Figures = {}
    if smoothing is None:
        return figures
    value, kept = smoothing.value, smoothing.value.simplified.index
    figures["path_points_smoothed"] = len(kept)
    if raw is None or not made_of(smoothing, "edits", session.path_edits):
        return figures  # its numbers count on other changes by hand
    if raw.message == PATTERN or len(session.path_edits):
        if made_of(smoothing, "path", raw.value):
            figures["path_deviation_max_mm"] = float(value.from_filtered_mm.max())
            figures["path_deviation_raw_max_mm"] = float(value.from_raw_mm.max())
        return figures
    if capture is None or len(raw.value.points_base) != value.simplified.n_original:
        return figures  # the demonstration has been taken again since
    samples = raw.value.points_base
    given = filter_path(samples, capture.marker.times_s, filter_width_s(smoothing.arguments))
    figures["path_deviation_max_mm"] = deviation_max_mm(given, kept, given[kept])
    figures["path_deviation_raw_max_mm"] = deviation_max_mm(samples, kept, given[kept])
    return figures


def filter_width_s(arguments: dict[str, object]) -> float:
    """Return the width of the filter that a smoothing was asked for; 0 for none."""
    width = arguments.get("filter_s", 0.0)
    return float(width) if isinstance(width, int | float) else 0.0


def deviation_max_mm(points: Floats, kept: Ints, nodes: Floats) -> float:
    """Return K1: the largest distance of samples to the segment that replaces them.

    Args:
        points: Samples (n, 3).
        kept: Indices (k,) of the samples that the path keeps, ascending, first and last included.
        nodes: Positions (k, 3) of the path's points; segment j replaces samples kept[j] to
            kept[j + 1]. They differ from ``points[kept]`` where the samples were filtered before.
    """
    worst = 0.0
    for j in range(len(kept) - 1):
        between = points[kept[j] : kept[j + 1] + 1]
        worst = max(worst, float(to_segment_mm(between, nodes[j], nodes[j + 1]).max()))
    if len(kept) == 1:
        worst = float(np.linalg.norm(points - nodes[0], axis=1).max())
    return worst


def to_segment_mm(points: Floats, start: Floats, end: Floats) -> Floats:
    """Return the distance of each point (n, 3) to a segment, not to its line."""
    along = end - start
    length2 = float(along @ along)
    share = np.clip((points - start) @ along / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
    nearest = start + np.multiply.outer(share, along)
    return np.linalg.norm(points - nearest, axis=1)


def normal_figures(path: "Path5D", truth: Truth) -> Figures:
    """Return median and 95th percentile of the angle between probe axis and true inward normal.

    The true one is that of the bone below the probe's crystal.
    """
    radius_mm = probe_model(truth.scene.settings.probe).aperture_radius_mm
    normals = truth.face_normals(path.points_base, radius_mm)
    cosine = -(path.axes_base * normals).sum(axis=1)
    sine = np.linalg.norm(np.cross(path.axes_base, normals), axis=1)
    angles_deg = np.rad2deg(np.arctan2(sine, cosine))
    return {
        "normal_error_median_deg": float(np.median(angles_deg)),
        "normal_error_p95_deg": float(np.percentile(angles_deg, 95.0)),
    }


def plan_figures(plan: "RobotPlan") -> Figures:
    """Return how many rolls were tried, how the chosen one fares, and how long the scan takes."""
    search, trajectory, certificate = plan.search, plan.trajectory, plan.certificate
    least_deg, chosen = None, search.mode != "none"
    if trajectory is not None:
        times_s = trajectory.times_s
        scanning = (times_s >= trajectory.scan_start_s) & (times_s <= trajectory.scan_end_s)
        room_rad = robot_model(plan.model).limits.clearance_rad(trajectory.qs_rad[scanning])
        least_deg = float(np.rad2deg(room_rad.min())) if scanning.any() else None
    return {
        "rolls_tried": len(search.verdicts),
        "rolls_feasible": sum(verdict.feasible for verdict in search.verdicts),
        "roll_mode": search.mode,
        "min_clearance_mm": None if certificate is None else certificate.min_clearance_mm,
        "roll_variation_deg": search.roll_variation_deg if chosen else None,
        "min_joint_margin_deg": least_deg,
        "scan_duration_s": None if trajectory is None else trajectory.duration_s,
    }
