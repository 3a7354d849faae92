"""Queries of a session: steps, results, frames, figures; maps and their files."""

import dataclasses
import io
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Response
from fastapi.responses import HTMLResponse

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.judge import StepState, step_states
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.overview.acceptance import JudgedFigure, QualityRow, quality_rows
from rona_core.app.overview.bed_risk import bed_risk
from rona_core.app.overview.frame_graph import frame_rows
from rona_core.app.report.page import POLICY
from rona_core.app.report.report import workbench_report
from rona_core.app.steps.acoustics.view import reference_gain
from rona_core.app.steps.boundaries.ascan_view import ScanName, ascan_plot
from rona_core.app.steps.maps.comparison import ErrorFigures, MapComparison, compare_with_truth
from rona_core.app.steps.maps.inputs import MOST_DRAWS, drawn_maps, map_accuracy
from rona_core.app.steps.maps.volume import volume_file
from rona_core.app.steps.scan.landmarks.view import landmark_report
from rona_core.app.steps.scan.step import probe_advice
from rona_core.app.steps.tool.calibration_view import calibration_view
from rona_core.errors import NotFoundError
from rona_core.session.document import Session
from rona_ui.api.answers import NPY, FastJson, array_in, described, npy_of, plain
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench
from rona_ui.api.routes.procedure import Sent, sent

router = APIRouter(route_class=BodyRoute, tags=["results"])

MaxPoints = Annotated[
    int | None,
    Query(
        ge=2,
        le=1_000_000,
        description="thin arrays out evenly to this many rows; all rows if left out",
    ),
]
Pointer = Annotated[
    str, Query(max_length=500, pattern="^/", description="JSON pointer into the results")
]
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {NPY: {}}, "description": "The array as a file of numpy (.npy)"}
}


@router.get("/sessions/{session_id}/steps")
def list_steps(bench: Bench) -> tuple[StepState, ...]:
    """Return the state of every step: done, ready, blocked or stale, and why."""
    return step_states(bench.session)


# part of the results of a step -> how it is made of a session and the name of the step; none: null
PARTS: dict[str, Callable[[Session, str], Any]] = {
    "step": lambda session, step: step,
    "summary": lambda session, step: (
        REGISTRY.lines[step].summary(session) if step in REGISTRY.lines else ""
    ),
    "setup": lambda session, step: session.setup if step == "setup" else None,
    "probe_advice": lambda session, step: (
        probe_advice(session) if step in ("scan", "maps") else None
    ),
    "verification": lambda session, step: landmark_report(session) if step == "scan" else None,
    "reference_gain": lambda session, step: reference_gain(session) if step == "maps" else None,
    "painted": lambda session, step: session.painted if step == "path" else None,
    "path_edits": lambda session, step: session.path_edits if step == "smoothing" else None,
    "boundary_edits": lambda session, step: session.boundary_edits if step == "maps" else None,
    "accuracy": lambda session, step: map_accuracy(session) if step == "maps" else None,
    "sono_accuracy": lambda session, step: (
        map_accuracy(session, hand=True) if step == "maps" else None
    ),
    "risk": lambda session, step: bed_risk(session) if step == "implant" else None,
    "captures": lambda session, step: {
        name: _capture(name, session) for name in REGISTRY.parts_of(step)[0]
    },
    "results": lambda session, step: {
        name: _result(name, session) for name in REGISTRY.parts_of(step)[1]
    },
}


