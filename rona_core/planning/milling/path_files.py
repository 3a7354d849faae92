"""Files of a milling path and its bed that other programs read: CSV, G-code, STL."""

import numpy as np

from rona_core.devices.limits import require
from rona_core.geometry.arrays import Floats
from rona_core.geometry.pose import Pose
from rona_core.mapping.files.map_mesh import MapMesh, closable_triangles, rim_edges
from rona_core.mapping.files.mesh_files import stl_bytes
from rona_core.planning.bed import Bed
from rona_core.planning.milling.milling_path import MillingPath, Move

COLUMNS = "x_mm,y_mm,z_mm,axis_x,axis_y,axis_z,feed_mm_per_s,move,layer,burr_diameter_mm"
RAPID = int(Move.RETRACT)


def path_csv(path: MillingPath, feeds_mm_per_s: Floats) -> str:
    """Return the path as a table: tip and axis (into the bone) in ``bed``, one row for each place.

    Raises:
        InvalidInputError: not as many feeds as places.
    """
    _require_feeds(path, feeds_mm_per_s)
    rows = [COLUMNS]
    for k in range(len(path)):
        numbers = (*path.tips_bed[k], *path.axes_bed[k], feeds_mm_per_s[k])
        move = Move(int(path.moves[k])).name.lower()
        diameter_mm = path.burrs[int(path.tools[k])].diameter_mm
        values = ",".join(f"{value:.6g}" for value in numbers)
        rows.append(f"{values},{move},{path.layers[k]},{diameter_mm:g}")
    return "\n".join(rows) + "\n"


def path_gcode(path: MillingPath, feeds_mm_per_s: Floats) -> str:
    """Return the path as G-code in mm and mm/min, its zero at the origin of ``bed``.

    X, Y and Z are the tip of the tool. Where a burr is tilted, A and B turn it about x and then
    about y by degrees, out of upright.

    Raises:
        InvalidInputError: not as many feeds as places.
    """
    _require_feeds(path, feeds_mm_per_s)
    axes = path.axes_bed
    a_deg = np.rad2deg(np.arctan2(axes[:, 1], np.hypot(axes[:, 0], axes[:, 2])))
    b_deg = np.rad2deg(np.arctan2(-axes[:, 0], -axes[:, 2]))
    tilted = bool((np.abs(axes[:, :2]) > 1e-9).any())
    lines = ["(bed of an implant, frame bed, z out of the bone)", "G21", "G90", "G94"]
    tool = -1
    for k in range(len(path)):
        if int(path.tools[k]) != tool:
            tool = int(path.tools[k])
            burr = path.burrs[tool]
            lines.append(
                f"(burr of {burr.diameter_mm:g} mm, corner radius {burr.corner_radius_mm:g} mm)"
            )
            lines.append(f"T{tool + 1} M6")
        x, y, z = path.tips_bed[k]
        word = "G0" if path.moves[k] == RAPID else "G1"
        line = f"{word} X{x:.4f} Y{y:.4f} Z{z:.4f}"
        if tilted:
            line += f" A{a_deg[k]:.4f} B{b_deg[k]:.4f}"
        lines.append(line if word == "G0" else f"{line} F{60.0 * feeds_mm_per_s[k]:.1f}")
    return "\n".join((*lines, "M30", ""))


def bed_stl(bed: Bed, T_base_bed: Pose) -> bytes:
    """Return the closed body that a bed takes out of the bone below z = 0 as STL, in ``base``.

    Raises:
        DegenerateGeometryError: the bed has no three neighbouring cells.
    """
    return stl_bytes(bed_mesh(bed, T_base_bed))


def bed_mesh(bed: Bed, T_base_bed: Pose) -> MapMesh:
    """Return the closed mesh of what a bed takes out of the bone below z = 0, in ``base``.

    Raises:
        DegenerateGeometryError: the bed has no three neighbouring cells.
    """
    triangles = closable_triangles(bed.cut())
    used, rows = np.unique(triangles, return_inverse=True)
    top = rows.reshape(triangles.shape)
    n = len(used)
    x, y = np.meshgrid(bed.x_mm, bed.y_mm, indexing="ij")
    flat = np.column_stack((x.ravel(), y.ravel()))[used]
    depth = bed.depth_mm.ravel()[used]
    points_bed = np.vstack((np.column_stack((flat, np.zeros(n))), np.column_stack((flat, -depth))))
    rim = rim_edges(top)
    a, b = rim[:, 0], rim[:, 1]
    walls = np.vstack((np.column_stack((b, a, a + n)), np.column_stack((b, a + n, b + n))))
    return MapMesh(T_base_bed @ points_bed, np.vstack((top, top[:, ::-1] + n, walls)), {})


def _require_feeds(path: MillingPath, feeds_mm_per_s: Floats) -> None:
    require(
        feeds_mm_per_s.shape == (len(path),),
        f"feeds_mm_per_s must have shape ({len(path)},), not {feeds_mm_per_s.shape}",
    )
