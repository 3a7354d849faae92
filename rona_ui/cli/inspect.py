"""``rona inspect``: what a session file holds."""

import json
import sys
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import done
from rona_core.app.dependencies.judge import step_states
from rona_core.session.files import load_session
from rona_core.session.members import SCHEMA


def run(wanted: Any) -> int:
    """Say what the file holds, as text or as JSON."""
    session = load_session(wanted.file)
    steps = step_states(session)
    captures = [
        {"kind": type(capture).__name__, "ordinal": capture.ordinal, "partial": capture.partial}
        for capture in session.archive
    ]
    if wanted.json:
        facts = {
            "name": session.name,
            "id": session.id,
            "created_utc": session.created_utc,
            "schema": SCHEMA,
            "seed": session.setup.seed,
            "revision": len(session.log),
            "steps": {step.name: {"state": step.state, "reason": step.reason} for step in steps},
            "captures": captures,
        }
        sys.stdout.write(json.dumps(facts, allow_nan=False) + "\n")
        return 0
    lines = [
        f"{session.name}  (id {session.id}, made {session.created_utc})",
        f"seed {session.setup.seed}, revision {len(session.log)}, schema {SCHEMA}",
        *(f"  {step.number:>2} {step.title:<11} {step.state:<8} {step.reason}" for step in steps),
    ]
    lines.append(f"devices: {', '.join(session.setup.devices.titles().values())}")
    partial = sum(capture.partial for capture in session.archive)
    stopped = f", {partial} of them stopped early" if partial else ""
    lines.append(f"recordings: {len(captures) or 'none'}{stopped}")
    lines += [f"  {done(name)}" for name in REGISTRY.replayed if session.results.get(name)]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0