@router.get(
    "/sessions/{session_id}/results/{step}", response_class=FastJson, responses=described("object")
)
def get_results(bench: Bench, step: str, max_points: MaxPoints = None) -> FastJson:
    """Return what a step measured and computed.

    Lengths are mm, angles rad unless a name says otherwise; poses are a quaternion (w, x, y, z)
    and a translation. An array of more than 2000 values (thinned out first, if you say so) is an
    object: `shape` and `dtype` of the whole array, and `npy`, where it is, relative to this
    address. `value` is null while there is nothing. How sure the maps are stands in
    `accuracy` (of the scan by hand: `sono_accuracy`): standard deviations over their grid.
    `reference_gain` proposes places for a caliper and says what they gain; `verification` of the
    scan says whether tracker, pointer and robot agree on the landmarks. `risk` of the implant says
    how many virtual patients like this one broke the limit of their bed. `acoustics`, beside the
    steps of the procedure, has the delay line, the speed of sound and what other probes would do.
    `version` is that of the program that made a result. `painted` has the regions painted for the
    path, `path_edits` and `boundary_edits` what was changed by hand.
    """
    _require_step(step)
    content = {name: make(bench.session, step) for name, make in PARTS.items()}
    return FastJson(plain(content, max_points, f"{step}/array?at="))


@router.get("/sessions/{session_id}/results/{step}/array", response_class=Response, responses=FILE)
def get_array(bench: Bench, step: str, at: Pointer) -> Response:
    """Download one array of the results of a step (NPY), whole, as the device or step made it.

    The RF of the scan is at `/captures/scan/value/scans/rf` of step `scan`.
    """
    _require_step(step)
    first = at.split("/")[1]
    if first not in PARTS:
        raise NotFoundError(f"the results have no {first!r}: they have {', '.join(PARTS)}")
    data = npy_of(array_in({first: PARTS[first](bench.session, step)}, at))
    return Response(data, media_type=NPY)


def _require_step(step: str) -> None:
    if step in REGISTRY.listed:
        return
    owner = next((s for s in REGISTRY.listed if step in chain(*REGISTRY.parts_of(s))), None)
    if owner is not None:
        raise NotFoundError(f"{step!r} is no step: it is in the results of step {owner!r}")
    raise NotFoundError(f"there is no step {step!r}: it is one of {', '.join(REGISTRY.listed)}")


def _capture(name: str, session: Session) -> dict[str, Any]:
    held = session.captures.get(name)
    missing = held in (None, ())
    stale = None if missing else stale_reason(f"capture {name}", session)
    return {"value": None if missing else held, "stale_reason": stale}


def _result(name: str, session: Session) -> dict[str, Any]:
    derived = session.results.get(name)
    if derived is None:
        return {"value": None, "stale_reason": None}
    parts = {field.name: getattr(derived, field.name) for field in dataclasses.fields(derived)}
    return {**parts, "stale_reason": stale_reason(name, session)}


@router.get(
    "/sessions/{session_id}/calibration/{step}",
    response_class=FastJson,
    responses=described("object", "null"),
)
def get_calibration(bench: Bench, step: Literal["tool", "pointer"]) -> FastJson:
    """Return how good a calibration is expected to be, each pose's residual, and the next pose.

    `marks` of the poses: 0 used, 1 rejected, 2 left out by hand (command `ExcludePoses`). Azimuths
    count from away from the tracker (0) to its +x side (90). `null` while nothing is calibrated.
    """
    view = calibration_view(bench.session, step)
    return FastJson(plain(view))


NAMES = {"first": "first pass", "second": "tilted passes", "hand": "scan by hand"}


@router.get(
    "/sessions/{session_id}/ascans/{scan}/{number}",
    response_class=FastJson,
    responses=described("object"),
)
def get_ascan(bench: Bench, scan: ScanName, number: int) -> FastJson:
    """Return an A-scan (from 0) of either pass or of the scan by hand, and what was found in it.

    Curves are shares of their own largest value; times are in µs from the emission. What was
    corrected by hand (command `CorrectBoundary`) is in its place, and `by_hand` says so.
    """
    plot = ascan_plot(bench.session, number, scan=scan)
    if plot is None:
        raise NotFoundError(f"there is no A-scan {number} in the {NAMES[scan]}")
    return FastJson(plain(plot))


