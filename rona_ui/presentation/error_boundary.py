"""Error boundary: a panel or layer that cannot be drawn holds up no other."""

import sys
import traceback
from typing import Protocol

from rona_ui.presentation.snapshot import Snapshot


class Drawable(Protocol):
    """A panel of the docks or a layer of the scene."""

    def render(self, old: Snapshot | None, new: Snapshot) -> None:
        """Bring it from ``old`` to ``new``; ``old`` is None for the first time."""
        ...


class ErrorBoundary:
    """Draws panels and layers one by one; after a failure one is drawn from nothing again."""

    def __init__(self) -> None:
        self._failed: dict[Drawable, str] = {}

    @property
    def errors(self) -> tuple[str, ...]:
        """Errors of the panels and layers that are not up to date, each once."""
        return tuple(dict.fromkeys(self._failed.values()))

    def draw(self, part: Drawable, old: Snapshot | None, new: Snapshot) -> None:
        """Draw one; a failure is kept in ``errors``, and written to the program's log once."""
        try:
            part.render(None if part in self._failed else old, new)
        except Exception as error:  # a defect in one part must not stop the page
            words = f"{type(error).__name__}: {error}"
            if self._failed.get(part) != words:
                traceback.print_exc(file=sys.stderr)
            self._failed[part] = words
        else:
            self._failed.pop(part, None)
