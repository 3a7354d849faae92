"""Meshes of maps as PLY, STL and VTP."""

import base64
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from rona_core.geometry.arrays import Floats
from rona_core.mapping.files.map_mesh import MapMesh

FRAME = "RONA frame base, mm, SPACE=LPS"  # what 3D Slicer reads in the header of a PLY or STL


def ply_bytes(mesh: MapMesh) -> bytes:
    """Return a binary PLY; points and values are float64, so nothing is rounded."""
    names = tuple(mesh.values)
    head = ["ply", "format binary_little_endian 1.0", f"comment {FRAME}"]
    head.append("comment sigma: one standard deviation; NaN where not known")
    head.append(f"element vertex {len(mesh.points_base)}")
    head += [f"property double {name}" for name in ("x", "y", "z", *names)]
    head += [f"element face {len(mesh.triangles)}", "property list uchar int vertex_indices"]
    rows = np.column_stack((mesh.points_base, *(mesh.values[name] for name in names)))
    faces = np.zeros(len(mesh.triangles), dtype=[("n", "u1"), ("corners", "<i4", 3)])
    faces["n"], faces["corners"] = 3, mesh.triangles
    text = "\n".join([*head, "end_header", ""]).encode("ascii")
    return text + rows.astype("<f8").tobytes() + faces.tobytes()


def stl_bytes(mesh: MapMesh) -> bytes:
    """Return a binary STL. It knows float32 alone: at 1 m, places are rounded by up to 0.03 µm."""
    corners = mesh.points_base[mesh.triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(across, axis=1, keepdims=True)
    facets = np.zeros(
        len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")]
    )
    facets["normal"] = across / np.where(length > 0.0, length, 1.0)
    facets["corners"] = corners
    head = FRAME.encode("ascii").ljust(80)
    return head + np.uint32(len(facets)).astype("<u4").tobytes() + facets.tobytes()


def vtp_bytes(mesh: MapMesh) -> bytes:
    """Return VTK XML PolyData; ``ok`` is 0 where the thickness is not known, which is NaN."""
    ok = np.isfinite(mesh.values["thickness_mm"]).astype("u1")
    n, m = len(mesh.points_base), len(mesh.triangles)
    points = _array("points_base", mesh.points_base.astype("<f8"), "Float64", 3)
    data = [_array(name, one.astype("<f8"), "Float64") for name, one in mesh.values.items()]
    data.append(_array("ok", ok, "UInt8"))
    rows = _array("connectivity", mesh.triangles.astype("<i8").ravel(), "Int64")
    ends = _array("offsets", 3 * np.arange(1, m + 1, dtype="<i8"), "Int64")
    lines = [
        '<?xml version="1.0"?>',
        f"<!-- {FRAME} -->",
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f'<PolyData><Piece NumberOfPoints="{n}" NumberOfVerts="0" NumberOfLines="0" '
        f'NumberOfStrips="0" NumberOfPolys="{m}">',
        f"<Points>{points}</Points>",
        f'<PointData Scalars="thickness_mm">{"".join(data)}</PointData>',
        f"<Polys>{rows}{ends}</Polys>",
        "</Piece></PolyData></VTKFile>",
        "",
    ]
    return "\n".join(lines).encode("utf-8")


def _array(name: str, values: Floats | NDArray[np.generic], kind: str, width: int = 1) -> str:
    raw = np.ascontiguousarray(values).tobytes()
    text = base64.b64encode(np.uint64(len(raw)).astype("<u8").tobytes() + raw).decode("ascii")
    return (
        f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}" '
        f'format="binary">{text}</DataArray>'
    )
