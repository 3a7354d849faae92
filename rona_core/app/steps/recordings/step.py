"""Recordings: captures of the pointer that were made elsewhere."""

from collections.abc import Iterable
from dataclasses import fields, replace

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext, Message
from rona_core.app.dependencies.judge import require_inputs
from rona_core.app.runtime.handling import begin, record
from rona_core.app.steps.path.messages import BuildPath, StartPathCapture
from rona_core.app.steps.pointer.messages import CalibratePointer, StartPointerCapture
from rona_core.app.steps.pointer.pivot_report import require_marker_poses
from rona_core.app.steps.recordings.messages import StartPivotImport, StartRecordingImport
from rona_core.app.steps.surface.messages import BuildSurface, StartSurfaceCapture
from rona_core.calibration.pivot.pose_convention import require_stroke_convention
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.poses.pose_matrices import require_millimetres
from rona_core.devices.files.poses.recorded_poses import (
    chosen_tool,
    read_pivot,
    read_poses,
    require_stroke,
)
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.recording import Recording, ReplayTracker
from rona_core.devices.samples import ToolTrack, TrackerFrame
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DeviceError, InvalidInputError, NotFoundError
from rona_core.geometry.pose import Poses
from rona_core.session.captures import PointerCapture, imported_digest
from rona_core.session.document import Session

STANDS_FOR = {  # purpose -> capture, the activity that takes it here, and what follows
    "pivot": ("pointer", StartPointerCapture, CalibratePointer),
    "surface": ("surface", StartSurfaceCapture, BuildSurface),
    "path": ("path", StartPathCapture, BuildPath),
}


def import_recording(
    activity: StartRecordingImport, session: Session, context: ActivityContext
) -> PointerCapture:
    """Read one tool of a recording; with ``play`` at the pace of captures, for the eye.

    Raises:
        NotFoundError: the file was not uploaded.
        InvalidInputError: it is no recording, the tool is not in it, it is in metres, a stroke has
            no times, or the poses are in another convention or frame.
        DeviceError: the tool was seen in no frame.
    """
    file = _uploaded(activity.file, context)
    found = read_poses([file], _layout(activity))
    pointer = session.setup.devices.pointer
    recording = found.recording
    tool = chosen_tool(recording, activity.tool, pointer, file.name)
    alone, partial = recording.only(tool).from_zero(), False
    poses = alone.track(tool).Ts_tracker_marker
    require_millimetres(poses.translations, file.name)
    if activity.purpose == "pivot":
        dof = GEOMETRIES[pointer].dof
        known = found.frame is not None
        require_marker_poses(poses, file.name, dof=dof, direction_known=known)
    else:
        require_stroke(found)
        _require_marker_poses_of_stroke(poses, file.name, session)
    if activity.play:
        track, partial = _play(alone, tool, session, context)
    else:
        track = alone.track(tool)
    if not len(track.times_s):
        raise DeviceError(f"{file.name}: {tool} was seen in none of its {len(alone)} frames")
    return _capture(session, track, [file], partial)


def _require_marker_poses_of_stroke(poses: Poses, name: str, session: Session) -> None:
    """Refuse a stroke whose convention is another by the name of the change.

    Raises:
        InvalidInputError: it is, see ``require_stroke_convention``.
    """
    known = session.results.pointer
    if known is None or known.value.pointer != session.setup.devices.pointer:
        return  # refused by what follows, which needs the tip
    try:
        require_stroke_convention(poses, known.value.tip_pointermarker)
    except InvalidInputError as error:
        raise InvalidInputError(f"{name}: {error}", **error.data) from error


def import_pivot(
    activity: StartPivotImport, session: Session, context: ActivityContext
) -> PointerCapture:
    """Read the poses of a pivot from files of any kind that `read_poses` knows.

    Raises:
        NotFoundError: a file was not uploaded.
        RonaError: the files hold no poses; it says which line.
    """
    files = [_uploaded(name, context) for name in activity.files]
    geometry = None if activity.geometry is None else _uploaded(activity.geometry, context)
    pointer = session.setup.devices.pointer
    pivot = read_pivot(
        files,
        _layout(activity),
        geometry=geometry,
        usual=pointer,
        dof=GEOMETRIES[pointer].dof,
    )
    require_marker_poses(
        pivot.track.Ts_tracker_marker,
        pivot.poses.name,
        dof=GEOMETRIES[pointer].dof,
        direction_known=pivot.direction_known,
    )
    used = [*files, geometry] if geometry is not None else files
    made = _capture(session, pivot.track, used, partial=False)
    return replace(made, geometry_marker=pivot.poses.geometry_marker)


def _layout(activity: StartRecordingImport | StartPivotImport) -> PoseLayout:
    said = (getattr(activity, field.name) for field in fields(PoseLayout))
    return PoseLayout(*said)


def _uploaded(name: str, context: ActivityContext) -> NamedFile:
    path = context.uploads / name
    if not path.is_file():
        raise NotFoundError(f"there is no uploaded file {name!r}: upload it first")
    return NamedFile(name, read_file(path, "an uploaded file"))


def _play(
    recording: Recording, tool: str, session: Session, context: ActivityContext
) -> tuple[ToolTrack, bool]:
    """Let the recording run on the clock of the devices; cancelled, it ends where it is."""
    begin(session, context)
    tracker = ReplayTracker(recording, context.rig.clock)
    frames: list[TrackerFrame] = []
    try:
        for frame in tracker.frames():
            frames.append(frame)
            context.live.put(frame=frame, origin=tracker.origin)
            context.progress(len(frames) / len(recording))
            if context.cancel():
                break
    finally:
        tracker.close()
        context.live.put(origin=None)
    if not frames:
        raise DeviceError("the replay was stopped before its first frame")
    track = Recording.from_frames(frames).track(tool)
    partial = len(frames) < len(recording)
    return (track if partial else replace(track, n_frames=recording.n_frames)), partial


def _capture(
    session: Session, track: ToolTrack, files: list[NamedFile], partial: bool
) -> PointerCapture:
    return PointerCapture(
        ordinal=len(session.archive) + 1,
        setup_digest=imported_digest(file.data for file in files),
        pointer=session.setup.devices.pointer,
        marker=track,
        partial=partial,
    )


def require_as_recorded(activity: StartRecordingImport, session: Session) -> None:
    """Raise StepBlockedError where the capture that a recording stands for is blocked."""
    require_inputs(STANDS_FOR[activity.purpose][1], session)


def store_recording(
    activity: StartRecordingImport, session: Session, context: ActivityContext
) -> Iterable[Message]:
    """Read a recording as the capture it stands for, then compute what follows from it."""
    capture, _, follows = STANDS_FOR[activity.purpose]
    return record(capture, import_recording, follows)(activity, session, context)


STEP = declare.Step(
    "recordings",
    activities=(
        declare.Activity(
            StartRecordingImport,
            store_recording,
            "Reading the recording",
            check=require_as_recorded,
            makes=tuple(capture for capture, *_ in STANDS_FOR.values()),
            of_several_steps=True,
        ),
        declare.Activity(
            StartPivotImport,
            record("pointer", import_pivot, CalibratePointer),
            "Reading the pivot",
            makes=("pointer",),
            shown_in="pointer",
        ),
    ),
)
