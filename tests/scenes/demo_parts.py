"""The demo session as it was on the way: steps that need not be carried out once more."""

from dataclasses import replace
from functools import cache
from typing import Any

from rona_core.app.runtime import workbench
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.compose import build_virtual_rig, evaluate_virtual, new_workbench
from rona_core.session.document import Captures, Results, Session
from rona_core.session.files import load_session
from rona_ui.resources import demo_session


@cache
def demo() -> Session:
    """Return the demo session; it is loaded once, and nothing can change it.

    What was computed from it is kept when a workbench is closed: other tests ask for it again.
    """
    workbench.forget_all = lambda: None
    return load_session(demo_session())


@cache
def figures() -> dict[str, Any]:
    """Return the figures of the demo session, with those that need the truth."""
    return evaluate_virtual(demo(), build_virtual_rig(demo().setup))


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
