"""Graphs of the bone for a page, as SVG: a section through the maps, and its thickness."""

import numpy as np

from rona_core.app.report.map_pictures import text, ticks
from rona_core.app.report.page import Html
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.files.map_sheet import MapSheet

LEFT, RIGHT, TOP, BELOW = 38.0, 8.0, 24.0, 34.0
SECTION, HISTOGRAM = 520.0, 346.0  # widths
BARS = 180.0  # height of the largest
BAR_MM = 0.25  # of the histogram
SIGMAS = 2.0  # half width of a band


def section_graph(sheet: MapSheet) -> Html:
    """Return the section along u through the row with the most mapped cells; heights to scale.

    Both boundaries have a band of two standard deviations where those are known.
    """
    outer, inner = sheet.boundary("outer"), sheet.boundary("inner")
    both = sheet.thickness_ok()
    row = int(np.argmax(both.sum(axis=0)))
    u, heights = outer.u_mm, {"outer": outer.height_mm[:, row], "inner": inner.height_mm[:, row]}
    ok = {"outer": outer.ok[:, row], "inner": both[:, row]}
    sigma = {name: sheet.sigma_mm(name)["total"][:, row] for name in heights}
    shown = np.concatenate([heights[name][ok[name]] for name in heights])
    if not len(shown):
        return Html("")
    low, high = float(shown.min()) - 1.0, float(shown.max()) + 1.0
    low_u, high_u = float(u[0]), float(u[-1])
    scale = (SECTION - LEFT - RIGHT) / max(high_u - low_u, 1e-9)
    height = scale * (high - low)

    def xy(at_u: Floats, z: Floats) -> str:
        x, y = LEFT + scale * (at_u - low_u), TOP + scale * (high - z)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))

    parts: list[str] = []
    for run in runs(ok["inner"]):
        edge = (xy(u[run], heights["outer"][run]), xy(u[run][::-1], heights["inner"][run][::-1]))
        parts.append(f'<polygon points="{" ".join(edge)}" fill="var(--bone)"/>')
    for name in heights:
        z, s = heights[name], SIGMAS * sigma[name]
        for run in runs(ok[name] & np.isfinite(sigma[name])):
            band = (xy(u[run], z[run] + s[run]), xy(u[run][::-1], (z - s)[run][::-1]))
            points = " ".join(band)
            parts.append(f'<polygon points="{points}" fill="var(--band)" fill-opacity="0.3"/>')
        for run in runs(ok[name]):
            line = xy(u[run], z[run])
            parts.append(f'<polyline points="{line}" fill="none" stroke="var(--band)"/>')
    title = f"Section at v = {outer.v_mm[row]:g} mm, to scale"
    axes = _axes((low_u, high_u), (low, high), (SECTION, height), "u (mm)")
    return _graph(title, (SECTION, height), "".join(parts), axes)


def thickness_histogram(thickness_mm: Floats) -> Html:
    """Return how many cells are how thick.

    Args:
        thickness_mm: Of the mapped cells (n,), n >= 1.
    """
    first = np.floor(thickness_mm.min() / BAR_MM) * BAR_MM
    count = max(int(np.ceil((thickness_mm.max() - first) / BAR_MM)), 1)
    edges = first + BAR_MM * np.arange(count + 1)
    shares = 100.0 * np.histogram(thickness_mm, edges)[0] / len(thickness_mm)
    top = max(float(shares.max()), 1e-9) * 1.08
    scale_x, scale_y = (HISTOGRAM - LEFT - RIGHT) / (edges[-1] - edges[0]), BARS / top
    bars = [
        f'<rect x="{LEFT + scale_x * (edge - edges[0]):.1f}" '
        f'y="{TOP + BARS - scale_y * share:.1f}" width="{scale_x * BAR_MM - 1.0:.1f}" '
        f'height="{scale_y * share:.1f}" fill="var(--band)"/>'
        for edge, share in zip(edges[:-1], shares, strict=True)
    ]
    middle = LEFT + scale_x * (float(np.median(thickness_mm)) - edges[0])
    bars.append(f'<path class="frame" stroke-dasharray="4 3" d="M{middle:.1f} {TOP:g}v{BARS:g}"/>')
    bars.append(text(middle + 4.0, TOP + 11.0, "median"))
    axes = _axes((float(edges[0]), float(edges[-1])), (0.0, top), (HISTOGRAM, BARS), "mm")
    return _graph("Thickness, share of cells (%)", (HISTOGRAM, BARS), "".join(bars), axes)


def runs(which: Bools) -> list[slice]:
    """Return the stretches of at least two places that are True, in their order."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], which.astype(np.int8), [0]))))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [slice(start, end) for start, end in pairs if end - start > 1]


def _graph(title: str, size: tuple[float, float], content: str, axes: str) -> Html:
    width, height = size
    return Html(
        f'<svg viewBox="0 0 {width:g} {TOP + height + BELOW:.1f}" role="img" '
        f'aria-label="{title}">{text(LEFT, 14.0, title, css="title")}{axes}{content}</svg>'
    )


def _axes(
    x: tuple[float, float], y: tuple[float, float], size: tuple[float, float], unit: str
) -> str:
    """Return ticks along both axes, and the unit of that along the bottom."""
    width, height = size
    bottom, parts = TOP + height, list[str]()
    for at in ticks(*x):
        place = LEFT + (width - LEFT - RIGHT) * (at - x[0]) / max(x[1] - x[0], 1e-9)
        parts.append(f'<path class="tick" d="M{place:.1f} {bottom:.1f}v4"/>')
        parts.append(text(place, bottom + 15.0, f"{at:g}", "middle"))
    for at in ticks(*y):
        place = bottom - height * (at - y[0]) / max(y[1] - y[0], 1e-9)
        parts.append(f'<path class="tick" d="M{LEFT:g} {place:.1f}H{width - RIGHT:g}"/>')
        parts.append(text(LEFT - 6.0, place + 4.0, f"{at:g}", "end"))
    parts.append(f'<path class="frame" d="M{LEFT:g} {bottom:.1f}H{width - RIGHT:g}"/>')
    parts.append(text(width - RIGHT, bottom + 29.0, unit, "end"))
    return "".join(parts)
