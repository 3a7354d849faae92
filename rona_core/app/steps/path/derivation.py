"""Scan path from the demonstrated stroke."""

import numpy as np

from rona_core.app.steps.path.inputs import (
    CLEARANCE_MM,
    PathInputs,
    PatternInputs,
    PointsInputs,
    allowed_in_patch,
)
from rona_core.app.steps.path.messages import BuildPath, GenerateScanPattern, TakePathPoints
from rona_core.app.steps.surface.derivation import tip_track
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.rigid_fit import fit_plane
from rona_core.geometry.surface.surface_pick import project_to_surface
from rona_core.path.height_field import fit_height_field
from rona_core.path.scan_patterns import patch_pose, raster, spiral
from rona_core.path.zones import PaintedRegions
from rona_core.session.document import RawPath

RIM_CORNERS = 72  # of a round boundary
PATTERN_STEP_MM = 1.0


def map_path(known: PathInputs, message: BuildPath) -> RawPath:
    """Map the demonstrated stroke to ``base``.

    Raises:
        DegenerateGeometryError: the pointer was seen in fewer than two frames.
    """
    points_base = tip_track(known.stroke, known.registered, known.pointer, known.head)
    if len(points_base) < 2:
        raise DegenerateGeometryError(
            f"the tracker saw the pointer in {len(points_base)} frames of the demonstration, "
            "2 are the least: uncover the pointer"
        )
    return RawPath(points_base)


def path_from_elsewhere(known: PointsInputs, message: TakePathPoints) -> RawPath:
    """Return the points of a path that was drawn elsewhere."""
    return RawPath(known.capture.points_base)


def draw_pattern(
    known: PatternInputs, message: GenerateScanPattern, *, clearance_mm: float = CLEARANCE_MM
) -> RawPath:
    """Make a path by rule on the measured surface; no other surface is looked at.

    Args:
        known: The surface, and what was painted on it.
        message: What is wanted.
        clearance_mm: Kept to what is to be avoided.

    Raises:
        DegenerateGeometryError: the surface was not sampled there, or the boundary cuts the
            pattern into parts.
    """
    cloud = known.cloud.points_base
    radius_mm = message.radius_mm or known.radius_mm
    boundary = np.array(message.boundary_base_mm, dtype=np.float64).reshape(-1, 3)
    center, painted = message.center_base_mm, known.painted or PaintedRegions()
    if center is None:
        center = np.median(cloud if not len(boundary) else boundary, axis=0)
    center = project_to_surface(cloud, center)
    if not len(boundary) and message.radius_mm is None:
        radius_mm = max(radius_mm, painted.reach_mm(center))
    near = cloud[np.linalg.norm(cloud - center, axis=1) <= radius_mm]
    plane, seen_from = fit_plane(near), known.viewpoint
    outward = 1.0 if plane.normal @ (seen_from - center) > 0 else -1.0
    level = patch_pose(center, outward * plane.normal)
    angle = np.deg2rad(message.turn_deg)
    along = np.cos(angle) * level.rotation[:, 0] + np.sin(angle) * level.rotation[:, 1]
    T_base_patch = patch_pose(center, outward * plane.normal, along)
    turns = np.linspace(0.0, 2.0 * np.pi, RIM_CORNERS, endpoint=False)
    rim = radius_mm * np.column_stack((np.cos(turns), np.sin(turns)))
    corners = (T_base_patch.inv() @ boundary)[:, :2] if len(boundary) else rim
    make = raster if message.kind == "raster" else spiral
    made = make(
        T_base_patch,
        corners,
        fit_height_field(cloud, T_base_patch),
        spacing_mm=message.spacing_mm,
        margin_mm=message.margin_mm,
        step_mm=PATTERN_STEP_MM,
        allowed=allowed_in_patch(
            painted, T_base_patch, clearance_mm=clearance_mm, margin_mm=message.margin_mm
        ),
    )
    if made.stroke[-1] > 0:
        raise DegenerateGeometryError(
            f"the boundary cuts the pattern into {made.stroke[-1] + 1} strokes, but the probe "
            "stays on the bone: draw a boundary without dents, choose another direction, or move "
            "the centre into its middle"
        )
    return RawPath(made.points_base)
