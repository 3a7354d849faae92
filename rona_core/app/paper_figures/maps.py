"""Figure 10 of the paper: the volume of the scan, and both boundaries of the bone in it."""

from typing import TYPE_CHECKING, Any

import numpy as np

from rona_core.app.paper_figures.style import PALE, colour_scale, halves, plane, space
from rona_core.app.steps.maps.export import map_sheet
from rona_core.app.steps.maps.view import ROUND_MM, scale_limits_mm
from rona_core.app.steps.maps.volume import echo_volume
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.colors import BLUE, VERMILLION, css
from rona_core.mapping.files.map_sheet import MapSheet
from rona_core.mapping.volume.echo_volume import EchoVolume
from rona_core.mapping.volume.inner_ridge import GAIN_DB_PER_MM
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
