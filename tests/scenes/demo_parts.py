"""The demo session as it was on the way: steps that need not be carried out once more."""

from dataclasses import fields, replace
from functools import cache
from typing import Any

from rona_core import compose
from rona_core.app.runtime import workbench
from rona_core.app.steps.acoustics.messages import CalibrateDelayLine, StartDelayLineCapture
from rona_core.app.steps.handheld.messages import (
    StartHandheldCalibration,
    StartHandheldMapping,
    StartHandheldScan,
)
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.scan.messages import StartQuickLook
from rona_core.compose import build_virtual_rig, evaluate_virtual, new_workbench
from rona_core.session.document import Captures, Results, Session
from rona_core.session.files import load_session
from rona_core.session.memo import Memo
from rona_ui.resources import demo_session

FIGURES: Memo[dict[str, Any]] = Memo(24)
PARTS = [f.name for f in fields(Session) if f.name not in ("id", "name", "created_utc", "log")]


@cache
def demo() -> Session:
    """Return the demo session; it is loaded once, and nothing can change it.

    What was computed from it is kept when a workbench is closed: other tests ask for it again. So
    are figures: those of the same set-up, captures and results are computed once.
    """
    workbench.forget_all = lambda: None
    compose.evaluate_virtual = evaluated_once
    return load_session(demo_session())


def evaluated_once(session: Session, rig: Any) -> dict[str, Any]:
    """Return the figures of a session and its own rig, in place of ``compose.evaluate_virtual``."""
    parts = tuple(getattr(session, name) for name in PARTS)
    return dict(FIGURES.get(parts, lambda: evaluate_virtual(session, rig)))


@cache
def figures() -> dict[str, Any]:
    """Return the figures of the demo session, with those that need the truth."""
    return evaluated_once(demo(), build_virtual_rig(demo().setup))


@cache
def registered() -> Session:
    """Return the demo session as it was after step 3: tool and pointer calibrated."""
    session = demo()
    captures = Captures(tool=session.captures.tool, pointer=session.captures.pointer)
    results = Results(tool=session.results.tool, pointer=session.results.pointer)
    return replace(session, captures=captures, results=results, archive=())


@cache
def without_reference_points() -> Session:
    """Return the demo session mapped at the published speed of sound, nothing of it stale."""
    session = demo().with_capture("references", None)
    bench = new_workbench(session.with_result("speed", None))
    try:
        bench.run(StartMapping())
        return bench.session
    finally:
        bench.close()


@cache
def measured_beside() -> Session:
    """Return the demo session with A-scans on the block, by hand, and of a quick look."""
    bench = new_workbench(demo())
    try:
        bench.run(StartDelayLineCapture(n=8))
        bench.dispatch(CalibrateDelayLine(use=False))  # else the boundaries are to be found again
        bench.run(StartHandheldCalibration(pivot_s=8.0, spin_s=8.0))
        bench.run(StartHandheldScan(duration_s=6.0, rate_hz=10.0, spacing_mm=8.0))
        bench.run(StartHandheldMapping())
        bench.run(StartQuickLook(lines=4))
        return bench.session
    finally:
        bench.close()
