"""Surface cloud from the strokes of the pointer, and where a loaded skull lies under it.

Find where a loaded skull lies in ``base``: the pointer's surface points laid onto its surface. What
is used is the file, the region that was chosen in it, and what the pointer measured. Where the
virtual skull really lies is not known here.
"""

from dataclasses import replace

import numpy as np

from rona_core.app.declarations.inputs import Input, given, inputs
from rona_core.app.dependencies.references import (
    REGISTERED,
    HeadReference,
    Registered,
    found_again,
    head_input,
)
from rona_core.app.dependencies.staleness import (
    capture_input,
    outward_of_surface,
    result_input,
)
from rona_core.app.steps.pointer.derivation import POINTER
from rona_core.app.steps.setup.capture_parts import REGION, SKULL, reference_input
from rona_core.app.steps.surface.messages import BuildSurface, StartSkullRegistration, TakeCloud
from rona_core.app.steps.tool.derivation import TOOL
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.handheld.pointer import PointerCalibration
from rona_core.calibration.surface_registration import (
    Closest,
    SurfaceRegistration,
    point_surface,
    register_surface,
)
from rona_core.devices.protocols import Cancel, Progress
from rona_core.devices.settings import POINTERS
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.geometry.arrays import Floats, Vector3, readonly
from rona_core.geometry.pose import Pose
from rona_core.geometry.surface.cloud import SurfaceCloud, build_cloud, merge_clouds
from rona_core.session.captures import PointerCapture, PointsCapture
from rona_core.session.document import RegionChoice
from rona_core.session.specimen import LoadedSkull, SimulatedSkull

Strokes = tuple[PointerCapture, ...]
SURFACE_CAPTURE: Input[Strokes] = capture_input("surface")
SURFACE: Input[SurfaceCloud] = result_input("surface")
# False where the tracker has moved and may not be found again; it counts for nothing else
REFERENCE = reference_input(lambda s: found_again(s, s.captures.surface))


@inputs(
    implied=("place of the tracker", "field of the tracker", "head"),
    free=("use of the base marker",),  # where it matters the reference changes
)
class SurfaceInputs:
    """What the point cloud is built from."""

    strokes: Strokes = given(SURFACE_CAPTURE, "capture")
    registered: Registered = given(REGISTERED)
    pointer: PointerCalibration = given(POINTER, "pointer")
    found_again: bool = given(REFERENCE, "reference")
    head: HeadReference | None = given(head_input("surface"), "head")


ANY_TOOL: Input[ToolRegistration] = replace(TOOL, optional=True)
ANY_STROKES: Input[Strokes] = replace(SURFACE_CAPTURE, optional=True)


@inputs(implied=("tool", "strokes"))
class SkullInputs:
    """What a loaded skull is laid under."""

    cloud: SurfaceCloud = given(SURFACE, "surface")
    skull: SimulatedSkull | LoadedSkull = given(SKULL, "skull")
    region: RegionChoice = given(REGION, "region")
    tool: ToolRegistration | None = given(ANY_TOOL, "tool")
    strokes: Strokes = given(ANY_STROKES, "strokes")


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
            f"the stroke was made with the {POINTERS[capture.pointer]}, but the "
            f"{POINTERS[pointer.pointer]} is calibrated: calibrate the other one, or record the "
            "stroke again"
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


CLOUD: Input[PointsCapture] = capture_input("cloud")


@inputs()
class CloudInputs:
    """What a cloud from elsewhere is taken from."""

    capture: PointsCapture = given(CLOUD, "capture")


def cloud_from_elsewhere(known: CloudInputs, message: TakeCloud) -> SurfaceCloud:
    """Return the points of a cloud from elsewhere, as they are; they have no times."""
    points, n = known.capture.points_base, len(known.capture.points_base)
    return SurfaceCloud(
        points_base=points,
        times_s=readonly(np.arange(n, dtype=np.float64)),
        strokes=readonly(np.zeros(n, dtype=np.int64)),
        n_dropped=0,
        n_raw=n,
        average_s=0.0,
    )


NORMAL_PATCH_MM = 10.0  # over which the normals at the middle of the region are averaged
COARSE_POINTS = 300  # of the cloud, while the turns are tried
SEARCH_SHARE = 0.7  # of the progress
OTHER_DEG = 10.0  # two answers that differ by more are not the same
RIVAL = 1.15  # a rival fits as well if its distances are larger by less


def outer_surface(skull: LoadedSkull) -> tuple[Floats, Floats]:
    """Return the outer surface of the stored part: points (n, 3) and outward unit normals (n, 3).

    Each column of the grid is followed from outside to where it first enters the bone.
    """
    distance = np.asarray(skull.distance_um, dtype=np.float64)
    entering = (distance[:, :, :-1] <= 0.0) & (distance[:, :, 1:] > 0.0)
    i, j = np.nonzero(entering.any(axis=2))
    k = entering.shape[2] - 1 - entering[i, j, ::-1].argmax(axis=1)
    below, above = distance[i, j, k], distance[i, j, k + 1]
    share = below / (below - above)
    slope = np.zeros((len(i), 3))
    for axis in range(3):
        rise: Floats = np.gradient(distance, axis=axis)
        slope[:, axis] = (1.0 - share) * rise[i, j, k] + share * rise[i, j, k + 1]
    steep = np.linalg.norm(slope, axis=1)
    there = steep > 0.0
    places = np.column_stack((i, j, k + share))[there]
    points = skull.origin_skull + skull.spacing_mm * places @ skull.axes_skull.T
    return points, (slope[there] / steep[there, None]) @ skull.axes_skull.T


