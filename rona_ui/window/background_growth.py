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
        self._wish: Wish | None = None
        self._grown: GrowingMap | None = None
        self._open = True
        threading.Thread(target=self._run, name="rona-growth", daemon=True).start()

    def ask(self, session: Session, live: LiveState, which: Pass | None) -> GrowingMap | None:
        """Return the newest map, and have it brought up to date while a pass is scanned."""
        with self._ready:
            wish, recorded = self._wish, live.recorded
            if which is not None and recorded is not None:
                if wish is None or wish[3] is not recorded:
                    wish = self._wish = session, which, live.ordinal, recorded
                    self._ready.notify()
            return self._grown if wish is not None and wish[0].id == session.id else None

    def close(self) -> None:
        """End the thread."""
        with self._ready:
            self._open = False
            self._ready.notify()

    def _run(self) -> None:
        done: Wish | None = None
        grower: MapGrower | None = None
        key: object = None
        while True:
            with self._ready:
                self._ready.wait_for(lambda done=done: not self._open or self._wish is not done)
                wish = done = self._wish
                if not self._open or wish is None:
                    return
            session, which, ordinal, recorded = wish
            try:
                if grower is None or key != (session.id, ordinal):
                    grower, key = MapGrower(session, which, ordinal), (session.id, ordinal)
                grown = grower.grown(recorded)
            except RonaError:
                continue  # a path along a line has no map: whoever maps it is told
            except Exception:  # a defect must not end the thread
                traceback.print_exc(file=sys.stderr)
                continue
            with self._ready:
                self._grown = grown
            self._wake()
            with self._ready:
                self._ready.wait_for(lambda: not self._open, PERIOD_S)
