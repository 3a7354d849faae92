"""``rona recover``: sessions that were not saved when their program ended."""

import json
import sys
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Any

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.saving.autosave import LostSession, Recovery
from rona_core.app.runtime.saving.journal import read_journal, restore
from rona_core.app.runtime.saving.session_files import SessionFiles
from rona_core.app.runtime.store import Store
from rona_core.errors import InvalidInputError, NameTakenError, NotFoundError
from rona_core.session.files import alone_in, save_session
from rona_ui.resources import sessions_dir

INCOMPLETE = 3  # exit status where not the whole of it could be recovered


def run(wanted: Any) -> int:
    """List them, write one to a file, or discard one."""
    folder = sessions_dir() if wanted.sessions is None else wanted.sessions.expanduser().resolve()
    recovery = Recovery(folder)
    if wanted.name is None:
        if wanted.discard or wanted.out is not None:
            raise InvalidInputError("say which session: rona recover without a name lists them")
        return _list(recovery, folder, as_json=wanted.json)
    lost = _named(recovery.all(), wanted.name)
    if wanted.discard:
        recovery.discard(lost.key)
        _say({"discarded": lost.key}, f"{_title(lost)} is discarded", as_json=wanted.json)
        return 0
    with alone_in(folder if wanted.out is None else wanted.out.resolve().parent):
        path = wanted.out or SessionFiles(folder).free_path(lost.name or lost.key)
        problem = _write(recovery, lost, path)
    text = f"{_title(lost)} is saved in {path}" + (f"; but {problem}" if problem else "")
    _say({"file": str(path), "problem": problem}, text, as_json=wanted.json)
    return INCOMPLETE if problem else 0


def _write(recovery: Recovery, lost: LostSession, path: Path) -> str | None:
    """Save a session, and remove its copy if that is the whole of it; else say what is not."""
    if path.exists():
        raise NameTakenError(f"{path} exists already: choose another name with --out")
    with recovery.held(lost.key) as copy:
        journal = read_journal(copy.path)
        store = Store(journal.session)
        problem = restore(store, journal)
        save_session(store.session, path)
        if problem is None:
            copy.remove()
    return problem


def _named(found: tuple[LostSession, ...], name: str) -> LostSession:
    """Return the one whose key or name it is, or the beginning of whose key."""
    fitting = [lost for lost in found if name == lost.key]
    fitting = fitting or [lost for lost in found if name == lost.name]
    fitting = fitting or [lost for lost in found if lost.key.startswith(name)]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        keys = ", ".join(lost.key for lost in fitting)
        raise InvalidInputError(f"{name!r} fits {len(fitting)} unsaved sessions: choose by {keys}")
    raise NotFoundError(f"there is no unsaved session {name!r}: rona recover lists them")


def _list(recovery: Recovery, folder: Path, *, as_json: bool) -> int:
    found = recovery.all()
    lines = [line for lost in found for line in _lines(lost)]
    where = f"in {folder}"
    text = "\n".join([f"not saved when the program ended, {where}:", *lines])
    _say(
        {"recoverable": [asdict(lost) for lost in found]},
        text if found else f"nothing to recover {where}",
        as_json=as_json,
    )
    return 0


def _lines(lost: LostSession) -> list[str]:
    when = datetime.fromisoformat(lost.changed_utc).astimezone().strftime("%Y-%m-%d %H:%M")
    size = f"{lost.size_bytes / 1e6:.1f} MB"
    lines = [f"  {lost.key}  {_title(lost)}", f"    changed {when}, {size}, {_steps(lost)}"]
    return lines + ([f"    {lost.problem}"] if lost.problem else [])


def _steps(lost: LostSession) -> str:
    if lost.name is None:
        return "it stays where it is"
    stale = f", {len(lost.steps_stale)} stale" if lost.steps_stale else ""
    return f"{len(lost.steps_done)} of {len(REGISTRY.step_names)} steps done{stale}"


def _title(lost: LostSession) -> str:
    return "a copy that cannot be read" if lost.name is None else lost.name


def _say(facts: dict[str, Any], text: str, *, as_json: bool) -> None:
    sys.stdout.write((json.dumps(facts, allow_nan=False) if as_json else text) + "\n")
