"""Calibrations of what was recorded elsewhere and uploaded; no session is changed."""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from fastapi import APIRouter, Response

from rona_core.app.paper_figures.hand_eye import hand_eye_picture
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
