"""Surface: point cloud of the skull, and where a loaded skull lies under it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message, Remedy
from rona_core.app.dependencies.judge import by_verdict
from rona_core.app.dependencies.references import carried_remark, reference_of
from rona_core.app.dependencies.staleness import required
from rona_core.app.messages.message import StoreCapture
from rona_core.app.runtime.handling import capture_stroke, compute, compute_result, part_of
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.setup import capture_parts as parts
from rona_core.app.steps.surface import messages
from rona_core.app.steps.surface.derivation import (
    CLOUD,
    SURFACE,
    SURFACE_CAPTURE,
    build_surface,
    cloud_from_elsewhere,
    register_skull,
    require_loaded,
    tip_of,
)
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.app.steps.tool.step import moved_tracker
from rona_core.devices.live import LiveState
from rona_core.devices.samples import ToolTrack, TrackerFrame
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats, readonly
from rona_core.geometry.pose import Pose
from rona_core.session.captures import PointerCapture, PointsCapture
from rona_core.session.document import Session

SHORTEST_S = 1.0  # of a stroke
MORE_POINTS = Remedy(
    "slide the pointer over more of the skull (step 4)", messages.StartSurfaceCapture(append=True)
)


def record_strokes(
    activity: messages.StartSurfaceCapture, session: Session, context: ActivityContext
) -> tuple[Message, ...]:
    """Record the pointer marker while the pointer slides over the skull, stroke by stroke.

    What was cut short is stored all the same; nothing follows it.
    """
    picks = activity.picks_base_mm
    stored: list[Message] = []
    start = 0.0
    for stroke in messages.strokes_of(picks, activity.lifts):
        share = len(stroke) / len(picks) if picks else 1.0
        duration_s = max(SHORTEST_S, share * activity.duration_s)
        taken = capture_stroke(
            "surface",
            session,
            part_of(context, start, share),
            stroke,
            duration_s,
            partial(context.rig.operator.sweep, duration_s=duration_s),
        )
        stored.append(StoreCapture("surface", taken, activity.append or bool(stored)))
        if taken.partial:
            return tuple(stored)
        session = replace(session, archive=(*session.archive, taken))  # the next ordinal
        start += share
    return (*stored, messages.BuildSurface())


def _require_loaded(activity: messages.StartSkullRegistration, session: Session) -> None:
    require_loaded(session.setup.specimen)


def is_own_cloud(session: Session) -> bool:
    """Return whether the surface is a point cloud from elsewhere."""
    held = session.results.surface
    return held is not None and held.message == messages.TakeCloud.__name__


def _summary(session: Session) -> str:
    held = session.results.surface
    if held is None:
        return ""
    strokes = () if is_own_cloud(session) else session.captures.surface
    remark = carried_remark(session, strokes)
    return f"{len(held.value.points_base)} points{remark}"


STEP = declare.Step(
    "surface",
    commands=(
        declare.Command(
            messages.BuildSurface, compute_result, needs=(SURFACE_CAPTURE, TOOL, POINTER)
        ),
        declare.Command(messages.TakeCloud, compute_result, needs=(CLOUD,)),
        declare.Command(
            messages.ClearSurface,
            lambda m, s: s.with_capture("surface", ()),
            done="the strokes over the skull were removed",
        ),
    ),
    activities=(
        declare.Activity(
            messages.StartSurfaceCapture,
            record_strokes,
            "Sliding over the skull",
            needs=(TOOL, POINTER),
            makes=("surface",),
            blocked=moved_tracker,
        ),
        declare.Activity(
            messages.StartSkullRegistration,
            compute,
            "Laying the points onto the skull",
            needs=(SURFACE,),
            check=_require_loaded,
        ),
    ),
    captures=(
        declare.Capture(
            "surface",
            "slide the pointer over the skull (step 4)",
            (parts.tracker, parts.robot, parts.pointer, parts.specimen, parts.HEAD),
            place=lambda s, taken, append: (*(s.captures.surface if append else ()), taken),
            done="the strokes over the skull were recorded",
        ),
        declare.Capture(
            "cloud",
            "import a point cloud (step 4)",
            (parts.specimen,),
            types=(PointsCapture,),
            done="the point cloud was imported",
        ),
    ),
    results=(
        declare.Result.of(
            "surface",
            messages.BuildSurface,
            build_surface,
            "sample the surface (step 4)",
            done="the surface was computed",
        ),
        declare.Result.of(
            "surface",
            messages.TakeCloud,
            cloud_from_elsewhere,
            "sample the surface (step 4)",
            done="the imported point cloud was taken",
        ),
        declare.Result.of(
            "registration",
            messages.StartSkullRegistration,
            register_skull,
            "register the skull (step 4)",
            judged=by_verdict(MORE_POINTS),
            done="the registration of the skull was computed",
        ),
    ),
    line=declare.StepLine(
        "Surface",
        _summary,
        messages.StartSurfaceCapture,
        leaves=lambda s: (SURFACE,) if is_own_cloud(s) else (SURFACE_CAPTURE, SURFACE),
    ),
)


class StrokeGrower:
    """Grows the stroke of one capture; each frame is looked at once."""

    def __init__(self, session: Session) -> None:
        """Prepare for a stroke that is recorded in ``session``."""
        self._session = session
        self._n_frames = 0  # that had come when it was looked last
        self._T_base_tracker: Pose | None = None
        self._tips_base: Floats = readonly(np.zeros((0, 3)))

    def grown(self, frames: Sequence[TrackerFrame]) -> Floats:
        """Return the tip (k, 3) in ``base`` in all frames so far in which the pointer was seen.

        None of them while tool or pointer are not calibrated, or the tracker was moved and is not
        found again: the builder of the cloud is notified.
        """
        new, self._n_frames = frames[self._n_frames :], len(frames)
        if new:
            try:
                tips = self._tips(new)
            except RonaError:
                return self._tips_base
            self._tips_base = readonly(np.vstack((self._tips_base, tips)))
        return self._tips_base

    def _tips(self, frames: Sequence[TrackerFrame]) -> Floats:
        pointer = self._session.setup.devices.pointer
        stroke = PointerCapture(
            ordinal=0,
            setup_digest="",
            pointer=pointer,
            marker=ToolTrack.from_frames(pointer, frames),
            base=ToolTrack.from_frames("basemarker", frames),
            tracker_place=self._session.setup.devices.tracker.place,
        )
        if self._T_base_tracker is None:
            self._T_base_tracker = reference_of(self._session, stroke).T_base_tracker
        return self._T_base_tracker @ tip_of(required(POINTER, self._session), stroke)


def replayed_pointer(session: Session, live: LiveState) -> Pose | None:
    """Return where a recording under way shows the pointer, ``T_base_pointermarker``.

    None while none is played, the tool is not seen, or the tracker is not registered.
    """
    registered = session.results.tool
    if live.origin != "REPLAY" or live.frame is None or registered is None:
        return None
    sample = live.frame.tools[0]
    if sample.T_tracker_marker is None:
        return None
    return registered.value.T_base_tracker @ sample.T_tracker_marker
