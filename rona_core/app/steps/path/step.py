"""Path: the scan path, demonstrated, drawn by rule, and edited by hand."""

from dataclasses import replace
from functools import singledispatch

import numpy as np
from numpy.typing import ArrayLike

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.judge import require_inputs
from rona_core.app.dependencies.references import carried_remark
from rona_core.app.dependencies.staleness import required, stale_reason
from rona_core.app.messages.message import Point, message_from
from rona_core.app.runtime.handling import capture_stroke, compute_result, read_inputs, record
from rona_core.app.steps.path import messages
from rona_core.app.steps.path.derivation import draw_pattern, map_path, path_from_elsewhere
from rona_core.app.steps.path.inputs import (
    CLEARANCE_MM,
    HAND_MM,
    PATH,
    PATH_CAPTURE,
    POINTS,
    SMOOTHING,
    PatternInputs,
    clear_painted,
    is_demonstrated,
    is_pattern,
    paint_region,
    require_allowed_picks,
)
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.surface.derivation import SURFACE
from rona_core.app.steps.surface.messages import MAX_PICKS
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.app.steps.tool.step import moved_tracker
from rona_core.errors import InvalidInputError, StaleResultError
from rona_core.geometry.arrays import Floats, Vector3, as_vector3
from rona_core.geometry.surface.surface_pick import pick_surface_point, project_to_surface
from rona_core.path.manual_edits import PathEdit, PathEdits, edit_path
from rona_core.session.captures import PointerCapture, PointsCapture
from rona_core.session.document import Session, SmoothPath

PICK_MM = 5.0  # a click farther from every point means none of them


@singledispatch
def edited(message: messages.PathChange, session: Session) -> PathEdits:
    """Return the changes of the path after one more.

    Raises:
        InvalidInputError: there is no such point.
        StaleResultError: the smoothed path that the numbers count on is stale.
        DegenerateGeometryError: no surface was measured at the place.
    """
    raise InvalidInputError(f"{type(message).__name__} does not change the path")


@edited.register
def _(message: messages.MovePathPoint, session: Session) -> PathEdits:
    before, after = _beside(message.index, session)
    place = place_on_surface(message.point_base_mm, message.seen_from_base_mm, session)
    return _with(session, PathEdit("replace", before, after, (place,)))


@edited.register
def _(message: messages.InsertPathPoint, session: Session) -> PathEdits:
    kept = _fresh(session).simplified.index
    if not -1 <= message.after < len(kept):
        raise InvalidInputError(f"after must be -1 to {len(kept) - 1}, not {message.after}")
    first = None if message.after < 0 else int(kept[message.after])
    last = None if message.after == len(kept) - 1 else int(kept[message.after + 1])
    place = place_on_surface(message.point_base_mm, message.seen_from_base_mm, session)
    return _with(session, PathEdit("replace", first, last, (place,)))


@edited.register
def _(message: messages.DeletePathPoint, session: Session) -> PathEdits:
    before, after = _beside(message.index, session)
    if len(_fresh(session).simplified.index) < 3:
        raise InvalidInputError("a path needs two points: neither can be taken away")
    return _with(session, PathEdit("replace", before, after))


@edited.register
def _(message: messages.PinPathSample, session: Session) -> PathEdits:
    raw = required(PATH, session).points_base
    at = np.flatnonzero(edit_path(raw, session.path_edits.changes).samples == message.sample)
    if message.sample < 0 or not len(at):
        raise InvalidInputError(
            f"the path has no sample {message.sample}: it has 0 to {len(raw) - 1}, less those "
            "that were taken away by hand"
        )
    return _with(session, PathEdit("keep" if message.keep else "free", int(at[0])))


@edited.register
def _(message: messages.ClearPathEdits, session: Session) -> PathEdits:
    return PathEdits()


def sight(session: Session, origin_base: ArrayLike, direction_base: ArrayLike) -> Vector3:
    """Return the place (3,) on the measured surface under a ray from the eye.

    Raises:
        StepBlockedError: no surface was sampled yet.
        DegenerateGeometryError: none was measured there.
    """
    cloud = required(SURFACE, session)
    return pick_surface_point(cloud.points_base, origin_base, direction_base)


