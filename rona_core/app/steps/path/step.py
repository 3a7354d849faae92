"""Path: the scan path, demonstrated, drawn by rule, and edited by hand."""

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.dependencies.references import carried_remark
from rona_core.app.messages.message import Point
from rona_core.app.runtime.handling import read_inputs, record
from rona_core.app.runtime.recording import capture_stroke
from rona_core.app.steps.path import messages
from rona_core.app.steps.path.derivation import draw_pattern, map_path
from rona_core.app.steps.path.handlers import change_path, compute_path
from rona_core.app.steps.path.inputs import PATH, PATH_CAPTURE, SMOOTHING, PatternInputs, is_pattern
from rona_core.app.steps.path.painting import (
    CLEARANCE_MM,
    HAND_MM,
    clear_painted,
    paint_region,
    require_allowed_picks,
)
from rona_core.app.steps.pointer.inputs import POINTER
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.surface.inputs import SURFACE
from rona_core.app.steps.surface.messages import MAX_PICKS
from rona_core.app.steps.tool.inputs import TOOL
from rona_core.app.steps.tool.step import moved_tracker
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


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
    made = "pattern of " if is_pattern(session) else ""
    remark = "" if made else carried_remark(session, strokes)
    return f"{made}{len(held.value.points_base)} points{remark}"


STEP = declare.Step(
    "path",
    commands=(
        declare.Command(messages.BuildPath, compute_path, needs=(PATH_CAPTURE, TOOL, POINTER)),
        declare.Command(messages.GenerateScanPattern, compute_path, needs=(SURFACE,)),
        declare.Command(
            messages.MovePathPoint, change_path, needs=(SMOOTHING, SURFACE), takes_stale=True
        ),
        declare.Command(
            messages.InsertPathPoint, change_path, needs=(SMOOTHING, SURFACE), takes_stale=True
        ),
        declare.Command(
            messages.DeletePathPoint, change_path, needs=(SMOOTHING,), takes_stale=True
        ),
        declare.Command(
            messages.PinPathSample, change_path, needs=(PATH, SURFACE), takes_stale=True
        ),
        declare.Command(messages.ClearPathEdits, change_path),
        declare.Command(messages.PaintRegion, paint_region, needs=(SURFACE,), takes_stale=True),
        declare.Command(messages.ClearPaintedRegions, clear_painted),
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
        ),
    ),
    results=(
        declare.Result.of("path", messages.BuildPath, map_path, "demonstrate the path (step 5)"),
        declare.Result.of(
            "path", messages.GenerateScanPattern, draw_pattern, "demonstrate the path (step 5)"
        ),
    ),
    line=declare.StepLine(
        "Path",
        _summary,
        messages.StartPathCapture,
        leaves=lambda session: (PATH,) if is_pattern(session) else (PATH_CAPTURE, PATH),
    ),
)
