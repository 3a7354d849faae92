"""Surface cloud from the strokes of the pointer."""

from rona_core.app.dependencies.base_reference import reference_of
from rona_core.app.dependencies.head_reference import watch_head
from rona_core.app.dependencies.inputs import require_result
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.devices.live import LiveState
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.geometry.surface.cloud import SurfaceCloud, build_cloud, merge_clouds
from rona_core.session.captures import PointerCapture
from rona_core.session.document import Session


def tip_track(session: Session, capture: PointerCapture) -> Floats:
    """Return the pointer tip (k, 3) in ``base`` for every frame in which the pointer was seen.

    Where the head has moved since step 4 the tip is led back to where it lay then.

    Raises:
        StepBlockedError: tool or pointer are not calibrated, or it was another pointer.
        StaleResultError: the tracker has moved since the registration, and is not found again.
    """
    tips_base = reference_of(session, capture).T_base_tracker @ tip_of(session, capture)
    watch = watch_head(session, capture)
    back = None if watch is None else watch.back(capture.marker.times_s)
    return tips_base if back is None else back @ tips_base


def tip_of(session: Session, capture: PointerCapture) -> Floats:
    """Return the pointer tip (k, 3) in the tracker's frame wherever the pointer was seen.

    Raises:
        StepBlockedError: the pointer is not calibrated, or it was another one.
    """
    pointer = require_result(session.results.pointer, "calibrate the pointer").value
    if pointer.pointer != capture.pointer:
        raise StepBlockedError(
            f"the stroke was made with {capture.pointer}, but {pointer.pointer} is calibrated: "
            f"calibrate {capture.pointer} or record the stroke again"
        )
    return capture.marker.Ts_tracker_marker @ pointer.tip_pointermarker


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


def derive_surface(session: Session, message: BuildSurface) -> SurfaceCloud:
    """Map all strokes to ``base`` and build the cloud.

    Raises:
        DegenerateGeometryError: the pointer was seen in none of the frames.
    """
    strokes = require_result(session.captures.surface, "slide the pointer over the skull")
    clouds = [
        build_cloud(tip_track(session, s), s.marker.times_s, average_s=message.average_s)
        for s in strokes
        if len(s.marker.times_s)
    ]
    if not clouds:
        raise DegenerateGeometryError("the tracker saw the pointer in no frame of the strokes")
    return merge_clouds(clouds)
