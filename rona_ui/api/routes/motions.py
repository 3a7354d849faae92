"""Motions of the robot over REST: certified ones as files, and a verdict on one from elsewhere."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.overview.motion_report import (
    HeldTool,
    Interpolation,
    VerifySettings,
    report_motion,
)
from rona_core.app.paper_figures.motion import motion_picture
from rona_core.app.paper_figures.style import MEDIA
from rona_core.app.runtime.saving.session_files import plain_name
from rona_core.devices.files.size_limits import read_file
from rona_core.devices.files.text_tables import NamedFile
from rona_core.devices.robots import ROBOTS
from rona_ui.api.answers import FastJson, plain
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench

router = APIRouter(route_class=BodyRoute, tags=["results"])
OCTETS = "application/octet-stream"
MOST_BYTES = 16 * 1024**2
MOST_PLACES = 20_000  # that are looked at while a request waits
MOTIONS = {"roll": "scan_motion", "implant": "milling_motion"}
FILE: dict[int | str, dict[str, Any]] = {
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


@router.get("/sessions/{session_id}/{step}/motion", response_class=Response, responses=FILE)
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
