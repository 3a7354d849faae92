"""Sections of the report about what step 9 made: maps, and how sure they are."""

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.report.page import Html, joined, markup, note, table, tag, tile
from rona_core.app.steps.acoustics.view import loss_words, speed_words
from rona_core.app.steps.maps.error_budget import error_budgets
from rona_core.app.steps.maps.export import map_sheet
from rona_core.app.steps.maps.inputs import map_accuracy
from rona_core.app.steps.maps.view import ROUND_MM, ROUND_SIGMA_MM, scale_limits_mm
from rona_core.app.steps.scan.step import probe_advice
from rona_core.geometry.arrays import Bools, Floats
from rona_core.mapping.accuracy.map_accuracy import accuracy_words
from rona_core.mapping.boundary_map import BoundaryMap
from rona_core.mapping.colors import viridis
from rona_core.mapping.files.map_sheet import MapSheet, cell_sizes_mm
from rona_core.session.document import Session

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


GRAPH_LEFT, GRAPH_RIGHT, GRAPH_TOP, GRAPH_BELOW = 38.0, 8.0, 24.0, 34.0
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
    scale = (SECTION - GRAPH_LEFT - GRAPH_RIGHT) / max(high_u - low_u, 1e-9)
    height = scale * (high - low)

    def xy(at_u: Floats, z: Floats) -> str:
        x, y = GRAPH_LEFT + scale * (at_u - low_u), GRAPH_TOP + scale * (high - z)
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
    scale_x, scale_y = (HISTOGRAM - GRAPH_LEFT - GRAPH_RIGHT) / (edges[-1] - edges[0]), BARS / top
    bars = [
        f'<rect x="{GRAPH_LEFT + scale_x * (edge - edges[0]):.1f}" '
        f'y="{GRAPH_TOP + BARS - scale_y * share:.1f}" width="{scale_x * BAR_MM - 1.0:.1f}" '
        f'height="{scale_y * share:.1f}" fill="var(--band)"/>'
        for edge, share in zip(edges[:-1], shares, strict=True)
    ]
    middle = GRAPH_LEFT + scale_x * (float(np.median(thickness_mm)) - edges[0])
    bars.append(
        f'<path class="frame" stroke-dasharray="4 3" d="M{middle:.1f} {GRAPH_TOP:g}v{BARS:g}"/>'
    )
    bars.append(text(middle + 4.0, GRAPH_TOP + 11.0, "median"))
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
        f'<svg viewBox="0 0 {width:g} {GRAPH_TOP + height + GRAPH_BELOW:.1f}" role="img" '
        f'aria-label="{title}">{text(GRAPH_LEFT, 14.0, title, css="title")}{axes}{content}</svg>'
    )


def _axes(
    x: tuple[float, float], y: tuple[float, float], size: tuple[float, float], unit: str
) -> str:
    """Return ticks along both axes, and the unit of that along the bottom."""
    width, height = size
    bottom, parts = GRAPH_TOP + height, list[str]()
    for at in ticks(*x):
        place = GRAPH_LEFT + (width - GRAPH_LEFT - GRAPH_RIGHT) * (at - x[0]) / max(
            x[1] - x[0], 1e-9
        )
        parts.append(f'<path class="tick" d="M{place:.1f} {bottom:.1f}v4"/>')
        parts.append(text(place, bottom + 15.0, f"{at:g}", "middle"))
    for at in ticks(*y):
        place = bottom - height * (at - y[0]) / max(y[1] - y[0], 1e-9)
        parts.append(
            f'<path class="tick" d="M{GRAPH_LEFT:g} {place:.1f}H{width - GRAPH_RIGHT:g}"/>'
        )
        parts.append(text(GRAPH_LEFT - 6.0, place + 4.0, f"{at:g}", "end"))
    parts.append(f'<path class="frame" d="M{GRAPH_LEFT:g} {bottom:.1f}H{width - GRAPH_RIGHT:g}"/>')
    parts.append(text(width - GRAPH_RIGHT, bottom + 29.0, unit, "end"))
    return "".join(parts)


MM2_PER_CM2 = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class MapFacts:
    """What the maps come to in a few figures; ``thickness_mm`` are those of the cells (n,)."""

    sheet: MapSheet
    thickness_mm: Floats
    thickness_sigma_mm: float | None  # RMS; None where it is not known
    outer_cm2: float


def map_facts(session: Session) -> MapFacts | None:
    """Return the figures of the robot's maps; None where there are none, or stale ones."""
    if session.results.maps is None or stale_reason("maps", session) is not None:
        return None
    sheet = map_sheet(session)
    ok, outer_ok = sheet.thickness_ok(), sheet.maps.outer.ok
    sigma = sheet.sigma_mm("thickness")["total"]
    known = sigma[np.isfinite(sigma)]
    du, dv = cell_sizes_mm(sheet.maps.outer)
    return MapFacts(
        sheet=sheet,
        thickness_mm=sheet.thickness_mm()[ok],
        thickness_sigma_mm=float(np.sqrt(np.mean(known**2))) if known.size else None,
        outer_cm2=float(outer_ok.sum()) * du * dv / MM2_PER_CM2,
    )


