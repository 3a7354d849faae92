"""Figures 2 and 10 of the paper: the milling path of the bed, and the volume and maps."""

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from rona_core.app.paper_figures.style import INK, PALE, colour_scale, halves, plane, space
from rona_core.app.steps.implant.milling import MillingView
from rona_core.app.steps.implant.view import milling_view
from rona_core.app.steps.maps.export import map_sheet
from rona_core.app.steps.maps.view import ROUND_MM, scale_limits_mm
from rona_core.app.steps.maps.volume import echo_volume
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.colors import BLUE, VERMILLION, css
from rona_core.mapping.files.map_sheet import MapSheet
from rona_core.mapping.volume.echo_volume import EchoVolume
from rona_core.mapping.volume.inner_ridge import GAIN_DB_PER_MM
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.session.document import Session

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FLOOR_DB, TOP_DB = -40.0, 0.0  # of the echoes that are drawn; 0 dB is that of flat bone
OUTER: dict[str, Any] = {"color": css(BLUE), "linewidth": 1.2, "label": "outer boundary"}
INNER: dict[str, Any] = {"color": css(VERMILLION), "linewidth": 1.2, "label": "inner boundary"}
SURFACE: dict[str, Any] = {
    "rstride": 1,
    "cstride": 1,
    "linewidth": 0.0,
    "antialiased": False,
    "shade": False,
    "rasterized": True,
}


def draw_reconstruction(session: Session, figure: "Figure") -> None:
    """Draw both boundaries in space, coloured by thickness, and a section of the echo volume."""
    sheet = map_sheet(session)
    ok = sheet.thickness_ok()
    mapped = ok if ok.any() else sheet.boundary("outer").ok
    row = int(np.argmax(mapped.sum(axis=0)))  # of the section: where most is mapped
    upper, lower = halves(figure)
    _boundaries(upper, sheet, row)
    _section(lower, echo_volume(session), sheet, row)


