"""Inputs of the scan path, painted regions among them, and what others take from it."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.spatial import KDTree

from rona_core.app.declarations.inputs import Input, Quantity, given, inputs
from rona_core.app.dependencies.judge import require_inputs
from rona_core.app.dependencies.references import (
    ANY_REGISTERED,
    REGISTERED,
    HeadReference,
    Registered,
    found_again,
    head_input,
    head_of,
)
from rona_core.app.dependencies.staleness import capture_input, required, result_input, stale_reason
from rona_core.app.steps.path.messages import (
    BuildPath,
    ClearPaintedRegions,
    GenerateScanPattern,
    PaintRegion,
    StartPathCapture,
)
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.setup.capture_parts import RADIUS, reference_input
from rona_core.app.steps.surface.derivation import ANY_STROKES, SURFACE, Strokes
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.errors import InvalidInputError
from rona_core.geometry.arrays import Bools, Floats, Vector3
from rona_core.geometry.pose import Pose
from rona_core.geometry.rigid_fit import bulging
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.path.scan_patterns import Inside
from rona_core.path.zones import PaintedRegions, PaintedStroke
from rona_core.session.captures import PointerCapture, PointsCapture
from rona_core.session.document import RawPath, Session, SmoothPath

MAX_STROKES = 100
ON_SURFACE_MM = 10.0  # a stroke whose every place is farther from the surface was meant elsewhere
CLEARANCE_MM = 1.5  # of what is planned, to what is to be avoided: smoothing takes up to 1 mm of it
HAND_MM = 1.0  # by which a hand that follows a line leaves it
SIDE_MM = 1000.0  # from a cloud to where it is seen from, where no pointer touched it
LOOK_MM = 0.5  # between places at which a line drawn by hand is looked at

PAINTED = Input(
    lambda s: s.painted if len(s.painted) else None,
    "paint regions",
    optional=True,
    title="the painting of regions (step 5)",
)


def paint_region(message: PaintRegion, session: Session) -> Session:
    """Carry out `PaintRegion`.

    Raises:
        StepBlockedError: no surface was measured yet.
        InvalidInputError: the stroke lies off the surface, or there are too many.
    """
    require_inputs(PaintRegion, session)
    cloud = required(SURFACE, session).points_base
    away_mm = float(KDTree(cloud).query(np.array(message.stroke_base_mm))[0].min())
    if away_mm > ON_SURFACE_MM + message.radius_mm:
        raise InvalidInputError(
            f"the stroke lies {away_mm:.0f} mm off the measured surface: paint on the bone"
        )
    strokes = session.painted.strokes
    if len(strokes) >= MAX_STROKES:
        raise InvalidInputError(f"at most {MAX_STROKES} strokes: clear some, or take a wider brush")
    stroke = PaintedStroke(message.kind, message.stroke_base_mm, message.radius_mm)
    return replace(session, painted=PaintedRegions((*strokes, stroke)))


def clear_painted(message: ClearPaintedRegions, session: Session) -> Session:
    """Carry out `ClearPaintedRegions`."""
    kept = () if message.kind is None else session.painted.strokes
    left = tuple(stroke for stroke in kept if stroke.kind != message.kind)
    return replace(session, painted=PaintedRegions(left))


def require_allowed_picks(message: StartPathCapture, session: Session) -> None:
    """Raise InvalidInputError where a line drawn by hand leaves the regions that may be scanned."""
    picks = np.array(message.picks_base_mm, dtype=np.float64)
    if not len(session.painted) or len(picks) < 2:
        return
    for number, (start, end) in enumerate(pairwise(picks), start=1):
        count = int(np.ceil(np.linalg.norm(end - start) / LOOK_MM)) + 1
        line = start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)
        words = why_not(session.painted, line)
        if words is not None:
            raise InvalidInputError(
                f"the line from point {number} to {number + 1} {words}: draw it elsewhere, or "
                "clear what was painted",
                pick=number,
            )


def allowed_in_patch(
    painted: PaintedRegions,
    T_base_patch: Pose,
    *,
    clearance_mm: float = CLEARANCE_MM,
    margin_mm: float = 0.0,
) -> Inside | None:
    """Return the test which places (k, 2) of a plane may be scanned; None where all may.

    Args:
        painted: Strokes.
        T_base_patch: The plane is x and y of it.
        clearance_mm: Kept to what is to be avoided.
        margin_mm: Kept to both.
    """
    if not len(painted):
        return None
    T_patch_base, clearance_mm = T_base_patch.inv(), max(clearance_mm, margin_mm)

    def allowed(places: Floats) -> Bools:
        return painted.allowed(places, T_patch_base, clearance_mm=clearance_mm, margin_mm=margin_mm)

    return allowed


def why_not(painted: PaintedRegions, points_base: Floats) -> str | None:
    """Return why the probe must not follow these points (n, 3) of the bone; None: it may."""
    if painted.avoided(points_base).any():
        return "crosses a region to avoid"
    if not painted.allowed(points_base).all():
        return "leaves the region to scan"
    return None


def require_none_avoided(painted: PaintedRegions, points_base: Floats) -> None:
    """Raise InvalidInputError where a path (n, 3) comes into a region to avoid."""
    if not painted.of("avoid"):
        return
    depths_mm = painted.depths_mm("avoid", points_base)
    inside: Bools = depths_mm >= 0.0
    if not inside.any():
        return
    steps = np.linalg.norm(np.diff(points_base, axis=0), axis=1)
    along = np.concatenate(([0.0], np.cumsum(steps)))
    raise InvalidInputError(
        f"the path comes {depths_mm.max():.1f} mm into a region to avoid, first at "
        f"{along[inside][0]:.0f} mm of its length: draw or generate it again (step 5), take a "
        "smaller tolerance, or clear the region"
    )


PATH_CAPTURE: Input[PointerCapture] = capture_input("path")
PATH: Input[RawPath] = result_input("path")
SMOOTHING: Input[SmoothPath] = result_input("smoothing")
REFERENCE = reference_input(lambda s: found_again(s, (s.captures.path,)))


def is_pattern(session: Session) -> bool:
    """Return whether the path is a pattern drawn by rule, not a demonstration."""
    return _made_by(session) == GenerateScanPattern.__name__


def is_demonstrated(session: Session) -> bool:
    """Return whether the path is no pattern, and no path from elsewhere."""
    return _made_by(session) in (None, BuildPath.__name__)


def _made_by(session: Session) -> str | None:
    path = session.results.path
    return None if path is None else path.message


DEMONSTRATED: Input[PointerCapture] = Input(
    lambda s: s.captures.path if is_demonstrated(s) else None,
    "demonstrate the path",
    optional=True,
    part="capture path",
)


def viewpoint(registered: Registered, strokes: Sequence[PointerCapture]) -> Vector3:
    """Return where the pointer's markers were in strokes: the side the probe comes from."""
    seen = [
        registered.reference(stroke).T_base_tracker @ stroke.marker.Ts_tracker_marker.translations
        for stroke in strokes
    ]
    return np.vstack(seen).mean(axis=0)


