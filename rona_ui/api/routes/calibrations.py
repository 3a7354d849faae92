"""Calibrations and motions from elsewhere, judged beside the session; its own motions as files."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from fastapi import APIRouter, Query, Response

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.overview.motion_report import (
    HeldTool,
    Interpolation,
    VerifySettings,
    report_motion,
)
from rona_core.app.paper_figures.hand_eye import hand_eye_picture
from rona_core.app.paper_figures.motion import motion_picture
from rona_core.app.paper_figures.style import MEDIA, Format
from rona_core.app.runtime.saving.session_files import FILE_NAME, plain_name
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.tool.hand_eye_report import (
    HandEyeOptions,
    HandEyeReport,
    both_layouts,
    report_hand_eye,
)
from rona_core.devices.files.poses.pose_columns import PoseLayout
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.limits import limited, require_limits
from rona_core.devices.robots import ROBOTS
from rona_core.devices.settings import STRICT
from rona_core.errors import NotFoundError
from rona_ui.api.answers import FastJson, described, plain
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import EXACT, Bench

router = APIRouter(route_class=BodyRoute, tags=["results"])
MAX_NAME, MAX_COLUMNS = 200, 2000
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind: {} for kind in MEDIA.values()}, "description": "The picture"}
}


@dataclass(frozen=True, slots=True)
class HandEyeFiles:
    """Uploaded files with poses of robot and sensor, and what they do not say.

    Without `sensor_file` the poses of the sensor are the second ones in `robot_file`; `robot` and
    `sensor` name those meant where a file has several. `unit` is mm, cm or m, or one each: m,mm.
    """

    __pydantic_config__: ClassVar = STRICT
    robot_file: str = limited(**FILE_NAME)
    sensor_file: str | None = limited(None, **FILE_NAME)
    setup: Literal["eye-to-hand", "eye-in-hand"] = "eye-to-hand"
    noise: Literal["tracker", "camera"] = "tracker"
    inverse: Literal["robot", "sensor", "both"] | None = None
    robot: str | None = limited(None, maxLength=MAX_NAME)
    sensor: str | None = limited(None, maxLength=MAX_NAME)
    columns: str | None = limited(None, maxLength=MAX_COLUMNS)
    quaternion: Literal["wxyz", "xyzw"] | None = None
    unit: str | None = limited(None, maxLength=8)
    frame: str | None = limited(None, maxLength=MAX_NAME)

    def __post_init__(self) -> None:
        require_limits(self)


@router.post(
    "/sessions/{session_id}/calibrations/hand-eye",
    response_class=FastJson,
    responses=described("object"),
)
def calibrate_hand_eye(bench: Bench, wanted: Annotated[HandEyeFiles, EXACT]) -> FastJson:
    """Calibrate a tracker or camera from poses of robot and sensor that were uploaded.

    The answer is that of `rona calibrate hand-eye --json`: poses, covariance, residuals with and
    without each pose, the worst poses, the next pose, verdict and reasons.
    """
    return FastJson(plain(_report(bench, wanted).figures()))


@router.post(
    "/sessions/{session_id}/calibrations/hand-eye/picture",
    response_class=Response,
    responses=FILE,
)
def draw_hand_eye(
    bench: Bench, wanted: Annotated[HandEyeFiles, EXACT], format: Format = "svg"
) -> Response:
    """Draw how far each pose is off, of the same files."""
    data = hand_eye_picture(_report(bench, wanted), format)
    return Response(data, media_type=MEDIA[format])


def _report(bench: Workbench, wanted: HandEyeFiles) -> HandEyeReport:
    layout = PoseLayout(wanted.columns, wanted.quaternion, None, wanted.frame)
    return report_hand_eye(
        [_uploaded(bench, wanted.robot_file)],
        None if wanted.sensor_file is None else [_uploaded(bench, wanted.sensor_file)],
        HandEyeOptions(wanted.setup, wanted.noise, wanted.inverse, wanted.robot, wanted.sensor),
        layouts=both_layouts(layout, wanted.unit),
    )


def _uploaded(bench: Workbench, name: str) -> NamedFile:
    path = bench.uploads / plain_name(name)
    if not path.is_file():
        raise NotFoundError(f"there is no uploaded file {name!r}: upload it first")
    return NamedFile(name, read_file(path, "an uploaded file"))


OCTETS = "application/octet-stream"
MOST_BYTES = 16 * 1024**2
MOST_PLACES = 20_000  # that are looked at while a request waits
MOTIONS = {"roll": "scan_motion", "implant": "milling_motion"}
MOTION_FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {OCTETS: {}}, "description": "The motion"}
}
EITHER: dict[int | str, dict[str, Any]] = {
    200: {
        "content": {kind: {} for kind in ("application/json", *MEDIA.values())},
        "description": "The verdict, or its picture",
    }
}
Ending = Annotated[
    Literal["csv", "json", "yaml", "script", "mcap"],
    Query(alias="format", description="ending of the file"),
]
Name = Annotated[str, Query(max_length=120, description="of an uploaded file")]
Robot = Annotated[
    str | None,
    Query(max_length=120, description="a robot, or an uploaded `.urdf`; that of the session"),
]


@router.get("/sessions/{session_id}/{step}/motion", response_class=Response, responses=MOTION_FILE)
def get_motion(bench: Bench, step: Literal["roll", "implant"], ending: Ending = "csv") -> Response:
    """Download the certified motion of the scan (`roll`) or of the milling (`implant`).

    Each file carries the digests of motion, certificate and robot. Refused while the motion is
    missing, stale or not certified; URScript for arms of other makers, MCAP without its extra.
    """
    name = f"{MOTIONS[step]}.{ending}"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(REGISTRY.export(bench.session, name), media_type=OCTETS, headers=headers)


@router.get("/sessions/{session_id}/motion/verdict", response_class=Response, responses=EITHER)
def get_motion_verdict(
    bench: Bench,
    file: Name,
    robot: Robot = None,
    obstacles: Literal["session", "self"] = "session",
    interpolation: Interpolation | None = None,
    tool: HeldTool = "probe",
    form: Annotated[Literal["json", "svg", "png"], Query(alias="format")] = "json",
) -> Response:
    """Verify a motion that was planned elsewhere and uploaded: `rona verify` over REST."""
    uploads, session = bench.uploads, bench.session
    named = robot or session.setup.devices.robot.model
    report = report_motion(
        NamedFile(file, read_file(uploads / plain_name(file), "an uploaded file", MOST_BYTES)),
        named if named in ROBOTS else uploads / plain_name(named),
        VerifySettings(interpolation=interpolation, tool=tool, most_places=MOST_PLACES),
        session if obstacles == "session" else None,
    )
    if form == "json":
        return FastJson(plain(report.figures()))
    return Response(motion_picture(report, form), media_type=MEDIA[form])
