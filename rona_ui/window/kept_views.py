"""Kept views: how each page last looked at its session, for when it connects anew.

A page is drawn by a new `Browser` whenever it was loaded anew, or its connection was lost; the name
that it gives itself (``static/page/link.js``) stays.
"""

import threading

from rona_ui.presentation.view_state import ViewState

KEPT = 8  # pages; a view may hold maps that its session has no longer


class KeptViews:
    """The last views of pages by their names, those of the latest pages only."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._held: dict[str, tuple[str, ViewState]] = {}

    def keep(self, page: str, session_id: str, view: ViewState) -> None:
        """Keep the view that a page has of a session, in place of an earlier one."""
        with self._lock:
            self._held.pop(page, None)
            self._held[page] = session_id, view
            while len(self._held) > KEPT:
                del self._held[next(iter(self._held))]

    def of(self, page: str, session_id: str) -> ViewState | None:
        """Return the view that a page had of a session; None where it last had another one."""
        with self._lock:
            held = self._held.get(page)
        return None if held is None or held[0] != session_id else held[1]
