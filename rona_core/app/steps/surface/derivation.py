"""Surface cloud from the strokes of the pointer."""

from rona_core.app.dependencies.references import HeadReference, Registered
from rona_core.app.steps.surface.inputs import SurfaceInputs
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.geometry.arrays import Floats
from rona_core.geometry.surface.cloud import SurfaceCloud, build_cloud, merge_clouds
from rona_core.session.captures import PointerCapture


def tip_track(
    capture: PointerCapture,
    registered: Registered,
    pointer: PointerCalibration,
    head: HeadReference | None,
) -> Floats:
    """Return the pointer tip (k, 3) in ``base`` for every frame in which the pointer was seen.

    The tip is corrected for the motion of the head since step 4.

    Raises:
        StepBlockedError: the stroke was made with another pointer.
        StaleResultError: the tracker has moved since the registration, and is not found again.
    """
    tips_base = registered.reference(capture).T_base_tracker @ tip_of(pointer, capture)
    watch = None if head is None else head.watch(capture)
    back = None if watch is None else watch.back(capture.marker.times_s)
    return tips_base if back is None else back @ tips_base


def tip_of(pointer: PointerCalibration, capture: PointerCapture) -> Floats:
    """Return the pointer tip (k, 3) in the tracker's frame wherever the pointer was seen.

    Raises:
        StepBlockedError: the stroke was made with another pointer.
    """
    if pointer.pointer != capture.pointer:
        raise StepBlockedError(
            f"the stroke was made with {capture.pointer}, but {pointer.pointer} is calibrated: "
            f"calibrate {capture.pointer} or record the stroke again"
        )
    return capture.marker.Ts_tracker_marker @ pointer.tip_pointermarker


def build_surface(known: SurfaceInputs, message: BuildSurface) -> SurfaceCloud:
    """Map all strokes to ``base`` and build the cloud.

    Raises:
        DegenerateGeometryError: the pointer was seen in none of the frames.
    """
    clouds = [
        build_cloud(
            tip_track(stroke, known.registered, known.pointer, known.head),
            stroke.marker.times_s,
            average_s=message.average_s,
        )
        for stroke in known.strokes
        if len(stroke.marker.times_s)
    ]
    if not clouds:
        raise DegenerateGeometryError("the tracker saw the pointer in no frame of the strokes")
    return merge_clouds(clouds)
