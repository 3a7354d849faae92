"""The window on the current session: one thread reads, and draws what has changed for each browser.

Widgets send messages through ``bindings``; the session, the live slots and the jobs are read here,
put together as one immutable snapshot for each browser, and drawn by comparison with the last.
"""

import contextlib
import sys
import threading
import time
import traceback
from dataclasses import replace
from typing import Any

import viser

from rona_core.app.dependencies.judge import StepState, step_states
from rona_core.app.runtime.jobs import JobStatus
from rona_core.app.runtime.session_registry import SessionRegistry
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.comparison import MapComparison
from rona_core.app.steps.maps.growing_map import Pass
from rona_core.app.steps.surface.step import replayed_pointer
from rona_core.errors import CancelledError, NotFoundError
from rona_core.session.document import Session
from rona_ui.labels import in_words, place_of
from rona_ui.presentation.snapshot import Snapshot, replay_duration_s
from rona_ui.presentation.view_state import ViewState
from rona_ui.refusals import Refusal, Refusals
from rona_ui.viewer.bindings import TITLES, Bindings, notify
from rona_ui.viewer.theme import set_theme
from rona_ui.window.background import BackgroundFigures, BackgroundGrowth, StrokeGrowth
from rona_ui.window.browser import Browser, KeptViews

TICK_S = 1.0 / 30.0  # while something moves
PASSES: dict[str, Pass] = {"StartScan": "first", "StartTiltScan": "second"}
IDLE_S = 0.5  # while nothing does; a change wakes the thread at once


