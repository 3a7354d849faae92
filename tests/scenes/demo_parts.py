"""The demo session as it was on the way: steps that need not be carried out once more."""

from dataclasses import replace

from rona_core.session.document import Captures, Results, Session
from rona_core.session.files import load_session
from rona_ui.resources import demo_session


def registered() -> Session:
    """Return the demo session as it was after step 3: tool and pointer calibrated."""
    session = load_session(demo_session())
    captures = Captures(tool=session.captures.tool, pointer=session.captures.pointer)
    results = Results(tool=session.results.tool, pointer=session.results.pointer)
    return replace(session, captures=captures, results=results, archive=())
