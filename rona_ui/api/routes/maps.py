"""What step 9 made: files for other programs, the echo volume, a comparison, draws."""

import io
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import APIRouter, Path, Query, Response

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.maps.accuracy import MOST_DRAWS, drawn_maps
from rona_core.app.steps.maps.comparison import (
    ErrorFigures,
    MapComparison,
    compare_with_truth,
)
from rona_core.app.steps.maps.volume import volume_file
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench

router = APIRouter(route_class=BodyRoute, tags=["results"])

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