def register_skull(
    known: SkullInputs, message: StartSkullRegistration, *, progress: Progress, cancel: Cancel
) -> SurfaceRegistration:
    """Return ``T_skull_base`` (``T_b_a``: a is base, b is the file of the skull) of the cloud.

    Raises:
        StepBlockedError: the skull is simulated, or there is no cloud.
        InvalidInputError: too few points.
        DegenerateGeometryError: no start lays the points onto the skull.
        CancelledError: ``cancel`` returned True.
    """
    skull, points_base = require_loaded(known.skull), known.cloud.points_base
    points_skull, normals_skull = outer_surface(skull)
    surface = point_surface(points_skull, normals_skull)
    if message.guess_wxyz is not None and message.guess_mm is not None:
        guess = Pose.from_wxyz(message.guess_wxyz, message.guess_mm).inv()
        return register_surface(points_base, surface, start=guess, cancel=cancel, progress=progress)
    center_base, normal_base = _middle_of_cloud(known, points_base)
    center_skull = known.region.center_mesh_mm or skull.center_skull
    away = np.linalg.norm(points_skull - center_skull, axis=1)
    foot_skull = points_skull[away.argmin()]
    normal_skull = normals_skull[away <= NORMAL_PATCH_MM + away.min()].mean(axis=0)
    starts = [
        _laid(center_base, normal_base, foot_skull, normal_skull, turn)
        for turn in np.linspace(0.0, 2.0 * np.pi, message.n_turns, endpoint=False)
    ]
    found = _search(points_base, surface, starts, progress, cancel)
    best = register_surface(
        points_base,
        surface,
        start=found[0].T_b_a,
        cancel=cancel,
        progress=lambda share: progress(SEARCH_SHARE + (1.0 - SEARCH_SHARE) * share),
    )
    rival = next((one for one in found[1:] if _apart_deg(one, best) > OTHER_DEG), None)
    if rival is None:
        return best
    other = register_surface(points_base, surface, start=rival.T_b_a, n_starts=1, cancel=cancel)
    return _against(best, other)


def _search(
    points_base: Floats, surface: Closest, starts: list[Pose], progress: Progress, cancel: Cancel
) -> list[SurfaceRegistration]:
    """Return what the starts lead to, the best first."""
    some = points_base[:: max(1, len(points_base) // COARSE_POINTS)]
    found: list[SurfaceRegistration] = []
    for i, start in enumerate(starts):
        try:
            found.append(register_surface(some, surface, start=start, n_starts=1, cancel=cancel))
        except DegenerateGeometryError:
            continue  # this start led away from the bone
        finally:
            progress(SEARCH_SHARE * (i + 1) / len(starts))
    if not found:
        raise DegenerateGeometryError(
            f"none of {len(starts)} starts lays the {len(points_base)} points onto the skull: "
            "sample the region that was chosen on it, or give a guess"
        )
    return sorted(found, key=lambda one: one.sigma_mm)


def _against(best: SurfaceRegistration, other: SurfaceRegistration) -> SurfaceRegistration:
    """Return the better one; it is bad if the other fits as well."""
    if other.sigma_mm < best.sigma_mm:
        best, other = other, best
    apart_deg = _apart_deg(best, other)
    if apart_deg <= OTHER_DEG or other.sigma_mm > RIVAL * best.sigma_mm:
        return best
    reason = (
        f"the skull turned by {apart_deg:.0f} degrees fits nearly as well (distances of "
        f"{other.sigma_mm:.2f} mm against {best.sigma_mm:.2f} mm): touch it farther apart, on "
        "sides that face elsewhere, or give a guess"
    )
    return replace(best, verdict="bad", reasons=(*best.reasons, reason))


def _apart_deg(one: SurfaceRegistration, other: SurfaceRegistration) -> float:
    """Return the angle between two answers."""
    turn = one.T_b_a.rotation.T @ other.T_b_a.rotation
    return float(np.rad2deg(np.arccos(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0))))


def _middle_of_cloud(known: SkullInputs, points_base: Floats) -> tuple[Vector3, Vector3]:
    """Return the point in the middle of the cloud, and the outward normal of its plane.

    Outward is where the markers of the pointer were, else where the patch bulges.
    """
    mean = points_base.mean(axis=0)
    middle = points_base[np.linalg.norm(points_base - mean, axis=1).argmin()]
    normal = np.linalg.svd(points_base - mean, full_matrices=False)[2][2]
    outward = outward_of_surface(known.tool, known.cloud, known.strokes or ())
    return middle, normal if normal @ outward > 0.0 else -normal


def _laid(
    center_a: Vector3, normal_a: Vector3, center_b: Vector3, normal_b: Vector3, turn_rad: float
) -> Pose:
    """Return ``T_b_a`` that lays center on center and normal on normal, turned about it."""
    axes_b = _upright(normal_b)
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    about = np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    R_b_a = axes_b @ about @ _upright(normal_a).T
    return Pose(R_b_a, center_b - R_b_a @ center_a)


def _upright(normal: Vector3) -> Floats:
    """Return axes (3, 3), in columns, whose third is along a normal."""
    z = normal / float(np.linalg.norm(normal))
    x: Vector3 = np.linalg.svd(z[None])[2][1]
    return np.column_stack((x, np.cross(z, x), z))


def require_loaded(skull: SimulatedSkull | LoadedSkull) -> LoadedSkull:
    """Return a loaded skull.

    Raises:
        StepBlockedError: a simulated skull lies on the table.
    """
    if not isinstance(skull, LoadedSkull):
        raise StepBlockedError(
            "the registration of the skull needs a loaded CT, mask or mesh: a simulated skull has "
            "no file to register to; load one in step 1"
        )
    return skull
