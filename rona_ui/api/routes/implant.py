"""What step 10 made: milling path of the bed, body that is milled away, the robot's motion."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response

from rona_core.app.steps.implant.export import export_bed
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench

router = APIRouter(route_class=BodyRoute, tags=["results"])

OCTETS = "application/octet-stream"
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {OCTETS: {}}, "description": "The file"},
}
MotionFormat = Annotated[
    Literal["csv", "urscript"], Query(description="a table, or a program for a UR arm")
]
MOTION_FILES = {"csv": "milling_joints.csv", "urscript": "milling.script"}
PathFormat = Annotated[Literal["csv", "gcode"], Query(description="a table, or for a machine")]


@router.get("/sessions/{session_id}/bed/path", response_class=Response, responses=FILE)
def get_bed_path(bench: Bench, format: PathFormat = "csv") -> Response:
    """Download the milling path of the bed: the burr's tip and axis in the frame `bed`, in mm.

    `csv` has feed, kind of move, layer and burr in each row; `gcode` is in mm and mm/min, its zero
    in the middle of the implant's seat. Refused while there is no bed, while it is stale, and where
    it does not lie wholly in the maps. How the robot follows it is in `bed/motion`.
    """
    return _file(bench, f"bed_path.{format}")


@router.get("/sessions/{session_id}/bed/stl", response_class=Response, responses=FILE)
def get_bed_body(bench: Bench) -> Response:
    """Download the closed body that the burr takes out of the bone (STL), in `base`, in mm.

    Refused while there is no bed, while it is stale, and where it does not lie wholly in the maps.
    """
    return _file(bench, "bed.stl")


@router.get("/sessions/{session_id}/bed/markups", response_class=Response, responses=FILE)
def get_bed_markups(bench: Bench) -> Response:
    """Download outline, axis, screws and thinnest place of the bed for 3D Slicer (`.mrk.json`).

    In `base`, in mm, coordinate system `LPS`. Refused while there is no bed, while it is stale, and
    where it does not lie wholly in the maps.
    """
    return _file(bench, "bed.mrk.json")


@router.get("/sessions/{session_id}/bed/motion", response_class=Response, responses=FILE)
def get_bed_motion(bench: Bench, format: MotionFormat = "csv") -> Response:
    """Download how the robot mills the bed: joint angles in rad over time in s, from home to home.

    `csv` has layer and burr in each row; `urscript` is a program for UR arms alone, which follows
    the angles by `servoj` and waits for another burr: check it at reduced speed. Refused while no
    motion is certified, and while it is stale.
    """
    return _file(bench, MOTION_FILES[format])


def _file(bench: Bench, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(export_bed(bench.session, name), media_type=OCTETS, headers=headers)