def _viewpoint_of_surface(
    registered: Registered | None, strokes: Strokes | None, cloud: SurfaceCloud
) -> Vector3:
    """Return where the pointer's markers were; of a cloud from elsewhere the side that bulges."""
    if registered is None or not strokes:
        return cloud.points_base.mean(axis=0) + SIDE_MM * bulging(cloud.points_base)
    return viewpoint(registered, strokes)


def _viewpoint_of_path(
    registered: Registered | None,
    strokes: Strokes | None,
    cloud: SurfaceCloud,
    demonstrated: PointerCapture | None,
) -> Vector3:
    if registered is not None and demonstrated is not None:
        return viewpoint(registered, (demonstrated,))
    return _viewpoint_of_surface(registered, strokes, cloud)


OF_SURFACE = {"registered": ANY_REGISTERED, "strokes": ANY_STROKES, "surface": SURFACE}
SURFACE_VIEWPOINT: Quantity[Vector3] = Quantity(_viewpoint_of_surface, OF_SURFACE)
VIEWPOINT: Quantity[Vector3] = Quantity(
    _viewpoint_of_path, {**OF_SURFACE, "demonstration": DEMONSTRATED}
)


def _usable_head(session: Session) -> HeadReference | None:
    """Return how the head lay in step 4; None where its strokes are of another set-up."""
    return None if stale_reason("capture surface", session) else head_of(session)


HEAD: Input[HeadReference] = replace(head_input("path"), read=_usable_head)
OF_REGISTRATION = ("place of the tracker", "field of the tracker")


@inputs(implied=OF_REGISTRATION, free=("use of the base marker",))
class PathInputs:
    """What a demonstrated path is mapped from."""

    stroke: PointerCapture = given(PATH_CAPTURE, "capture")
    registered: Registered = given(REGISTERED)
    pointer: PointerCalibration = given(POINTER, "pointer")
    found_again: bool = given(REFERENCE, "reference")
    head: HeadReference | None = given(HEAD, "head")


@inputs(implied=("tool", "strokes", *OF_REGISTRATION), free=("use of the base marker",))
class PatternInputs:
    """What a path by rule is drawn on."""

    cloud: SurfaceCloud = given(SURFACE, "surface")
    radius_mm: float = given(RADIUS, "region")
    painted: PaintedRegions | None = given(PAINTED, "painted regions")
    viewpoint: Vector3 = given(SURFACE_VIEWPOINT)


POINTS: Input[PointsCapture] = capture_input("path_points")


@inputs()
class PointsInputs:
    """What a path from elsewhere is taken from."""

    capture: PointsCapture = given(POINTS, "capture")
