"""Compute step 6 from path and surface: fewer points, changes by hand, normals, the dense path."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.dependencies.base_reference import reference_of
from rona_core.app.dependencies.inputs import is_pattern, need
from rona_core.app.messages.registry import GenerateScanPattern, SmoothScanPath
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, Vector3, readonly
from rona_core.geometry.rigid_fit import fit_plane
from rona_core.path.densify import densify, insert_waypoints
from rona_core.path.height_field import fit_height_field
from rona_core.path.manual_edits import EditedPath, distances_to_edited, edit_path
from rona_core.path.scan_patterns import patch_pose, raster, spiral
from rona_core.path.simplification.error_bound import ErrorBound
from rona_core.path.simplification.simplify import SimplifiedPath, simplify
from rona_core.path.temporal_filter import filter_path
from rona_core.session.document import RawPath, Session, SmoothPath
from rona_core.surface.normals.normals import NormalField
from rona_core.surface.surface_pick import project_to_surface

DOUBTFUL = ("one_sided", "uncertain")  # flags of normals that serve where there are no better
RIM_CORNERS = 72  # of a round boundary
PATTERN_STEP_MM = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class PathSource:
    """The path that is smoothed: as demonstrated, filtered, and with the changes by hand."""

    raw_base: Floats  # (n, 3)
    filtered_base: Floats  # (n, 3)
    edited: EditedPath


def path_source(session: Session, filter_s: float) -> PathSource:
    """Return what is smoothed.

    Raises:
        StepBlockedError: there is no path yet.
        InvalidInputError: the changes by hand are of another path.
    """
    raw = need(session.results.path, "demonstrate the scan path").value.points_base
    filtered = raw
    if filter_s > 0 and not is_pattern(session):  # a pattern has no tremor
        capture = need(session.captures.path, "demonstrate the scan path")
        filtered = filter_path(raw, capture.marker.times_s, sigma_s=filter_s)
    return PathSource(raw, filtered, edit_path(filtered, session.path_edits.changes))


def viewpoint_base(session: Session) -> Vector3:
    """Return where the pointer's markers were while it drew: the side the probe comes from."""
    if is_pattern(session) or session.captures.path is None:
        strokes = need(session.captures.surface, "slide the pointer over the skull")
    else:
        strokes = (session.captures.path,)
    seen = [
        reference_of(session, stroke).T_base_tracker @ stroke.marker.Ts_tracker_marker.translations
        for stroke in strokes
    ]
    return np.vstack(seen).mean(axis=0)


def derive_smoothing(session: Session, message: SmoothScanPath) -> SmoothPath:
    """Filter and thin the path, find normals in the cloud and interpolate densely.

    Raises:
        DegenerateGeometryError: the cloud is too thin around a path point.
    """
    source = path_source(session, message.filter_s)
    edited = source.edited
    simplified = simplify(
        edited.points_base,
        ErrorBound(message.tolerance_mm, message.metric),
        method=message.method,
        keep=edited.keep,
    )
    return finished_path(session, message, source, simplified)


def finished_path(
    session: Session, message: SmoothScanPath, source: PathSource, simplified: SimplifiedPath
) -> SmoothPath:
    """Give a thinned path its normals, and interpolate it densely.

    Raises:
        DegenerateGeometryError: the cloud is too thin around a path point.
    """
    cloud = need(session.results.surface, "sample the surface").value
    corners = source.edited.points_base[simplified.index]
    places = corners
    if message.normal_step_mm > 0:
        places = insert_waypoints(corners, message.normal_step_mm)
    measured = cloud.points_base
    if not is_pattern(session):  # what was put in by hand or by rule measures nothing
        measured = np.vstack((measured, source.filtered_base))
    field = NormalField(measured, message.normal_radius_mm)
    normals = field.normals(places, method=message.normal_method, viewpoint=viewpoint_base(session))
    bad = [i for flag, where in normals.refused.items() if flag not in DOUBTFUL for i in where]
    if bad:
        first = min(bad)
        raise DegenerateGeometryError(
            f"{len(bad)} of {len(places)} path points have no reliable normal (the first is "
            f"point {first} with {normals.count[first]} samples within "
            f"{normals.radius_mm:.3g} mm: {normals.flags[first].replace('_', ' ')}): "
            "sample the surface there or enlarge the radius"
        )
    kept = simplified.index
    return SmoothPath(
        simplified=simplified,
        normals=normals,
        path=densify(places, -normals.normals),
        way_points_base=readonly(places) if message.normal_step_mm > 0 else None,
        corners_base=readonly(corners),
        from_raw_mm=readonly(distances_to_edited(source.raw_base, source.edited, kept)),
        from_filtered_mm=readonly(distances_to_edited(source.filtered_base, source.edited, kept)),
    )


def derive_pattern(session: Session, message: GenerateScanPattern) -> RawPath:
    """Make a path by rule on the measured surface; no other surface is looked at.

    Raises:
        DegenerateGeometryError: the surface was not sampled there, or the boundary cuts the
            pattern into parts.
    """
    cloud = need(session.results.surface, "sample the surface").value.points_base
    radius_mm = message.radius_mm or session.setup.region.radius_mm
    boundary = np.array(message.boundary_base_mm, dtype=np.float64).reshape(-1, 3)
    center = message.center_base_mm
    if center is None:
        center = np.median(cloud if not len(boundary) else boundary, axis=0)
    center = project_to_surface(cloud, center)
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
    )
    if made.stroke[-1] > 0:
        raise DegenerateGeometryError(
            f"the boundary cuts the pattern into {made.stroke[-1] + 1} strokes, but the probe "
            "stays on the bone: draw a boundary without dents, choose another direction, or move "
            "the centre into its middle"
        )
    return RawPath(made.points_base)