def map_tiles(session: Session, found: MapFacts | None) -> tuple[Html, ...]:
    """Return thickness and area in large letters."""
    if found is None:
        why = "no map" if session.results.maps is None else "stale, left out"
        return (tile("Bone thickness", "–", why), tile("Mapped area", "–", why))
    thick = tile("Bone thickness, median", "–", "no inner boundary")
    if len(found.thickness_mm):
        low, middle, high = np.percentile(found.thickness_mm, (10.0, 50.0, 90.0))
        sigma = found.thickness_sigma_mm
        words = f"10 to 90 %: {low:.1f} to {high:.1f} mm"
        words += "" if sigma is None else f"; expected error {sigma:.2f} mm (1 σ)"
        thick = tile("Bone thickness, median", f"{middle:.1f} mm", words)
    share = f"inner boundary in {100.0 * found.sheet.maps.inner_share:.0f} % of it"
    return (thick, tile("Mapped area", f"{found.outer_cm2:.1f} cm²", share))


def maps_section(session: Session, found: MapFacts | None) -> Html:
    """Return the maps as pictures, a section and the thickness."""
    title = tag("h2", "Maps")
    if found is None:
        return joined((title, _why_none(session)))
    sheet = found.sheet
    outer = sheet.boundary("outer")
    heights = np.where(outer.ok, outer.height_mm, np.nan)
    pictures = (
        ("Bone thickness", sheet.thickness_mm(), ROUND_MM, 1),
        ("Outer boundary, height", heights, ROUND_MM, 1),
        ("Expected thickness error, 1 σ", sheet.sigma_mm("thickness")["total"], ROUND_SIGMA_MM, 2),
    )
    drawn = tag(
        "div",
        *(_picture(title, sheet, values, step, digits) for title, values, step, digits in pictures),
        css="maps",
    )
    graphs: list[Html] = []
    if len(found.thickness_mm):
        words = "Outer and inner boundary with ± 2 σ; bone between them."
        graphs.append(tag("figure", section_graph(sheet), tag("figcaption", words)))
        words = f"{len(found.thickness_mm)} cells with both boundaries."
        histogram = thickness_histogram(found.thickness_mm)
        graphs.append(tag("figure", histogram, tag("figcaption", words)))
    frame = "Frame of the map: u to the right, v upwards, z out of the bone; blank: not mapped."
    return joined((title, drawn, tag("p", frame, css="soft"), tag("div", *graphs, css="two")))


def _picture(title: str, sheet: MapSheet, values: Floats, step: float, digits: int) -> Html:
    known = values[np.isfinite(values)]
    if not known.size:
        return tag("figure", note(f"{title}: not known."))
    limits = scale_limits_mm(known, step)
    words = f"{known.min():.{digits}f} to {known.max():.{digits}f} mm, mean {known.mean():.2f} mm."
    drawn = map_picture(f"{title} (mm)", sheet.boundary("outer"), values, limits, digits)
    return tag("figure", drawn, tag("figcaption", words))


def _why_none(session: Session) -> Html:
    reason = None if session.results.maps is None else stale_reason("maps", session)
    by_hand = session.results.sono_maps is not None
    words = "Not mapped yet (step 9)." if reason is None else f"Stale, left out: {reason}."
    if by_hand:
        words += " Maps of the scan by hand are not part of the report."
    return note(words, "warn")


def accuracy_section(
    session: Session, found: MapFacts | None, figures: Mapping[str, Any], with_truth: bool
) -> Html:
    """Return what the maps are expected to err by, and by what."""
    accuracy = None if found is None else map_accuracy(session)
    if found is None or accuracy is None:
        return Html("")
    detection, speed = session.results.detection, speed_words(session)
    lines = [accuracy_words(found.sheet.maps, accuracy)]
    lines += ["Speed of sound: " + (speed or "published mean.")]
    lines += [] if detection is None else [loss_words(detection.value)]
    advice, judged = probe_advice(session), judge_part("maps", session)
    lines += [] if advice is None else [advice.sentence]
    lines += [f"{judged.beside('Maps')} Next: {judged.remedy.words}."] if judged.remedy else []
    budgets: list[Html] = []
    for budget in error_budgets(accuracy, figures):
        rows = [
            [line.title, f"{line.predicted_mm:.3f}"] + ([_mm(line.true_mm)] if with_truth else [])
            for line in budget.lines
        ]
        head = [budget.name, "σ (mm)", *(["true, RMS"] if with_truth else [])]
        words = f"Largest: {budget.largest}." if budget.largest else ""
        words += f" To lower it: {budget.remedy}." if budget.remedy else ""
        drawn = table(head, rows, ("", "n", "n")[: len(head)])
        budgets.append(tag("div", drawn, tag("p", words, css="soft")))
    return joined(
        (
            tag("h2", "Accuracy of the maps"),
            *(tag("p", line) for line in lines if line),
            tag("h3", "Error budget"),
            tag("div", *budgets, css="halves"),
        )
    )


def _mm(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}"