def nearest_point(points_base: Floats, origin_base: ArrayLike, direction: ArrayLike) -> int | None:
    """Return the number of the point (n, 3) nearest to a line of sight, None if all are far."""
    origin, ray = as_vector3(origin_base), as_vector3(direction)
    if not len(points_base):
        return None
    ray = ray / np.linalg.norm(ray)
    away = points_base - origin
    aside = np.linalg.norm(away - (away @ ray)[:, None] * ray, axis=1)
    nearest = int(aside.argmin())
    return nearest if aside[nearest] <= PICK_MM else None


def nearest_piece(corners_base: Floats, place_base: ArrayLike) -> int:
    """Return the number of the corner behind which a place lies best: that of the nearest piece."""
    place, starts = as_vector3(place_base), corners_base[:-1]
    along = corners_base[1:] - starts
    length2 = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(((place - starts) * along).sum(axis=1) / length2, 0.0, 1.0)
    return int(np.linalg.norm(starts + share[:, None] * along - place, axis=1).argmin())


def _with(session: Session, edit: PathEdit) -> PathEdits:
    return PathEdits((*session.path_edits.changes, edit))


def _fresh(session: Session) -> SmoothPath:
    smooth = required(SMOOTHING, session)
    reason = stale_reason("smoothing", session)
    if reason is not None:
        raise StaleResultError(f"the points of a stale path cannot be changed ({reason}): smooth "
                               "the path again first")  # fmt: skip
    return smooth


def _beside(index: int, session: Session) -> tuple[int | None, int | None]:
    """Return the points of the path beside a point of the smoothed one; None beyond an end."""
    kept = _fresh(session).simplified.index
    if not 0 <= index < len(kept):
        raise InvalidInputError(f"index must be 0 to {len(kept) - 1}, not {index}")
    before = None if index == 0 else int(kept[index - 1])
    after = None if index == len(kept) - 1 else int(kept[index + 1])
    return before, after


def place_on_surface(point: Point, eye: Point | None, session: Session) -> Point:
    """Return the place on the measured surface that a point means, from an eye if there is one.

    Raises:
        StepBlockedError: no surface was sampled yet.
        DegenerateGeometryError: none was measured there.
    """
    cloud = required(SURFACE, session).points_base
    if eye is None:
        place = project_to_surface(cloud, point)
    else:
        place = pick_surface_point(cloud, eye, np.subtract(point, eye))
    x, y, z = (float(part) for part in place)
    return x, y, z


def is_kept(session: Session, sample: int) -> bool:
    """Return whether a sample of the demonstrated path must stay when it is smoothed."""
    raw = required(PATH, session).points_base
    path = edit_path(raw, session.path_edits.changes)
    return bool(path.keep[path.samples == sample].any())


def change_path(message: messages.PathChange, session: Session) -> Session:
    """Carry out a change of the path by hand; smooth it again, where that was done and is fresh."""
    require_inputs(type(message), session)
    changed = replace(session, path_edits=edited(message, session))
    smooth = session.results.smoothing
    if smooth is None or stale_reason("smoothing", session) is not None:
        return changed
    return compute_result(message_from(smooth.message, smooth.arguments), changed)


def compute_path(
    message: messages.BuildPath | messages.GenerateScanPattern | messages.TakePathPoints,
    session: Session,
) -> Session:
    """Carry out `BuildPath`, `GenerateScanPattern` or `TakePathPoints`.

    Edits by hand were of another path.
    """
    return replace(compute_result(message, session), path_edits=PathEdits())


def capture_path(
    activity: messages.StartPathCapture, session: Session, context: ActivityContext
) -> PointerCapture:
    """Record the pointer marker while the pointer demonstrates the scan path.

    Where regions are painted, the hand without picks follows a raster that keeps to them.
    """
    return capture_stroke(
        "path",
        session,
        context,
        activity.picks_base_mm or _within_painted(activity, session),
        activity.duration_s,
        lambda: context.rig.operator.draw(
            spacing_mm=activity.spacing_mm, duration_s=activity.duration_s
        ),
    )


