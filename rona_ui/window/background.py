"""Background computation of what a drawing thread must not wait for."""

import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.implant.milling import MillingView
from rona_core.app.steps.implant.view import milling_view
from rona_core.app.steps.maps.comparison import MapComparison, compare_with_truth
from rona_core.app.steps.maps.growing_map import GrowingMap, MapGrower, Pass
from rona_core.app.steps.surface.step import StrokeGrower
from rona_core.devices.live import LiveState, RecordedSoFar, live_tracker_of
from rona_core.devices.samples import TrackerFrame
from rona_core.errors import RonaError
from rona_core.geometry.arrays import Floats
from rona_core.session.document import Session
from rona_ui.presentation.static_scene import StaticScene, read_static_scene, static_scene_key


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundState:
    """Results of the background thread."""

    rig: Any = None
    static_scene: StaticScene | None = None
    figures: dict[str, Any] = field(default_factory=dict)
    judged: Session | None = None  # whose figures they are
    computing: bool = False
    truth: MapComparison | None = None  # the maps beside the true bone
    frame: TrackerFrame | None = None  # what the tracker sees while nothing is under way
    milling: MillingView | None = None  # of the bed; None where there is none to mill


class BackgroundFigures:
    """Builds the devices and computes the figures in a thread of its own, the newest wish only."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._ready = threading.Condition()
        self._wish: tuple[Workbench, Session, bool] | None = None
        self._state = BackgroundState()
        self._key: object = None
        self._open = True
        threading.Thread(target=self._run, name="rona-behind", daemon=True).start()

    def ask(self, bench: Workbench, session: Session, busy: bool) -> BackgroundState:
        """Return what is known by now, and have it brought up to date."""
        with self._ready:
            seen = self._wish
            if seen is None or seen[1] is not session or seen[2] != busy:
                self._wish = bench, session, busy
                if not busy and not _same_figures(self._state.judged, session):
                    self._state = replace(self._state, computing=True)
                self._ready.notify()
            return self._state

    def close(self) -> None:
        """End the thread."""
        with self._ready:
            self._open = False
            self._ready.notify()

    def _run(self) -> None:
        done = None
        while True:
            with self._ready:
                self._ready.wait_for(lambda done=done: not self._open or self._wish is not done)
                if not self._open:
                    return
                wish = done = self._wish
            if wish is not None:
                try:
                    self._work(*wish)
                except RonaError:
                    pass  # a set-up that cannot be built is reported when a step is started
                except Exception:  # a defect must not end the thread
                    traceback.print_exc(file=sys.stderr)
                self._rest(wish)

    def _work(self, bench: Workbench, session: Session, busy: bool) -> None:
        key = session.id, *static_scene_key(session.setup)
        if key != self._key:
            self._put(figures={}, judged=None, truth=None)
            rig = bench.rig()
            self._put(rig=rig, static_scene=read_static_scene(rig, session.setup))
            self._key = key
        if not busy:
            self._put(frame=frame_now(bench))
        milling = milling_of(session)
        if milling is not self._state.milling:
            self._put(milling=milling)
        if not busy and not _same_figures(self._state.judged, session):
            self._put(figures=bench.figures(), judged=session, truth=_beside_truth(bench))

    def _rest(self, wish: tuple[Workbench, Session, bool]) -> None:
        """Say that nothing is being computed, unless something else is wanted by now."""
        with self._ready:
            if self._wish is not wish or not self._state.computing:
                return
        self._put(computing=False)

    def _put(self, **parts: Any) -> None:
        with self._ready:
            self._state = replace(self._state, **parts)
        self._wake()


def frame_now(bench: Workbench) -> TrackerFrame | None:
    """Return what the tracker sees now; None where it is not to be watched between captures."""
    try:
        live = live_tracker_of(bench.rig())
        if live is None or bench.jobs.devices_busy:
            return None
        return live.frame(bench.session.setup.devices.tracker)
    except RonaError:
        return None


def _same_figures(judged: Session | None, session: Session) -> bool:
    """Return whether the figures of ``judged`` are those of ``session``, too."""
    return judged is not None and _judged_parts(judged) == _judged_parts(session)


def _judged_parts(session: Session) -> tuple[object, ...]:
    return session.id, session.results, session.captures, session.setup


def milling_of(session: Session) -> MillingView | None:
    """Return how the bed would be milled; None without a bed of now that lies in the maps."""
    try:
        return milling_view(session)
    except RonaError:
        return None


def _beside_truth(bench: Workbench) -> MapComparison | None:
    """Return the maps beside the true bone; None without maps of now, or with real devices."""
    try:
        return compare_with_truth(bench.session, bench.map_errors())
    except RonaError:
        return None


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


class StrokeGrowth:
    """Follows the strokes of the current session, one after the other."""

    def __init__(self) -> None:
        self._grower: tuple[tuple[str, int], StrokeGrower] | None = None

    def ask(self, session: Session, live: LiveState) -> Floats | None:
        """Return the tip (k, 3) in ``base`` so far; None while no stroke is recorded."""
        if not live.frames:
            self._grower = None
            return None
        key = session.id, live.ordinal
        if self._grower is None or self._grower[0] != key:
            self._grower = key, StrokeGrower(session)
        return self._grower[1].grown(live.frames)
