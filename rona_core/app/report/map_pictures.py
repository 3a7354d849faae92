"""Pictures of a map for a page: cells in viridis over axes in mm, with a colour bar, as SVG."""

import base64
import io

import numpy as np
from PIL import Image

from rona_core.app.report.page import Html, markup
from rona_core.geometry.arrays import Floats
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.colors import viridis
from rona_core.mapping.files.map_sheet import cell_sizes_mm

WIDTH, LEFT, RIGHT, TOP = 300.0, 30.0, 6.0, 26.0  # of the picture, and around the map
BAR, BELOW = 10.0, 62.0  # height of the colour bar; all that is below the map
TICKS_MM = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # between ticks of an axis
MOST_TICKS = 7
SHADES = 128  # of the colour bar


def map_picture(
    title: str, grid: BoundaryMap, values_mm: Floats, limits_mm: tuple[float, float], digits: int
) -> Html:
    """Return a map as inline SVG; x is u of the map, y is v, both in mm and alike.

    Args:
        title: What the colours show, with its unit.
        grid: Whose cells they are.
        values_mm: One for each cell (nu, nv); NaN is left blank.
        limits_mm: Ends of the colour scale.
        digits: Decimals of its ticks.
    """
    du, dv = cell_sizes_mm(grid)
    low_u, high_u = float(grid.u_mm[0] - du / 2.0), float(grid.u_mm[-1] + du / 2.0)
    low_v, high_v = float(grid.v_mm[0] - dv / 2.0), float(grid.v_mm[-1] + dv / 2.0)
    scale = (WIDTH - LEFT - RIGHT) / max(high_u - low_u, 1e-9)
    width, height = scale * (high_u - low_u), scale * (high_v - low_v)
    bottom = TOP + height
    marks: list[str] = []
    for at in ticks(low_u, high_u):
        x = LEFT + scale * (at - low_u)
        marks.append(f'<path class="tick" d="M{x:.1f} {bottom:.1f}v4"/>')
        marks.append(text(x, bottom + 15.0, f"{at:g}", "middle"))
    for at in ticks(low_v, high_v):
        y = bottom - scale * (at - low_v)
        marks.append(f'<path class="tick" d="M{LEFT:.1f} {y:.1f}h-4"/>')
        marks.append(text(LEFT - 6.0, y + 4.0, f"{at:g}", "end"))
    box = f'x="{LEFT:g}" y="{TOP:g}" width="{width:.2f}" height="{height:.2f}"'
    image, frame = _image(box, values_mm, limits_mm), f'<rect class="frame" {box}/>'
    return Html(
        f'<svg viewBox="0 0 {WIDTH:g} {bottom + BELOW:.1f}" role="img" '
        f'aria-label="{markup(title)}">'
        f"{text(LEFT, 14.0, title, css='title')}{image}{frame}{''.join(marks)}"
        f"{text(LEFT - 6.0, bottom + 15.0, 'mm', 'end')}"
        f"{_bar(bottom + 26.0, width, limits_mm, digits)}</svg>"
    )


def text(x: float, y: float, words: str, anchor: str = "start", css: str = "") -> str:
    """Return a text of an SVG."""
    kind = f' class="{css}"' if css else ""
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"{kind}>{markup(words)}</text>'


def ticks(low: float, high: float) -> Floats:
    """Return round places for the ticks of an axis in mm."""
    step = next((s for s in TICKS_MM if (high - low) / s <= MOST_TICKS), TICKS_MM[-1])
    return step * np.arange(np.ceil(low / step), np.floor(high / step) + 1.0) + 0.0


def _image(box: str, values_mm: Floats, limits_mm: tuple[float, float]) -> str:
    """Return cells (nu, nv) as the picture in a box, v upwards; those that are NaN are clear."""
    known, (low, high) = np.isfinite(values_mm), limits_mm
    share = (np.where(known, values_mm, low) - low) / (high - low)
    pixels = np.dstack((viridis(share), np.where(known, 255, 0).astype(np.uint8)))
    file = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels.transpose(1, 0, 2)[::-1])).save(file, "PNG")
    data = base64.b64encode(file.getvalue()).decode("ascii")
    return (
        f'<image {box} preserveAspectRatio="none" style="image-rendering:pixelated" '
        f'href="data:image/png;base64,{data}"/>'
    )


def _bar(top: float, width: float, limits_mm: tuple[float, float], digits: int) -> str:
    """Return the colour bar with its ticks; its ends stand for all that is beyond them."""
    box = f'x="{LEFT:g}" y="{top:.1f}" width="{width:.2f}" height="{BAR:g}"'
    colors = _image(box, np.linspace(*limits_mm, SHADES)[:, None], limits_mm)
    low, high = limits_mm
    labels = (
        text(LEFT, top + BAR + 14.0, f"≤ {low:.{digits}f}"),
        text(LEFT + width / 2.0, top + BAR + 14.0, f"{(low + high) / 2.0:.{digits}f}", "middle"),
        text(LEFT + width, top + BAR + 14.0, f"≥ {high:.{digits}f} mm", "end"),
    )
    return f"{colors}{''.join(labels)}"
