"""Style of the paper's figures, and how one becomes a file: one column wide, on white, for print.

matplotlib is imported when a figure is drawn, so that no other command waits for it.
"""

import io
from collections.abc import Callable
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal, get_args

from rona_core.geometry.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Format = Literal["svg", "png"]
FORMATS: tuple[Format, ...] = get_args(Format)
MEDIA: dict[Format, str] = {"svg": "image/svg+xml", "png": "image/png"}
COLUMN_MM, MM_PER_INCH = 85.0, 25.4
DOTS_PER_INCH = 600  # of the PNG, and of what is an image within the SVG
INK, SOFT, PALE = "#1b2530", "#5a6774", "#d8dee5"
FLAT = 0.2  # share of its width up to which a box is too flat for several ticks along z
RIM_MM = 1.0  # around what is seen in space
RULES: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same on every machine
    "font.size": 6.5,
    "axes.titlesize": 6.5,
    "axes.titlelocation": "left",
    "axes.titlepad": 3.0,
    "axes.labelsize": 6.5,
    "axes.labelpad": 2.0,
    "axes.linewidth": 0.5,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.unicode_minus": True,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 6.0,
    "ytick.labelsize": 6.0,
    "xtick.major.width": 0.5,
    "ytick.major.width": 0.5,
    "xtick.major.size": 2.0,
    "ytick.major.size": 2.0,
    "xtick.major.pad": 2.0,
    "ytick.major.pad": 2.0,
    "lines.linewidth": 0.8,
    "grid.color": PALE,
    "grid.linewidth": 0.4,
    "legend.fontsize": 6.0,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.columnspacing": 1.2,
    "legend.handletextpad": 0.5,
    "legend.borderaxespad": 0.2,
    "figure.constrained_layout.use": True,
    "figure.constrained_layout.w_pad": 0.02,
    "figure.constrained_layout.h_pad": 0.02,
    "svg.fonttype": "none",  # words stay words
    "svg.hashsalt": "rona",  # the same figure gives the same bytes
}
_ONE_AT_A_TIME = Lock()  # the settings of matplotlib are global


def figure_file(draw: Callable[["Figure"], None], height_mm: float, form: Format) -> bytes:
    """Return a figure, one column wide, as a file.

    Args:
        draw: Draws it on an empty page.
        height_mm: Of the page.
        form: SVG, or PNG of 600 dots per inch.
    """
    import matplotlib
    from matplotlib.figure import Figure

    size = COLUMN_MM / MM_PER_INCH, height_mm / MM_PER_INCH
    undated = {"Date": None, "Creator": None} if form == "svg" else {"Software": None}
    file = io.BytesIO()
    with _ONE_AT_A_TIME, matplotlib.rc_context():
        matplotlib.rcdefaults()  # whatever settings of their own users keep
        matplotlib.rcParams.update(RULES)
        figure = Figure(figsize=size, dpi=DOTS_PER_INCH, facecolor="white")
        draw(figure)
        figure.savefig(file, format=form, metadata=undated)
    return file.getvalue()


def halves(figure: "Figure", ratio: float = 1.0) -> tuple[Any, Any]:
    """Return the upper and the lower part of a page, the lower one ``ratio`` times as high."""
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.0, ratio))
    return parts[0], parts[1]


def plane(axes: "Axes", x: str, y: str) -> None:
    """Label the axes of a plane, and draw both to one scale."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.set_aspect("equal", adjustable="box")


def space(
    figure: Any,
    points: Floats,
    frame: str,
    azimuth_deg: float,
    elevation_deg: float = 40.0,
    zoom: float = 1.0,
) -> Any:
    """Return axes in space to one scale, from outside of the bone.

    Args:
        figure: That they fill.
        points: All that is to be seen (n, 3), in mm.
        frame: That they are in.
        azimuth_deg: From where it is looked at, about z from x to y.
        elevation_deg: And over the plane of x and y.
        zoom: More of it fills a page that is wider than high.
    """
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    axes.set_proj_type("ortho")
    axes.view_init(elevation_deg, azimuth_deg)
    low, high = points.min(axis=0) - RIM_MM, points.max(axis=0) + RIM_MM
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(tuple(high - low), zoom=zoom)
    axes.set_xlabel(f"x of {frame} (mm)", labelpad=-7.0)
    axes.set_ylabel(f"y of {frame} (mm)", labelpad=-7.0)
    axes.set_zlabel(f"z of {frame} (mm)", labelpad=-11.0)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis.set_tick_params(pad=-4.5)
    axes.locator_params(nbins=5, integer=True)
    flat = high[2] - low[2] < FLAT * max(high - low)
    axes.locator_params("z", nbins=1 if flat else 3, min_n_ticks=1 if flat else 2, integer=True)
    return axes


def colour_scale(figure: "Figure", drawn: Any, label: str, axes: Any, **where: Any) -> None:
    """Add the scale of the colours of something drawn beside some axes."""
    bar = figure.colorbar(drawn, ax=axes, label=label, **where)
    bar.outline.set_linewidth(0.5)


def open_frame(axes: "Axes") -> None:
    """Leave out the lines of the frame that carry no ticks."""
    axes.spines[["top", "right"]].set_visible(False)
