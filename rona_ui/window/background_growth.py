"""Background computation of the outer map that grows while the robot scans."""

import sys
import threading
import traceback
from collections.abc import Callable

from rona_core.app.steps.maps.growing_map import GrowingMap, MapGrower, Pass
from rona_core.devices.live import LiveState, RecordedSoFar
from rona_core.errors import RonaError
from rona_core.session.document import Session

PERIOD_S = 0.5  # at least, between two maps: the scan goes on in the same program
Wish = tuple[Session, Pass, int, RecordedSoFar]


class BackgroundGrowth:
    """Grows the map of the scan under way in a thread of its own, the newest wish only."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._ready = threading.Condition()
        self._asked: RecordedSoFar | None = None  # A-scans are let go when the scan has ended
        self._wish: Wish | None = None
        self._grown: tuple[str, GrowingMap] | None = None  # with the id of its session
        self._grower: tuple[tuple[str, int], MapGrower] | None = None
        self._open = True
        threading.Thread(target=self._run, name="rona-growth", daemon=True).start()

    def ask(self, session: Session, live: LiveState, which: Pass | None) -> GrowingMap | None:
        """Return the newest map, and have it brought up to date while a pass is scanned."""
        recorded = None if which is None else live.recorded
        with self._ready:
            if which is not None and recorded is not None and recorded is not self._asked:
                self._wish = session, which, live.ordinal, recorded
                self._ready.notify()
            self._asked = recorded
            grown = self._grown
        return grown[1] if grown is not None and grown[0] == session.id else None

    def close(self) -> None:
        """End the thread."""
        with self._ready:
            self._open = False
            self._ready.notify()

    def _run(self) -> None:
        while True:
            with self._ready:
                self._ready.wait_for(lambda: not self._open or self._wish is not None)
                wish, self._wish = self._wish, None
            if not self._open or wish is None:
                return
            try:
                self._grow(*wish)
            except RonaError:
                pass  # a path along a line has no map: reported when it is mapped
            except Exception:  # a defect must not end the thread
                traceback.print_exc(file=sys.stderr)
            del wish
            with self._ready:
                self._ready.wait_for(lambda: not self._open, PERIOD_S)

    def _grow(self, session: Session, which: Pass, ordinal: int, recorded: RecordedSoFar) -> None:
        key = session.id, ordinal
        if self._grower is None or self._grower[0] != key:
            self._grower = key, MapGrower(session, which, ordinal)
        grown = self._grower[1].grown(recorded)
        with self._ready:
            self._grown = session.id, grown
        self._wake()
