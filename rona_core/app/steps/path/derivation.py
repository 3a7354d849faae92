"""Scan path from the demonstrated stroke."""

import numpy as np

from rona_core.app.dependencies.base_reference import reference_of
from rona_core.app.dependencies.inputs import require_result
from rona_core.app.steps.path.messages import BuildPath, GenerateScanPattern
from rona_core.app.steps.path.painting import CLEARANCE_MM, allowed_in_patch
from rona_core.app.steps.surface.derivation import tip_track
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Vector3
from rona_core.geometry.rigid_fit import fit_plane
from rona_core.geometry.surface.surface_pick import project_to_surface
from rona_core.path.height_field import fit_height_field
from rona_core.path.scan_patterns import patch_pose, raster, spiral
from rona_core.session.document import RawPath, Session

RIM_CORNERS = 72  # of a round boundary
PATTERN_STEP_MM = 1.0


def derive_path(session: Session, message: BuildPath) -> RawPath:
    """Map the demonstrated stroke to ``base``.

    Raises:
        DegenerateGeometryError: the pointer was seen in fewer than two frames.
    """
    capture = require_result(session.captures.path, "demonstrate the scan path")
    points_base = tip_track(session, capture)
    if len(points_base) < 2:
        raise DegenerateGeometryError(
            f"the tracker saw the pointer in {len(points_base)} frames of the demonstration, "
            "2 are the least: uncover the pointer"
        )
    return RawPath(points_base)


def is_pattern(session: Session) -> bool:
    """Return whether the path is a pattern drawn by rule, not a demonstration."""
    path = session.results.path
    return path is not None and path.message == GenerateScanPattern.__name__


def viewpoint_base(session: Session) -> Vector3:
    """Return where the pointer's markers were while it drew: the side the probe comes from."""
    if is_pattern(session) or session.captures.path is None:
        strokes = require_result(session.captures.surface, "slide the pointer over the skull")
    else:
        strokes = (session.captures.path,)
    seen = [
        reference_of(session, stroke).T_base_tracker @ stroke.marker.Ts_tracker_marker.translations
        for stroke in strokes
    ]
    return np.vstack(seen).mean(axis=0)


def derive_pattern(
    session: Session, message: GenerateScanPattern, *, clearance_mm: float = CLEARANCE_MM
) -> RawPath:
    """Make a path by rule on the measured surface; no other surface is looked at.

    Args:
        session: Holds the surface, and what was painted on it.
        message: What is wanted.
        clearance_mm: Kept to what is to be avoided.

    Raises:
        DegenerateGeometryError: the surface was not sampled there, or the boundary cuts the
            pattern into parts.
    """
    cloud = require_result(session.results.surface, "sample the surface").value.points_base
    radius_mm = message.radius_mm or session.setup.region.radius_mm
    boundary = np.array(message.boundary_base_mm, dtype=np.float64).reshape(-1, 3)
    center, painted = message.center_base_mm, session.painted
    if center is None:
        center = np.median(cloud if not len(boundary) else boundary, axis=0)
    center = project_to_surface(cloud, center)
    if not len(boundary) and message.radius_mm is None:
        radius_mm = max(radius_mm, painted.reach_mm(center))
    near = cloud[np.linalg.norm(cloud - center, axis=1) <= radius_mm]
    plane = fit_plane(near)
    outward = 1.0 if plane.normal @ (viewpoint_base(session) - center) > 0 else -1.0
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
