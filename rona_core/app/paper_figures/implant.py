"""Figure 2 of the paper: the implant, and the layered concentric path that mills its bed."""

from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from rona_core.app.paper_figures.style import INK, colour_scale, halves, plane, space
from rona_core.app.steps.implant.bed_milling import MillingView
from rona_core.app.steps.implant.view import milling_view
from rona_core.geometry.arrays import Floats
from rona_core.planning.milling.milling_path import MillingPath, Move
from rona_core.session.document import Session

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
    axes = space(lower, np.concatenate(lines), "bed", -30.0, zoom=1.12)
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
