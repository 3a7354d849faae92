"""Markups of the maps for 3D Slicer (``.mrk.json``): rim of the mapped bone, thinnest, thickest."""

import json
from typing import Any, Literal

import numpy as np

from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.arrays import Floats
from rona_core.mapping.files.map_mesh import plate_triangles, rim_edges
from rona_core.mapping.files.map_sheet import MapSheet

SCHEMA_URI = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/"
    "Schema/markups-schema-v1.0.3.json#"
)


def maps_markups(sheet: MapSheet) -> bytes:
    """Return a closed curve about the bone that both maps know, and its extremes of thickness.

    Points lie on the outer boundary, in ``base``; labels give the thickness and its sigma.

    Raises:
        DegenerateGeometryError: no three neighbouring cells have both boundaries.
    """
    points = sheet.points_base("outer").reshape(-1, 3)
    loop = _longest_loop(rim_edges(plate_triangles(sheet)))
    thickness, sigma = sheet.thickness_mm().ravel(), sheet.sigma_mm("thickness")["total"].ravel()
    ends = {"thinnest": int(np.nanargmin(thickness)), "thickest": int(np.nanargmax(thickness))}
    labels = [f"{name} {_words(thickness[cell], sigma[cell])}" for name, cell in ends.items()]
    rim = closed_curve("mapped bone", points[loop], "rim")
    named = markup("Fiducial", "bone thickness", points[list(ends.values())], labels)
    return markups_file(rim, named)


def markups_file(*markups: dict[str, Any]) -> bytes:
    """Return a file of markups."""
    return json.dumps({"@schema": SCHEMA_URI, "markups": markups}, indent=1).encode("ascii")


def closed_curve(name: str, points: Floats, label: str) -> dict[str, Any]:
    """Return a closed curve through points (n, 3), which are numbered."""
    return markup("ClosedCurve", name, points, [f"{label}-{i + 1}" for i in range(len(points))])


def markup(
    kind: Literal["ClosedCurve", "Line", "Fiducial"], name: str, points: Floats, labels: list[str]
) -> dict[str, Any]:
    """Return a markup with control points (n, 3), in mm, and their labels (n,)."""
    controls = [
        {"id": str(number), "label": label, "position": place, "positionStatus": "defined"}
        for number, (label, place) in enumerate(zip(labels, points.tolist(), strict=True), 1)
    ]
    return {
        "type": kind,
        "name": name,
        "coordinateSystem": "LPS",
        "coordinateUnits": "mm",
        "controlPoints": controls,
    }


def _words(thickness_mm: float, sigma_mm: float) -> str:
    known = f" +/- {sigma_mm:.2f}" if np.isfinite(sigma_mm) else ""
    return f"{thickness_mm:.2f}{known} mm"


def _longest_loop(edges: np.ndarray) -> list[int]:
    """Return the cells of the loop of edges (k, 2) that has most of them, in their order."""
    after = dict(edges.tolist())  # a rim passes a cell once
    loops: list[list[int]] = []
    while after:
        first, cell = after.popitem()
        loop = [first]
        while cell != first:
            loop.append(cell)
            if cell not in after:
                raise DegenerateGeometryError("the rim of the mapped bone is no closed curve")
            cell = after.pop(cell)
        loops.append(loop)
    return max(loops, key=len)