class Window:
    """Follows the current session of a hub and draws it for every browser."""

    def __init__(self, server: viser.ViserServer, hub: SessionRegistry) -> None:
        self._server, self._hub = server, hub
        self._lock = threading.Lock()
        self._browsers: dict[int, Browser] = {}
        self._kept = KeptViews()
        self._changed = threading.Event()
        self._open = True
        self._refusals = Refusals()
        self._followed: str | None = None  # id of the session
        self._subscriptions = contextlib.ExitStack()  # to it
        self._steps: tuple[Session, tuple[StepState, ...]] | None = None
        self._reported: set[str] = set()  # failed jobs that were reported
        self._last_s = time.monotonic()
        self.bindings = Bindings(hub, self._refuse)
        self._background = BackgroundFigures(self.wake)
        self._growth = BackgroundGrowth(self.wake)
        self._strokes = StrokeGrowth()
        self._unsubscribe_hub = hub.subscribe(self.wake)
        server.scene.world_axes.visible = False
        set_theme(server.gui)
        server.on_client_connect(self._enter)
        server.on_client_disconnect(self._leave)
        self._thread = threading.Thread(target=self._run, name="rona-window", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Have the window drawn soon."""
        self._changed.set()

    def close(self) -> None:
        """Stop drawing and listening; a second call does nothing."""
        self._open = False
        self._unsubscribe_hub()
        self._subscriptions.close()
        self.bindings.close()
        self._background.close()
        self._growth.close()
        self.wake()
        self._thread.join(timeout=1.0)

    # -------------------------------------------------------------- browsers come and go

    @property
    def browsers(self) -> tuple[Browser, ...]:
        """The browsers that are drawn for."""
        with self._lock:
            return tuple(self._browsers.values())

    def _enter(self, client: viser.ClientHandle) -> None:
        if not self._is_here(client):
            return
        browser = Browser(client, self._hub, self.bindings, self.wake, self._kept)
        with self._lock:
            self._browsers[client.client_id] = browser
        if not self._is_here(client):  # it left meanwhile, before it was stored
            self._leave(client)
        self.wake()

    def _is_here(self, client: viser.ClientHandle) -> bool:
        """Return whether a browser is connected; viser forgets it before it calls ``_leave``."""
        return client.client_id in self._server.get_clients()

    def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._browsers.pop(client.client_id, None)

    def _refuse(self, client: Any, title: str, body: str, explained: bool) -> None:
        """Keep what a browser was refused: the page shows it, and the log."""
        with self._lock:
            browser = self._browsers.get(getattr(client, "client_id", -1))
        where = place_of(None if browser is None else browser.view.step)
        try:
            session = self._hub.get().session
        except NotFoundError:  # no session is open: nothing is shown of it, and there is no log
            notify(client, title, body, "orange")
        else:
            refusal = Refusal(len(session.log), where, title, body, explained=explained)
            self._refusals.add(session.id, refusal)
        self._refusals.keep_only(self._hub.ids())
        self.wake()

    # -------------------------------------------------------------- the drawing thread

    def _run(self) -> None:
        quick = False
        while self._open:
            self._changed.wait(TICK_S if quick else IDLE_S)
            self._changed.clear()
            try:
                quick = self._tick()
            except NotFoundError:
                quick = False  # no session is open
            except Exception:  # a defect in drawing must not stop the window
                traceback.print_exc(file=sys.stderr)
                quick = False

    def _tick(self) -> bool:
        """Draw what has changed; return whether something moves."""
        bench = self._hub.get()
        self._follow(bench)
        browsers = self.browsers
        now_s = time.monotonic()
        elapsed_s, self._last_s = now_s - self._last_s, now_s
        job = _newest(bench)
        self._report_failure(bench, job)
        base = self._snapshot(bench, job)
        for browser in browsers:
            if browser.view.playing:
                _advance(browser, bench.session, elapsed_s)
            view = browser.view
            compared = _comparison(bench, view.comparison)
            self._draw(browser, replace(base, view=view, compared=compared))
        return base.busy or any(b.view.playing for b in browsers)

    def _draw(self, browser: Browser, snapshot: Snapshot) -> None:
        try:
            browser.draw(snapshot)
        except Exception:  # one browser that fails must not hold up the others
            traceback.print_exc(file=sys.stderr)

    def _snapshot(self, bench: Workbench, job: JobStatus | None) -> Snapshot:
        session = bench.session
        if self._steps is None or self._steps[0] is not session:
            self._steps = session, step_states(session)
        busy = job is not None and not job.finished
        facts = self._background.ask(bench, session, busy)
        live = bench.live.get()
        pointer = replayed_pointer(session, live)
        if live.origin is None and busy and facts.rig is not None:
            pointer = facts.rig.display.T_base_pointermarker()
        return Snapshot(
            session=session,
            view=ViewState(),
            steps=self._steps[1],
            live=live,
            job=job,
            left_s=None if job is None else job.time_left_s(time.monotonic()),
            static_scene=facts.static_scene,
            T_base_pointermarker=pointer,
            frame=live.frame if busy else facts.frame,
            growing=self._growth.ask(session, live, _scanned_pass(job)) if self._browsers else None,
            stroke=self._strokes.ask(session, live),
            figures=facts.figures,
            judged=facts.judged,
            computing=facts.computing,
            truth=facts.truth,
            milling=facts.milling,
            pivoting_by_hand=busy and bench.pointer_in_hand(),
            refused=self._refusals.count,
            refusals=self._refusals.of(session.id),
        )

    def _follow(self, bench: Workbench) -> None:
        """Be woken by the store and the jobs of the current session."""
        if self._followed == bench.session.id:
            return
        self._followed = bench.session.id
        self._subscriptions.close()
        self._subscriptions.callback(bench.store.subscribe(lambda old, new: self.wake()))
        self._subscriptions.callback(bench.jobs.subscribe(lambda status: self.wake()))
        self._reported = {status.id for status in bench.jobs.all() if status.finished}

    def _report_failure(self, bench: Workbench, job: JobStatus | None) -> None:
        if job is None or not job.finished or job.id in self._reported:
            return
        self._reported.add(job.id)
        if job.error is None or job.error_code == CancelledError.code:
            return
        known = job.error_code in TITLES
        title = TITLES.get(job.error_code or "", "Internal error")
        body = in_words(job.error) if known else "Defect in RONA: see the server log."
        session = bench.session
        where = place_of(None, job.activity)
        self._refusals.add(session.id, Refusal(len(session.log), where, title, body))


def _newest(bench: Workbench) -> JobStatus | None:
    """Return the job that is under way, else the one started last."""
    jobs = bench.jobs.all()
    running = [status for status in jobs if not status.finished]
    return running[-1] if running else jobs[-1] if jobs else None


def _comparison(bench: Workbench, job: str | None) -> MapComparison | None:
    """Return what a job found that compared the maps; None without one, or before its end."""
    found = next((status.result for status in bench.jobs.all() if status.id == job), None)
    return found if isinstance(found, MapComparison) else None


def _scanned_pass(job: JobStatus | None) -> Pass | None:
    """Return the pass that the robot scans now, None where it does not."""
    return None if job is None or job.finished else PASSES.get(job.activity)


def _advance(browser: Browser, session: Session, elapsed_s: float) -> None:
    """Move the replay cursor on; at the end it stops."""
    duration_s = replay_duration_s(session, browser.view)
    if duration_s is None:
        browser.change_view(lambda v: replace(v, playing=False))
        return

    def step(view: ViewState) -> ViewState:
        at = (view.replay_cursor or 0.0) + elapsed_s * view.speed / max(duration_s, 1e-9)
        return view.replayed_at(min(at, 1.0), playing=at < 1.0)

    browser.change_view(step)


def open_window(server: viser.ViserServer, hub: SessionRegistry) -> Window:
    """Show the current session of ``hub`` in every browser that comes to ``server``."""
    return Window(server, hub)
