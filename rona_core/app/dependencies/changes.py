"""Sentences about what was changed and done, from what the steps declare; no internal name."""

import re
from collections.abc import Mapping

from rona_core.app.declarations.inputs import Input
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import StoreCapture, StoreResult
from rona_core.session.captures import Capture, PointerCapture, is_imported
from rona_core.session.document import LogEntry, Session

CAPTURE = "capture "  # before the name of a capture, where results are named too
OF_ALL = ("SetSeed", "SetWorld")  # every capture depends on seed and profile of the world


def done(part: str, message: str = "") -> str:
    """Return what happened when a result (``"maps"``) or capture (``"capture scan"``) was made.

    Args:
        part: Its name.
        message: Name of the message that made it, where several do.

    Returns:
        A clause, as "the maps were computed".
    """
    if part.startswith(CAPTURE):
        return REGISTRY.captures[part.removeprefix(CAPTURE)].done
    return REGISTRY.result(part, message).done


def title(item: Input[object]) -> str:
    """Return what people call an input, as "the scan speed (step 1)"."""
    part = item.upstream or item.part
    return item.title or f"{_noun(done(part))}{_step(part)}"


def what_changed(item: Input[object], *, was_missing: bool, is_missing: bool) -> str:
    """Return what became of an input: "the tilted passes were scanned anew (step 9)"."""
    part = item.upstream or item.part
    if item.title or not part:
        return f"{item.title} was changed"
    clause = done(part)
    if is_missing:
        verb = "were" if " were " in clause else "was"
        return f"{_noun(clause)}{_step(part)} {verb} removed or became out of date"
    return f"{clause}{'' if was_missing else ' anew'}{_step(part)}"


def what_changed_since(kind: str, capture: Capture | None, session: Session) -> str:
    """Return which part of the set-up, or of what came before, was changed since a capture.

    Its digest does not show which. The log does, unless a change was undone; else each part that
    the capture depends on is named.
    """
    names = [name for part in REGISTRY.captures[kind].setup for name in part.changed_by]
    if is_imported(capture):
        names = ["SetPointer"] if isinstance(capture, PointerCapture) else ["SetRobot", "SetProbe"]
    else:
        names = list(dict.fromkeys((*names, *OF_ALL)))
    since = _changed_since(kind, getattr(capture, "ordinal", None), session)
    found = [name for name in names if name in since] or names
    nouns = list(dict.fromkeys(map(_changed_noun, found)))
    if len(nouns) == 1:
        listed = nouns[0] + _step(found[0])
    else:
        listed = f"{', '.join(nouns[:-1])} or {nouns[-1]}"
    return f"{listed} was changed since {done(CAPTURE + kind)}"


def imported_parts(step: str, session: Session) -> tuple[tuple[str, str], ...]:
    """Return what of a step was imported and is used: "the point cloud", and name of the file.

    The name is "a file" where the log does not have it.
    """
    found: list[tuple[str, str]] = []
    for name in REGISTRY.parts_of(step)[0]:
        held = session.captures.get(name)
        captures = held if isinstance(held, tuple) else (held,)
        for capture in captures:
            if is_imported(capture) and _is_used(name, step, session):
                found.append((_noun(done(CAPTURE + name)), _file_of(name, capture, session)))
    return tuple(dict.fromkeys(found))


def _is_used(name: str, step: str, session: Session) -> bool:
    """Return whether no result of a step was made by a message that takes another capture."""
    parts = [one for one in REGISTRY.steps if step in (one.name, one.part_of)]
    takers = [
        result
        for one in parts
        for result in one.results
        if any((item.upstream or item.part) == CAPTURE + name for item in result.inputs.values())
    ]
    made = [session.results.get(result.name) for result in takers]
    by = {result.message.__name__ for result in takers}
    return all(one is None or one.message in by for one in made)


def _file_of(kind: str, capture: Capture | None, session: Session) -> str:
    ordinal = getattr(capture, "ordinal", None)
    stored = (entry for entry in reversed(session.log) if _stores(entry, kind, ordinal))
    return str(next((entry.arguments.get("file") for entry in stored), None) or "a file")


def _changed_since(kind: str, ordinal: object, session: Session) -> set[str]:
    """Return names of messages, results and captures in the log after this capture."""
    places = [n for n, entry in enumerate(session.log) if _stores(entry, kind, ordinal)]
    if not places:
        return set()
    later = session.log[places[-1] + 1 :]
    return {name for entry in later for name in (entry.message, *made_by(entry))}


def _stores(entry: LogEntry, kind: str, ordinal: object) -> bool:
    held = entry.arguments.get("capture")
    stored = entry.message == StoreCapture.__name__ and entry.arguments.get("kind") == kind
    return stored and isinstance(held, Mapping) and held.get("ordinal") == ordinal


def made_by(entry: LogEntry) -> tuple[str, ...]:
    """Return names of the results and the capture that a message of the log made."""
    if entry.message == StoreCapture.__name__:
        return (f"{CAPTURE}{entry.arguments.get('kind')}",)
    if entry.message == StoreResult.__name__:
        values = entry.arguments.get("values")
        held = values if isinstance(values, Mapping) else {}
        return tuple(name for name in REGISTRY.result_names if name in held)
    return tuple(result.name for result in REGISTRY.results_of(entry.message))


def logged(entry: LogEntry) -> str:
    """Return what a message of the log did, in a sentence without a full stop."""
    if entry.message in REGISTRY.messages or entry.message in REGISTRY.outcomes:
        return sentence(entry.message)
    by = str(entry.arguments.get("message", ""))
    clauses = [done(part, by) for part in made_by(entry) if _is_declared(part)]
    return _as_sentence("; ".join(clauses)) or sentence(by or entry.message)


def sentence(message: str) -> str:
    """Return what a message does, in a sentence without a full stop; of one that is not known too.

    Args:
        message: Name of a command, outcome or activity.
    """
    command = REGISTRY.commands.get(message) or REGISTRY.outcomes.get(message)
    if command is not None and command.done:
        return _as_sentence(command.done)
    results = [result.done for result in REGISTRY.results_of(message)]
    activity = REGISTRY.activities.get(message)
    if not results and activity is not None:
        return activity.doing
    return _as_sentence("; ".join(results) or _words(message))


def _is_declared(part: str) -> bool:
    if part.startswith(CAPTURE):
        return part.removeprefix(CAPTURE) in REGISTRY.captures
    return part in REGISTRY.result_names


def _changed_noun(name: str) -> str:
    """Return what a message, a result or a capture changes: "the probe"."""
    command = REGISTRY.commands.get(name) or REGISTRY.outcomes.get(name)
    return _noun(done(name) if command is None else command.done)


def _noun(clause: str) -> str:
    return re.split(r" (?:was|were) ", clause, maxsplit=1)[0]


def _step(part: str) -> str:
    """Return " (step 9)" for a result, capture or message; "" where it is of no one step."""
    if part in REGISTRY.messages or part in REGISTRY.outcomes:
        number = REGISTRY.number_of(part)
        return "" if number is None else f" (step {number})"
    if part.startswith(CAPTURE):
        wanted = REGISTRY.captures[part.removeprefix(CAPTURE)].wanted
    else:
        wanted = REGISTRY.result(part).wanted
    found = re.search(r" \(step \d+\)$", wanted)
    return "" if found is None else found[0]


def _as_sentence(clause: str) -> str:
    return clause[:1].upper() + clause[1:]


def _words(name: str) -> str:
    """Return the words of the name of a class: that of a message of an older version."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower()
