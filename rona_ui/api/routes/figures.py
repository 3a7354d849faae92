"""The paper's figures over REST, and the page *Figures* that shows them."""

from collections.abc import Callable, Coroutine
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response
from fastapi.responses import HTMLResponse

from rona_core.app.paper_figures.style import COLUMN_MM, MEDIA, Format
from rona_core.app.paper_figures.table import (
    PAPER_FIGURES,
    PaperFigure,
    drawn_figure,
    figure_named,
    lacking,
)
from rona_core.app.report.page import Html, markup, note, tag, whole_page
from rona_core.session.document import Session
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench, origin_of

POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src 'self'; base-uri 'none'; "
    "form-action 'none'"
)
FILE: dict[int | str, dict[str, Any]] = {
    200: {"content": {kind: {} for kind in MEDIA.values()}, "description": "The figure"}
}
FigureName = Annotated[
    str,
    Path(
        description="; ".join(
            f"`{one.name}`: Figure {one.number}, {one.title}" for one in PAPER_FIGURES.values()
        ),
        json_schema_extra={"enum": list(PAPER_FIGURES)},
    ),
]
Form = Annotated[Format, Query(alias="format", description="PNG has 600 dots per inch")]


class OneAtATime(BodyRoute):
    """A route whose answers are made one after the other: those that wait keep no other waiting."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return what answers a request."""
        handle = super().get_route_handler()

        async def answer(request: Request) -> Response:
            async with request.app.state.drawing:
                if await request.is_disconnected():  # the page was closed meanwhile
                    return Response(status_code=204)
                return await handle(request)

        return answer


router = APIRouter(route_class=OneAtATime, tags=["results"])


@router.get("/sessions/{session_id}/figures", response_class=HTMLResponse)
def get_figures(bench: Bench) -> HTMLResponse:
    """Return a page (HTML) with the paper's figures, drawn from the session, to save each.

    In the place of a figure that cannot be drawn stands the step that it needs.
    """
    headers = {"Content-Security-Policy": f"{POLICY}; frame-ancestors 'none'"}
    return HTMLResponse(figures_page(bench.session, origin_of(bench)), headers=headers)


@router.get("/sessions/{session_id}/figures/{name}", response_class=Response, responses=FILE)
def get_figure(bench: Bench, name: FigureName, form: Form = "svg") -> Response:
    """Download one of the paper's figures, drawn from the session: one column (85 mm) wide.

    It holds what the session measured and computed, and no ground truth. Refused while what it
    needs is missing or stale. The same session gives the same bytes.
    """
    data = drawn_figure(bench.session, name, form)
    headers = {
        "Content-Disposition": f'inline; filename="{figure_named(name).file_name(form)}"',
        "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:",
    }
    return Response(data, media_type=MEDIA[form], headers=headers)


def figures_page(session: Session, origin: str | None) -> str:
    """Return the page *Figures*; it loads each figure from beside its own address."""
    devices = "" if origin is None else f" Devices: {origin.lower()}."
    words = f"What the session measured and computed, without ground truth.{devices}"
    return whole_page(
        f"{session.name}: figures",
        tag("header", tag("div", "RONA figures", css="kind"), tag("h1", session.name)),
        tag("p", words, css="soft"),
        tag("div", *(_section(one, session) for one in PAPER_FIGURES.values()), css="halves"),
        policy=POLICY,
    )


def _section(figure: PaperFigure, session: Session) -> Html:
    title = tag("h2", f"Figure {figure.number}: {figure.title}")
    reason = lacking(figure, session)
    if reason is not None:
        return tag("section", title, note(f"{reason}.", "warn"))
    words = markup(f"{figure.title}. {figure.says}")
    image = Html(
        f'<img src="figures/{figure.name}" alt="{words}" loading="lazy" '
        f'style="width:100%;aspect-ratio:{COLUMN_MM:g}/{figure.height_mm:g}">'
    )
    links = (
        Html(
            f' <a href="figures/{figure.name}?format={form}" '
            f'download="{figure.file_name(form)}">{form.upper()}</a>'
        )
        for form in MEDIA
    )
    caption = tag("figcaption", figure.says, *links)
    return tag("section", title, tag("figure", image, caption))
