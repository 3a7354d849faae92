"""What step 6 shows of a path: original and smoothed in one plane, and a preview while dragging."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from rona_core.app.dependencies.staleness import required
from rona_core.app.messages.message import message_from
from rona_core.app.steps.path.inputs import DEMONSTRATED, PATH, VIEWPOINT
from rona_core.app.steps.smoothing.derivation import PathSource, path_source
from rona_core.app.steps.smoothing.messages import SmoothScanPath
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats, Ints, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.rigid_fit import fit_plane
from rona_core.path.manual_edits import distances_to_edited
from rona_core.path.scan_patterns import patch_pose
from rona_core.path.simplification.error_bound import ErrorBound, as_metric
from rona_core.path.simplification.simplify import as_keep, chosen_points
from rona_core.session.document import Session
from rona_core.session.memo import Memo

# The fast method looks on from every point that it keeps, for some 0.7 ms each: up to so many
# points kept, of so many, it is done within a tenth of a second.
FEW, SHORT = 130, 10_000


@dataclass(frozen=True, slots=True, eq=False)
class PathView:
    """A path before and after smoothing (Figure 6 of the paper), and how far apart they are."""

    raw_base: Floats  # (n, 3) as demonstrated
    corners_base: Floats  # (k, 3) that are left
    raw_patch: Floats  # (n, 2) the same in the tangent plane, from outside, in mm
    corners_patch: Floats  # (k, 2)
    from_raw_mm: Floats  # (n,) distance of each demonstrated sample from the smoothed path
    k1_raw_mm: float
    k1_filtered_mm: float
    tolerance_mm: float
    exact: bool  # no path within the bound has fewer points
    by_hand: int  # changes by hand
    preview: bool  # computed by a quick method during a drag


def path_view(session: Session) -> PathView | None:
    """Return original and smoothed path; None before there is one that fits."""
    path, smooth = session.results.path, session.results.smoothing
    if path is None or smooth is None:
        return None
    raw, value = path.value.points_base, smooth.value
    if len(raw) != len(value.from_raw_mm):
        return None  # another path has been demonstrated since
    return _view(
        session,
        raw,
        value.corners_base,
        value.from_raw_mm,
        float(value.from_filtered_mm.max()),
        tolerance_mm=value.simplified.tolerance,
        exact=value.simplified.exact,
        preview=False,
    )


_SOURCES: Memo[PathSource] = Memo(4)
_VIEWS: Memo[PathView] = Memo(4)


def preview_path(session: Session, tolerance_mm: float) -> PathView | None:
    """Return how the path would be smoothed with another bound, quickly; None before there is one.

    The fast method is used, or the one of Douglas and Peucker where so many points would be left
    that the fast one takes longer than a hand waits. Settings other than the bound are those of
    the last smoothing.
    """
    path, smooth = session.results.path, session.results.smoothing
    if path is None:
        return None
    arguments = {} if smooth is None else smooth.arguments
    message = message_from("SmoothScanPath", arguments)
    try:
        return _VIEWS.get(
            (path, session.path_edits),
            lambda: _preview(session, tolerance_mm, message),
            (tolerance_mm, message.metric, message.filter_s),
        )
    except RonaError:
        return None  # what is wrong is said when the slider is let go


def _preview(session: Session, tolerance_mm: float, message: SmoothScanPath) -> PathView:
    source = _source(session, message.filter_s)
    kept = quickly(source, tolerance_mm, message.metric)
    edited = source.edited
    return _view(
        session,
        source.raw_base,
        edited.points_base[kept],
        distances_to_edited(source.raw_base, edited, kept),
        float(distances_to_edited(source.filtered_base, edited, kept).max()),
        tolerance_mm=tolerance_mm,
        exact=False,
        preview=True,
    )


def quickly(source: PathSource, tolerance_mm: float, metric: str) -> Ints:
    """Return the indices (k,) of few points, within a moment."""
    points = source.edited.points_base
    test = ErrorBound(tolerance_mm, as_metric(metric)).shortcut_test(points)
    fixed = as_keep(source.edited.keep, len(points))
    kept, _ = chosen_points(points, fixed, test, "rdp")
    if metric == "k1" and len(kept) <= FEW and len(points) <= SHORT:
        kept, _ = chosen_points(points, fixed, test, "fast")
    return kept


def _view(
    session: Session,
    raw: Floats,
    corners: Floats,
    from_raw: Floats,
    k1_filtered: float,
    **parts: Any,
) -> PathView:
    T_patch_base = tangent_pose(session, raw).inv()
    return PathView(
        raw_base=raw,
        corners_base=corners,
        raw_patch=readonly((T_patch_base @ raw)[:, :2]),
        corners_patch=readonly((T_patch_base @ corners)[:, :2]),
        from_raw_mm=from_raw,
        k1_raw_mm=float(from_raw.max()),
        k1_filtered_mm=k1_filtered,
        by_hand=len(session.path_edits),
        **parts,
    )


def tangent_pose(session: Session, points_base: Floats) -> Pose:
    """Return the pose of the plane that lies best along a path, z out of the bone."""
    center = points_base.mean(axis=0)
    try:
        normal = fit_plane(points_base).normal
        outward = normal @ (required(VIEWPOINT, session) - center)
    except RonaError:  # a straight path, or no tool: any plane will do
        normal, outward = np.array((0.0, 0.0, 1.0)), 1.0
    return patch_pose(center, normal if outward >= 0.0 else -normal)


def source_of(session: Session, filter_s: float) -> PathSource:
    """Return what is smoothed; errors as of `path_source`."""
    path, demonstrated = required(PATH, session), DEMONSTRATED.read(session)
    return path_source(path, demonstrated, session.path_edits, filter_s)


def _source(session: Session, filter_s: float) -> PathSource:
    return _SOURCES.get(
        (session.results.path, session.path_edits),
        lambda: source_of(session, filter_s),
        filter_s,
    )