@dataclasses.dataclass(frozen=True, slots=True)
class FrameInfo:
    """One transform: the pose of frame `child` in frame `parent`.

    `sigma_mm` and `sigma_deg` are predicted errors (that of `T_base_tracker` at the skull), null
    for nominal, live and chosen ones (`map`, `bed`); `time_utc` says when it was made, null for
    nominal and live ones.
    """

    name: str
    parent: str
    child: str
    source: str  # the step that made it and by what, "robot" (nominal) or "live"
    wxyz: list[float]
    translation_mm: list[float]
    stale: bool
    reason: str | None  # the same as stale_reason
    stale_reason: str | None
    time_utc: str | None
    sigma_mm: float | None
    sigma_deg: float | None


@router.get("/sessions/{session_id}/frames")
def list_frames(bench: Bench) -> list[FrameInfo]:
    """Return the frame graph: every transform that is known, since when, how well, and if stale."""
    same = ("name", "parent", "child", "source", "time_utc", "sigma_mm", "sigma_deg")
    return [
        FrameInfo(
            **{name: getattr(row, name) for name in same},
            wxyz=row.pose.wxyz().tolist(),
            translation_mm=row.pose.translation.tolist(),
            stale=row.stale_reason is not None,
            reason=row.stale_reason,
            stale_reason=row.stale_reason,
        )
        for row in frame_rows(bench.session, bench.live.get())
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureRow(JudgedFigure):
    """One figure of a session and its verdict; one of a stale result has no value."""

    shown: str  # value with its unit, as the page shows it; empty without one
    limit_shown: str  # limit with its sign and unit; empty without one
    remedy: str | None  # what mends it, in words; null where it passes or nothing is known to
    message: Sent | None  # that does it; null where a person must act


@router.get("/sessions/{session_id}/quality")
def list_figures(bench: Bench) -> list[FigureRow]:
    """Return every figure against ground truth: value, unit, limit, verdict and what mends it.

    `value` is null while a step is missing, or where the devices are real.
    """
    return [_figure_row(row) for row in quality_rows(bench.figures(), bench.session)]


def _figure_row(row: QualityRow) -> FigureRow:
    names = {field.name for field in dataclasses.fields(JudgedFigure)} - {"value"}
    remedy = row.remedy
    message = None if remedy is None else remedy.message
    return FigureRow(
        **{name: getattr(row, name) for name in names},
        value=plain(row.value),
        shown=row.value_words,
        limit_shown=row.limit_words,
        remedy=None if remedy is None else remedy.words,
        message=None if message is None else sent(message),
    )


@router.get("/sessions/{session_id}/report", response_class=HTMLResponse)
def get_report(bench: Bench) -> HTMLResponse:
    """Return the report of the session as one page (HTML) to print and to keep.

    It has no script and loads nothing. What is missing or stale is left out, and it says so. The
    same session gives the same bytes.
    """
    headers = {"Content-Security-Policy": f"{POLICY}; frame-ancestors 'none'"}
    return HTMLResponse(workbench_report(bench), headers=headers)


OCTETS = "application/octet-stream"


def _file(of: str) -> dict[int | str, dict[str, Any]]:
    return {200: {"content": {OCTETS: {}}, "description": f"The {of} file"}}


ExportName = Annotated[
    str,
    Path(
        description="; ".join(f"`{one.name}`: {one.says}" for one in REGISTRY.exports.values()),
        json_schema_extra={"enum": list(REGISTRY.exports)},
    ),
]


@router.get(
    "/sessions/{session_id}/export/{name}", response_class=Response, responses=_file("exported")
)
def get_export(bench: Bench, name: ExportName) -> Response:
    """Download a file of the maps or of the implant bed for another program.

    Places are in `base`, in mm; the milling path is in `bed`. Refused while the result that it is
    made of is missing or stale, where the bed does not lie wholly in the maps, and a motion of the
    robot while it is not certified.
    """
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(REGISTRY.export(bench.session, name), media_type=OCTETS, headers=headers)


DepthStep = Annotated[float, Query(ge=0.1, le=1.0, description="height of a voxel")]
FillRadius = Annotated[float, Query(ge=0.0, le=10.0, description="0 leaves holes as they are")]


@router.get("/sessions/{session_id}/volume", response_class=Response, responses=_file("NRRD"))
def get_volume(
    bench: Bench, depth_step_mm: DepthStep = 0.25, fill_radius_mm: FillRadius = 2.5
) -> Response:
    """Download the echoes of the robot's scan as a volume (NRRD, float) on the cells of its maps.

    1 is the front echo of flat bone in perfect contact; `space directions` and `space origin` are
    in `base`, in mm. Refused while there are no maps, or while they are stale.
    """
    data = volume_file(bench.session, depth_step_mm=depth_step_mm, fill_radius_mm=fill_radius_mm)
    headers = {"Content-Disposition": 'attachment; filename="echo_volume.nrrd"'}
    return Response(data, media_type=OCTETS, headers=headers)


DrawCount = Annotated[int, Query(ge=1, le=MOST_DRAWS, description="how many maps")]
Seed = Annotated[int, Query(ge=0, le=2**32 - 1, description="the same gives the same maps")]
SameRobot = Annotated[bool, Query(description="the robot that scanned uses the map")]


@dataclass(frozen=True, slots=True)
class RegistrationInfo:
    """How a reference came to `base`."""

    T_base_mesh: tuple[tuple[float, ...], ...]  # (4, 4)
    points_rms_mm: float | None
    surface_rms_mm: float | None
    verdict: Literal["good", "weak", "bad"] | None  # of the registration by surface
    reasons: tuple[str, ...]
    sigmas_mm: tuple[float, ...]  # predicted error along each direction, worst first


@dataclass(frozen=True, slots=True)
class ComparisonInfo:
    """Maps beside a reference; positive where the map lies outside, or has more bone."""

    reference: str
    figures: tuple[ErrorFigures, ...]
    registration: RegistrationInfo | None


@router.get("/sessions/{session_id}/maps/comparison")
def get_comparison_with_truth(bench: Bench) -> ComparisonInfo:
    """Compare the robot's maps with the true bone of virtual devices.

    Refused while there are no maps, while they are stale, and with real devices.
    """
    return comparison_info(compare_with_truth(bench.session, bench.map_errors()))


def comparison_info(found: MapComparison) -> ComparisonInfo:
    """Return the figures of a comparison, and how its reference was laid."""
    place = found.place
    if place is None:
        return ComparisonInfo(found.name, found.figures, None)
    fit = place.surface
    rows = tuple(tuple(float(x) for x in row) for row in place.T_base_mesh.matrix())
    return ComparisonInfo(
        found.name,
        found.figures,
        RegistrationInfo(
            rows,
            place.points_rms_mm,
            None if fit is None else fit.rms_mm,
            None if fit is None else fit.verdict,
            () if fit is None else fit.reasons,
            () if fit is None else tuple(map(float, fit.sigmas_mm)),
        ),
    )


@router.get("/sessions/{session_id}/maps/draws", response_class=Response, responses=_file("NPZ"))
def get_map_draws(
    bench: Bench, count: DrawCount = 100, seed: Seed = 0, same_robot: SameRobot = False
) -> Response:
    """Download maps as they may be, drawn from all that is unknown of them (NPZ).

    `outer_mm` and `inner_mm` (count, nu, nv) are heights in the frame `T_base_map` (4, 4) over
    `u_mm` and `v_mm`; `ok` (nu, nv) says where both boundaries were mapped. Refused while there are
    no maps, or while they are stale.
    """
    draws = drawn_maps(bench.session, count, seed, same_robot=same_robot)
    maps, data = draws.maps, io.BytesIO()
    np.savez_compressed(
        data,
        T_base_map=maps.outer.T_base_map.matrix(),
        u_mm=maps.outer.u_mm,
        v_mm=maps.outer.v_mm,
        ok=maps.outer.ok & maps.inner.ok,
        outer_mm=draws.outer_mm.astype(np.float32),
        inner_mm=draws.inner_mm.astype(np.float32),
    )
    headers = {"Content-Disposition": 'attachment; filename="map_draws.npz"'}
    return Response(data.getvalue(), media_type=OCTETS, headers=headers)
