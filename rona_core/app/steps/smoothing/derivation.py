"""Compute step 6 from path and surface: fewer points, changes by hand, normals, the dense path."""

from dataclasses import dataclass

import numpy as np

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.steps.path.inputs import (
    DEMONSTRATED,
    OF_REGISTRATION,
    PAINTED,
    PATH,
    VIEWPOINT,
    require_none_avoided,
)
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats, Vector3, readonly
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.geometry.surface.normals.normals import NormalField
from rona_core.path.manual_edits import EditedPath, PathEdits, distances_to_edited, edit_path
from rona_core.path.path_samples import densify, filter_path, insert_waypoints
from rona_core.path.simplification.error_bound import ErrorBound
from rona_core.path.simplification.simplify import SimplifiedPath, simplify
from rona_core.path.zones import PaintedRegions
from rona_core.session.captures import PointerCapture
from rona_core.session.document import RawPath, SmoothPath

EDITS = Input(
    lambda s: s.path_edits, "smooth the path (step 6)", title="the editing of the path (step 6)"
)


@inputs(
    implied=("demonstration", "strokes", "tool", *OF_REGISTRATION),
    free=("use of the base marker",),
)
class SmoothingInputs:
    """What the path is smoothed from."""

    path: RawPath = given(PATH, "path")
    cloud: SurfaceCloud = given(SURFACE, "surface")
    edits: PathEdits = given(EDITS, "edits")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")
    demonstrated: PointerCapture | None = given(DEMONSTRATED, "demonstration")  # None: a pattern
    viewpoint: Vector3 = given(VIEWPOINT)


DOUBTFUL = ("one_sided", "uncertain")  # flags of normals that serve where there are no better


@dataclass(frozen=True, slots=True, eq=False)
class PathSource:
    """The path that is smoothed: as demonstrated, filtered, and with the changes by hand."""

    raw_base: Floats  # (n, 3)
    filtered_base: Floats  # (n, 3)
    edited: EditedPath


def path_source(
    path: RawPath, demonstrated: PointerCapture | None, edits: PathEdits, filter_s: float
) -> PathSource:
    """Return what is smoothed.

    Args:
        path: As demonstrated, or drawn by rule.
        demonstrated: The stroke; None of a pattern, which has no tremor.
        edits: Changes by hand.
        filter_s: Standard deviation of the filter.

    Raises:
        InvalidInputError: the changes by hand are of another path.
    """
    raw = filtered = path.points_base
    if filter_s > 0 and demonstrated is not None:
        filtered = filter_path(raw, demonstrated.marker.times_s, sigma_s=filter_s)
    return PathSource(raw, filtered, edit_path(filtered, edits.changes))


def smooth_path(known: SmoothingInputs, message: SmoothScanPath) -> SmoothPath:
    """Filter and thin the path, find normals in the cloud and interpolate densely.

    Raises:
        DegenerateGeometryError: the cloud is too thin around a path point.
        InvalidInputError: the path comes into a region to avoid.
    """
    source = path_source(known.path, known.demonstrated, known.edits, message.filter_s)
    edited = source.edited
    simplified = simplify(
        edited.points_base,
        ErrorBound(message.tolerance_mm, message.metric),
        method=message.method,
        keep=edited.keep,
    )
    return finished_path(known, message, source, simplified)


def finished_path(
    known: SmoothingInputs, message: SmoothScanPath, source: PathSource, simplified: SimplifiedPath
) -> SmoothPath:
    """Give a thinned path its normals, and interpolate it densely.

    Raises:
        DegenerateGeometryError: the cloud is too thin around a path point.
        InvalidInputError: the path comes into a region to avoid.
    """
    corners = source.edited.points_base[simplified.index]
    places = corners
    if message.normal_step_mm > 0:
        places = insert_waypoints(corners, message.normal_step_mm)
    measured = known.cloud.points_base
    if known.demonstrated is not None:  # what was put in by hand or by rule measures nothing
        measured = np.vstack((measured, source.filtered_base))
    field = NormalField(measured, message.normal_radius_mm)
    normals = field.normals(places, method=message.normal_method, viewpoint=known.viewpoint)
    bad = [i for flag, where in normals.refused.items() if flag not in DOUBTFUL for i in where]
    if bad:
        first = min(bad)
        raise DegenerateGeometryError(
            f"{len(bad)} of {len(places)} path points have no reliable normal (the first is "
            f"point {first} with {normals.count[first]} samples within "
            f"{normals.radius_mm:.3g} mm: {normals.flags[first].replace('_', ' ')}): "
            "sample the surface there or enlarge the radius"
        )
    kept, path = simplified.index, densify(places, -normals.normals)
    require_none_avoided(known.painted or PaintedRegions(), path.points_base)
    return SmoothPath(
        simplified=simplified,
        normals=normals,
        path=path,
        way_points_base=readonly(places) if message.normal_step_mm > 0 else None,
        corners_base=readonly(corners),
        from_raw_mm=readonly(distances_to_edited(source.raw_base, source.edited, kept)),
        from_filtered_mm=readonly(distances_to_edited(source.filtered_base, source.edited, kept)),
    )
