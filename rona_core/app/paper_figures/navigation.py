"""Figure 4 of the paper: the registrations between robot, tool, tracker, pointer and scan path."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from rona_core.app.overview.frame_graph import FrameRow, frame_rows
from rona_core.app.paper_figures.style import INK, SOFT
from rona_core.mapping.colors import BLUE, GREEN, VERMILLION, css
from rona_core.session.document import Session

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Kind = Literal["calibrated", "measured", "kinematics", "nominal", "contact", "open"]
WIDTH_MM, HEIGHT_MM = 85.0, 84.0
BOXES: dict[str, tuple[float, float, str]] = {  # frame: centre in mm on the page, name in the paper
    "tracker": (44.5, 79.0, "OTS"),
    "basemarker": (11.0, 60.0, ""),
    "toolmarker": (44.5, 58.0, "TM"),
    "pointermarker": (69.0, 58.0, "PM"),
    "flange": (27.0, 37.0, ""),
    "tip": (51.0, 37.0, "M"),
    "pointertip": (69.0, 31.0, "PT"),
    "probe": (27.0, 16.0, "M, US"),
    "burr": (51.0, 20.0, ""),
    "base": (8.0, 16.0, ""),
    "scan path": (69.0, 11.0, "K"),
}
EDGES: tuple[tuple[str, str, Kind], ...] = (  # and what they are where the session has no row
    ("tracker", "basemarker", "measured"),
    ("tracker", "toolmarker", "measured"),
    ("tracker", "pointermarker", "measured"),
    ("base", "tracker", "open"),
    ("base", "basemarker", "open"),
    ("base", "flange", "kinematics"),
    ("flange", "toolmarker", "open"),
    ("flange", "tip", "open"),
    ("flange", "probe", "open"),
    ("toolmarker", "tip", "open"),
    ("tip", "burr", "open"),
    ("pointermarker", "pointertip", "open"),
    ("pointertip", "scan path", "contact"),
    ("probe", "scan path", "contact"),
)
WITHOUT_TURN = ("pointertip", "burr")  # tips: a translation is all that is found
LOOKS: dict[Kind, tuple[str, dict[str, Any]]] = {
    "calibrated": ("calibrated, with 1 σ", {"color": INK, "linewidth": 1.2}),
    "measured": ("measured by the tracker", {"color": css(BLUE), "linewidth": 0.8}),
    "kinematics": ("robot kinematics", {"color": css(GREEN), "linewidth": 0.8}),
    "nominal": ("nominal", {"color": SOFT, "linewidth": 0.8}),
    "contact": ("contact", {"color": INK, "linewidth": 0.8, "linestyle": (0, (1, 1.5))}),
    "open": (
        "missing or stale",
        {"color": css(VERMILLION), "linewidth": 0.8, "linestyle": (0, (4, 2))},
    ),
}
BOX_MM, CHAR_MM = 5.0, 1.25  # height of a box; width of a letter


@dataclass(frozen=True, slots=True)
class Edge:
    """A transformation as it is drawn: between which frames, how it is known, and what of it."""

    parent: str
    child: str
    kind: Kind
    words: str


def draw_registrations(session: Session, figure: "Figure") -> None:
    """Draw the frames, the transformations between them, and how well each is known."""
    from matplotlib.lines import Line2D

    figure.set_layout_engine("none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, WIDTH_MM), ylim=(0.0, HEIGHT_MM))
    axes.set_axis_off()
    boxes = {name: _box(axes, name) for name in BOXES}
    edges = edges_of(session)
    for edge in edges:
        _arrow(axes, edge, boxes)
    kinds: list[Kind] = [kind for kind in LOOKS if any(edge.kind == kind for edge in edges)]
    lines = [Line2D([], [], **LOOKS[kind][1]) for kind in kinds]
    axes.legend(lines, [LOOKS[kind][0] for kind in kinds], loc="lower center", ncols=3)


def edges_of(session: Session) -> tuple[Edge, ...]:
    """Return the transformations of the paper's figure as the session knows them."""
    rows = {(row.parent, row.child): row for row in frame_rows(session)}
    return tuple(_edge(*edge, rows.get(edge[:2])) for edge in EDGES)


def _edge(parent: str, child: str, kind: Kind, row: FrameRow | None) -> Edge:
    what = "" if kind == "contact" else "T" if child in WITHOUT_TURN else "R, T"
    if row is None:
        return Edge(parent, child, kind, what)
    if row.stale_reason is not None:
        return Edge(parent, child, "open", f"{what}\nstale")
    if row.source == "robot":
        return Edge(parent, child, "nominal", what)
    sigmas = "" if row.sigma_mm is None else f"\n{row.sigma_mm:.2f} mm"
    sigmas += "" if row.sigma_deg is None else f"\n{row.sigma_deg:.2f}°"
    return Edge(parent, child, "calibrated", what + sigmas)


def _box(axes: "Axes", name: str) -> Any:
    """Draw a frame, and return its outline."""
    from matplotlib.patches import FancyBboxPatch

    x, y, paper = BOXES[name]
    words = f"{name} ({paper})" if paper else name
    width = CHAR_MM * len(words) + 2.0
    corner, style = (x - width / 2.0, y - BOX_MM / 2.0), "round,pad=0,rounding_size=1"
    outline = FancyBboxPatch(corner, width, BOX_MM, style, facecolor="#f1f4f7", edgecolor=SOFT)
    outline.set_linewidth(0.6)
    axes.add_patch(outline)
    axes.text(x, y, words, ha="center", va="center", fontsize=6.0)
    return outline


def _arrow(axes: "Axes", edge: Edge, boxes: dict[str, Any]) -> None:
    """Draw a transformation from a frame to another, and what is known of it in its middle."""
    from matplotlib.patches import FancyArrowPatch

    (x1, y1, _), (x2, y2, _) = BOXES[edge.parent], BOXES[edge.child]
    look = LOOKS[edge.kind][1]
    head = "-" if edge.kind == "contact" else "-|>"
    ends = {"patchA": boxes[edge.parent], "patchB": boxes[edge.child], "shrinkA": 0, "shrinkB": 0}
    arrow = FancyArrowPatch((x1, y1), (x2, y2), arrowstyle=head, mutation_scale=6.0, **ends, **look)
    axes.add_patch(arrow)
    paper: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
    place: dict[str, Any] = {"ha": "center", "va": "center", "bbox": paper}
    axes.text((x1 + x2) / 2.0, (y1 + y2) / 2.0, edge.words, fontsize=5.5, linespacing=1.0, **place)
