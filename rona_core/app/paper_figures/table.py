"""The paper's figures, drawn from a session: each declared once, in the order of the paper.

Command line, REST, page and ``docs/how-to/paper_figures.md`` follow the table. A figure is made of
what the session measured and computed; none of them knows the ground truth.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rona_core.app.dependencies.judge import judge_part
from rona_core.app.dependencies.staleness import wanted_of
from rona_core.app.paper_figures.maps import draw_milling_path, draw_reconstruction
from rona_core.app.paper_figures.navigation import draw_registrations
from rona_core.app.paper_figures.path import (
    draw_joints,
    draw_orientations,
    draw_smoothed_path,
    draw_steps_of_smoothing,
)
from rona_core.app.paper_figures.style import Format, figure_file
from rona_core.errors import NotFoundError, RonaError, StepBlockedError
from rona_core.session.document import Session
from rona_core.session.memo import Memo

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True)
class Need:
    """A result that a figure is drawn from."""

    result: str
    words: str
    takes_bad: bool = False  # one that nothing else uses can be drawn


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """One figure: its name and number, what it shows and needs, and what draws it."""

    name: str
    number: int  # in the paper
    title: str
    says: str  # its caption
    needs: tuple[Need, ...]
    height_mm: float
    draw: Callable[[Session, "Figure"], None]

    def file_name(self, form: Format) -> str:
        """Return what its file is called."""
        return f"figure_{self.number:02d}_{self.name}.{form}"


PATH = Need("smoothing", "the smoothed path")
CLOUD = Need("surface", "the surface cloud")
ROLL = Need("roll", "the roll search", takes_bad=True)
PAPER_FIGURES: dict[str, PaperFigure] = {
    figure.name: figure
    for figure in (
        PaperFigure(
            "milling_path",
            2,
            "Implant and milling path",
            "The implant over a grid of 5 mm, and the layered concentric path that mills its bed, "
            "coloured by depth. Moves in the air are left out.",
            (Need("bed", "the implant bed"),),
            100.0,
            draw_milling_path,
        ),
        PaperFigure(
            "registrations",
            4,
            "Registrations",
            "Frames of robot, tool, tracker, pointer and scan path; R: rotation, T: translation. "
            "The error beside a calibrated transformation is the predicted one, that of the "
            "tracker at the skull.",
            (Need("tool", "the registration of tool and tracker", takes_bad=True),),
            84.0,
            draw_registrations,
        ),
        PaperFigure(
            "steps_of_smoothing",
            5,
            "Smoothing, step by step",
            "Nine points of the demonstrated path, where it bends most. Each step removes the "
            "point whose removal leads to the smallest deviation from P, which stands above it. "
            "Framed: the last path within the tolerance.",
            (PATH,),
            70.0,
            draw_steps_of_smoothing,
        ),
        PaperFigure(
            "smoothed_path",
            6,
            "Original and smoothed scan path",
            "Both in the tangent plane of the path. The tolerance dₛ holds behind the filter that "
            "takes out tremor; so far off is the path as demonstrated.",
            (PATH,),
            56.0,
            draw_smoothed_path,
        ),
        PaperFigure(
            "orientations",
            7,
            "Scan path and orientations",
            "Places touched with the pointer, and the probe every 5 mm along the path with the "
            "chosen roll ν.",
            (CLOUD, PATH, ROLL),
            72.0,
            draw_orientations,
        ),
        PaperFigure(
            "joints",
            8,
            "Joint angles along the path",
            "The six joints as share of their range with the chosen roll, and with the nearest "
            "roll on either side that the joints rule out (10° away where there is none).",
            (ROLL,),
            98.0,
            draw_joints,
        ),
        PaperFigure(
            "reconstruction",
            10,
            "3D reconstruction",
            "Outer and inner boundary of the bone in the frame of the maps, and a section of the "
            "echo volume: 0 dB is the front echo of flat bone in perfect contact.",
            (Need("maps", "the maps", takes_bad=True),),
            92.0,
            draw_reconstruction,
        ),
    )
}
_DRAWN: Memo[bytes] = Memo(2 * len(PAPER_FIGURES))  # a page is loaded again, a figure saved


def figure_named(name: str) -> PaperFigure:
    """Return a figure of the table.

    Raises:
        NotFoundError: there is none of that name.
    """
    if name not in PAPER_FIGURES:
        raise NotFoundError(f"there is no figure {name!r}: {', '.join(PAPER_FIGURES)}")
    return PAPER_FIGURES[name]


def lacking(figure: PaperFigure, session: Session) -> str | None:
    """Return what a figure needs that the session lacks, and the step that makes it; else None."""
    for need in figure.needs:
        found = judge_part(need.result, session)
        if found.holds or (found.state == "bad" and need.takes_bad):
            continue
        needs = f"Figure {figure.number} needs {need.words}"
        if found.state in ("missing", "blocked"):
            return f"{needs}: {wanted_of(need.result)}"
        remedy = "" if found.remedy is None else f": {found.remedy.words}"
        return f"{needs} ({found.reason}){remedy}"
    return None


def drawn_figure(session: Session, name: str, form: Format) -> bytes:
    """Return a figure of a session as a file; the same session gives the same bytes.

    Args:
        session: That it is drawn from.
        name: One of ``PAPER_FIGURES``.
        form: SVG, or PNG of 600 dots per inch; one column (85 mm) wide.

    Raises:
        NotFoundError: there is no such figure.
        StepBlockedError: the session lacks what it needs, or has it stale; the message names the
            step that makes it.
    """
    figure = figure_named(name)
    return _DRAWN.get((session,), lambda: _drawn(session, figure, form), (name, form))


def _drawn(session: Session, figure: PaperFigure, form: Format) -> bytes:
    reason = lacking(figure, session)
    if reason is not None:
        raise StepBlockedError(reason)
    try:
        return figure_file(partial(figure.draw, session), figure.height_mm, form)
    except RonaError as error:
        raise StepBlockedError(f"Figure {figure.number} cannot be drawn: {error}") from error