def _within_painted(activity: messages.StartPathCapture, session: Session) -> tuple[Point, ...]:
    """Return places of a raster within what is painted; none where nothing is."""
    if not len(session.painted):
        return ()
    pattern = messages.GenerateScanPattern(spacing_mm=activity.spacing_mm)
    known = read_inputs(PatternInputs, session)
    line = draw_pattern(known, pattern, clearance_mm=CLEARANCE_MM + HAND_MM).points_base
    points = line[:: int(np.ceil(len(line) / MAX_PICKS))]
    return tuple((float(x), float(y), float(z)) for x, y, z in points)


def _summary(session: Session) -> str:
    held = session.results.path
    if held is None:
        return ""
    strokes = () if session.captures.path is None else (session.captures.path,)
    demonstrated = is_demonstrated(session)
    made = "" if demonstrated else "pattern of " if is_pattern(session) else "imported: "
    remark = carried_remark(session, strokes) if demonstrated else ""
    return f"{made}{len(held.value.points_base)} points{remark}"


STEP = declare.Step(
    "path",
    commands=(
        declare.Command(messages.BuildPath, compute_path, needs=(PATH_CAPTURE, TOOL, POINTER)),
        declare.Command(messages.GenerateScanPattern, compute_path, needs=(SURFACE,)),
        declare.Command(messages.TakePathPoints, compute_path, needs=(POINTS,)),
        declare.Command(
            messages.MovePathPoint,
            change_path,
            needs=(SMOOTHING, SURFACE),
            takes_stale=True,
            done="a point of the path was moved",
        ),
        declare.Command(
            messages.InsertPathPoint,
            change_path,
            needs=(SMOOTHING, SURFACE),
            takes_stale=True,
            done="a point of the path was inserted",
        ),
        declare.Command(
            messages.DeletePathPoint,
            change_path,
            needs=(SMOOTHING,),
            takes_stale=True,
            done="a point of the path was deleted",
        ),
        declare.Command(
            messages.PinPathSample,
            change_path,
            needs=(PATH, SURFACE),
            takes_stale=True,
            done="a sample of the path was pinned or released",
        ),
        declare.Command(
            messages.ClearPathEdits,
            change_path,
            done="the changes of the path by hand were removed",
        ),
        declare.Command(
            messages.PaintRegion,
            paint_region,
            needs=(SURFACE,),
            takes_stale=True,
            done="a region was painted",
        ),
        declare.Command(
            messages.ClearPaintedRegions, clear_painted, done="the painted regions were cleared"
        ),
    ),
    activities=(
        declare.Activity(
            messages.StartPathCapture,
            record("path", capture_path, messages.BuildPath),
            "Demonstrating the path",
            needs=(TOOL, POINTER),
            blocked=moved_tracker,
            check=require_allowed_picks,
            makes=("path",),
        ),
    ),
    captures=(
        declare.Capture(
            "path",
            "demonstrate the scan path (step 5)",
            (parts.tracker, parts.robot, parts.pointer, parts.specimen, parts.HEAD),
            done="the scan path was demonstrated",
        ),
        declare.Capture(
            "path_points",
            "import a scan path (step 5)",
            (parts.specimen,),
            types=(PointsCapture,),
            done="the points of the path were imported",
        ),
    ),
    results=(
        declare.Result.of(
            "path",
            messages.BuildPath,
            map_path,
            "demonstrate the path (step 5)",
            done="the scan path was computed",
        ),
        declare.Result.of(
            "path",
            messages.GenerateScanPattern,
            draw_pattern,
            "demonstrate the path (step 5)",
            done="the pattern of the scan path was drawn",
        ),
        declare.Result.of(
            "path",
            messages.TakePathPoints,
            path_from_elsewhere,
            "demonstrate the path (step 5)",
            done="the imported scan path was taken",
        ),
    ),
    line=declare.StepLine(
        "Path",
        _summary,
        messages.StartPathCapture,
        leaves=lambda s: (PATH_CAPTURE, PATH) if is_demonstrated(s) else (PATH,),
    ),
)
