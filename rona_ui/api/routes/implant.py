"""What step 10 made: the milling path of the bed, and the body that is milled away."""

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response

from rona_core.app.steps.implant.export import export_bed
from rona_ui.api.context import Bench

router = APIRouter(tags=["results"])

OCTETS = "application/octet-stream"
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {OCTETS: {}}, "description": "The file"},
}
PathFormat = Annotated[Literal["csv", "gcode"], Query(description="a table, or for a machine")]


@router.get("/sessions/{session_id}/bed/path", response_class=Response, responses=FILE)
def get_bed_path(bench: Bench, format: PathFormat = "csv") -> Response:
    """Download the milling path of the bed: the burr's tip and axis in the frame `bed`, in mm.

    `csv` has feed, kind of move, layer and burr in each row; `gcode` is in mm and mm/min, its zero
    in the middle of the implant's seat. Refused while there is no bed, while it is stale, and where
    it does not lie wholly in the maps. No robot has been asked whether it can.
    """
    return _file(bench, f"bed_path.{format}")


@router.get("/sessions/{session_id}/bed/stl", response_class=Response, responses=FILE)
def get_bed_body(bench: Bench) -> Response:
    """Download the closed body that the burr takes out of the bone (STL), in `base`, in mm.

    Refused while there is no bed, while it is stale, and where it does not lie wholly in the maps.
    """
    return _file(bench, "bed.stl")


def _file(bench: Bench, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return Response(export_bed(bench.session, name), media_type=OCTETS, headers=headers)
