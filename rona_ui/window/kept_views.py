"""Kept views: how each page last looked at its session, for when it connects anew.

A page is drawn by a new `Browser` whenever it was loaded anew, or its connection was lost; the name
that it gives itself (``static/page/link.js``) stays.
"""

import threading
from dataclasses import dataclass, replace

from rona_ui.panels.implant.implant import BED_LAYERS
from rona_ui.panels.maps.maps import MAP_NAMES
from rona_ui.presentation.mouse_input import STROKES
from rona_ui.presentation.view_state import ViewState

KEPT = 8  # pages
WITH_FIELDS = MAP_NAMES | BED_LAYERS  # layers that panels have a field for, which begins anew


@dataclass(frozen=True, slots=True)
class _Held:
    client_id: int
    session_id: str
    view: ViewState


class KeptViews:
    """The last views of pages by their names, those of the latest pages only."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: dict[str, _Held] = {}

    def keep(self, page: str, client_id: int, session_id: str, view: ViewState) -> None:
        """Keep the view that a page has of a session, in place of an earlier one.

        Of an earlier connection of the page, which may not know yet that it is lost, nothing is
        kept any more; connections are numbered in the order they came.
        """
        with self._lock:
            held = self._held.get(page)
            if held is not None and held.client_id > client_id:
                return
            self._held.pop(page, None)
            self._held[page] = _Held(client_id, session_id, resumed_view(ViewState(), view))
            while len(self._held) > KEPT:
                del self._held[next(iter(self._held))]

    def of(self, page: str, session_id: str) -> ViewState | None:
        """Return the view that a page had; None if it is unknown, or last showed another session.

        Only what `resumed_view` takes of it is there.
        """
        with self._lock:
            held = self._held.get(page)
        return None if held is None or held.session_id != session_id else held.view


def resumed_view(opened: ViewState, kept: ViewState) -> ViewState:
    """Return the view that a page goes on with.

    Step, layers, cut and the strokes that are being drawn are as they were; strokes that were sent
    are not, or they would be recorded twice. Everything else has fields in the docks, which begin
    anew.

    Args:
        opened: The view that its session opens with.
        kept: The view that the page had.
    """
    view = replace(
        opened,
        step=kept.step,
        all_layers=kept.all_layers,
        hidden=(kept.hidden - WITH_FIELDS) | (opened.hidden & WITH_FIELDS),
        cut_direction=kept.cut_direction,
        cut_offset_mm=kept.cut_offset_mm,
        cut_maps=kept.cut_maps,
    )
    if kept.drawing not in STROKES:
        return view
    return replace(view, drawing=kept.drawing, picks=kept.picks, lifts=kept.lifts)