def _boundaries(figure: Any, sheet: MapSheet, row: int) -> None:
    """Draw the inner boundary, and of the outer one what lies behind the section."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    outer, inner = sheet.boundary("outer"), sheet.boundary("inner")
    ok, thickness = sheet.thickness_ok(), sheet.thickness_mm()
    scale = Normalize(*scale_limits_mm(thickness[ok], ROUND_MM))
    colours = ScalarMappable(scale, colormaps["viridis"].with_extremes(bad=PALE))
    top, bottom = cells_map(outer, outer.ok), cells_map(inner, ok)
    axes = space(figure, np.concatenate((top[outer.ok], bottom[ok])), "map", -70.0, 28.0, 1.3)
    for cells, first, look in ((bottom, 0, INNER), (top, row, OUTER)):
        x, y, z = np.moveaxis(cells[:, first:], 2, 0)
        faces = colours.to_rgba(thickness[:, first:])
        axes.plot_surface(x, y, z, facecolors=faces, **SURFACE)
        axes.plot(*cells[:, row].T, **look)
    figure.text(
        0.02, 0.97, "(a) outer boundary, cut open at the section, and inner boundary", va="top"
    )
    if ok.any():
        colour_scale(figure, colours, "thickness of the bone (mm)", axes, shrink=0.75, pad=0.1)


def cells_map(boundary: BoundaryMap, ok: Bools) -> Floats:
    """Return the cells of a map as places (nu, nv, 3) in ``map``, NaN where they are not ``ok``."""
    u, v = np.meshgrid(boundary.u_mm, boundary.v_mm, indexing="ij")
    return np.where(ok[..., None], np.stack((u, v, boundary.height_mm), axis=2), np.nan)


def _section(figure: Any, volume: EchoVolume, sheet: MapSheet, row: int) -> None:
    """Draw the echoes over one row of the map, with both boundaries."""
    outer, inner = sheet.boundary("outer"), sheet.boundary("inner")
    level = np.where(volume.known, volume.level_db(GAIN_DB_PER_MM), FLOOR_DB)[:, row]
    axes = figure.subplots()
    limits = {"vmin": FLOOR_DB, "vmax": TOP_DB, "cmap": "gray_r", "rasterized": True}
    image = axes.pcolormesh(outer.u_mm, volume.z_mm, level.T, **limits)
    axes.plot(*cells_map(outer, outer.ok)[:, row, ::2].T, **OUTER)
    if sheet.thickness_ok().any():
        axes.plot(*cells_map(inner, sheet.thickness_ok())[:, row, ::2].T, **INNER)
    plane(axes, "x of map (mm)", "z of map (mm)")
    y = f"{outer.v_mm[row]:.1f}".replace("-", "\N{MINUS SIGN}")
    title = f"(b) section of the echo volume at y = {y} mm"
    figure.suptitle(title, x=0.02, ha="left", fontsize=6.5)
    figure.legend(loc="outside lower center", ncols=2)
    label = f"echo level, gain {GAIN_DB_PER_MM:g} dB/mm (dB)"
    colour_scale(figure, image, label, axes, shrink=0.7)


if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

GRID_MM = 5.0  # as in the paper
LEVEL_MM = 0.05  # moves within it have one colour
CUTTING = (Move.ENTRY, Move.CUT, Move.RIM)


def draw_milling_path(session: Session, figure: "Figure") -> None:
    """Draw the implant over a grid, and the milling path from above and in space."""
    view = milling_view(session)
    upper, lower = halves(figure, 1.12)
    left, right = upper.subplots(1, 2)
    _implant(left, view)
    lines = cutting_lines(view.path)
    right.add_collection(_coloured(lines, 2))
    right.autoscale_view()
    right.set_title("(b) milling path from above")
    plane(right, "x of bed (mm)", "y of bed (mm)")
    axes = space(lower, np.concatenate(lines), "bed", -30.0, zoom=1.09)
    drawn = _coloured(lines, 3)
    axes.add_collection(drawn)
    count = len(np.unique(view.path.layers))
    lower.text(0.02, 0.97, f"(c) milling path, {count} layers", va="top")
    colour_scale(lower, drawn, "depth below z = 0 (mm)", axes, shrink=0.7, pad=0.1)


def cutting_lines(path: MillingPath) -> list[Floats]:
    """Return the moves that cut as lines (n, 3) in ``bed``, each of about one depth, deep first."""
    tips, cuts = path.tips_bed, np.isin(path.moves, CUTTING)
    level = np.round(tips[:, 2] / LEVEL_MM)
    goes_on = cuts[1:] & cuts[:-1] & (level[1:] == level[:-1])
    begins = np.flatnonzero(~np.append(False, goes_on))
    lines = [
        tips[max(first - 1, 0) : end]  # from where the move before ended
        for first, end in zip(begins, np.append(begins[1:], len(tips)), strict=True)
        if cuts[first]
    ]
    return sorted(lines, key=lambda line: float(line[-1, 2]))


def _coloured(lines: list[Floats], dimensions: int) -> Any:
    """Return lines in the plane (2) or in space (3), coloured by depth."""
    from matplotlib.collections import LineCollection
    from mpl_toolkits.mplot3d.art3d import Line3DCollection

    kind = LineCollection if dimensions == 2 else Line3DCollection
    made = kind([line[:, :dimensions] for line in lines], cmap="viridis_r", linewidths=0.5)
    made.set_array(np.array([-line[-1, 2] for line in lines]))
    return made


def _implant(axes: "Axes", view: MillingView) -> None:
    """Draw the implant as it lies in the bone, with its screws, over a grid of 5 mm."""
    shades = np.linspace(0.55, 0.8, len(view.implant.terraces()) + 1)[1:]
    for terrace, shade in zip(view.implant.terraces(), shades, strict=True):
        for part in shapely.get_parts(terrace.region):
            outline = shapely.get_coordinates(part.exterior)
            axes.fill(*outline.T, color=str(shade), ec=INK, lw=0.6)
    for screw in view.implant.screws:
        at = np.linspace(0.0, 2.0 * np.pi, 60)
        ring = 0.5 * screw.diameter_mm * np.stack((np.cos(at), np.sin(at)))
        axes.fill(screw.x_mm + ring[0], screw.y_mm + ring[1], color="white", ec=INK, lw=0.6)
    axes.set_title(f"(a) {view.implant.name}; grid {GRID_MM:g} × {GRID_MM:g} mm²")
    plane(axes, "x of bed (mm)", "y of bed (mm)")
    reach = GRID_MM * np.ceil((np.abs(axes.dataLim.get_points()).max() + 1.0) / GRID_MM)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_ticks(np.arange(-reach, reach + 1.0, GRID_MM))
    axes.grid(True)
    axes.set_axisbelow(False)
