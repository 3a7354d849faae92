"""Staleness: whether the inputs of a result, or the set-up of a capture, have changed since."""

from typing import Any

from rona_core.app.declarations.inputs import Input, is_missing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.inputs import CAPTURE, missing
from rona_core.app.dependencies.obstacles import obstacles_of
from rona_core.devices.world_settings import NOMINAL_WORLD
from rona_core.errors import StepBlockedError
from rona_core.robot.collision.obstacles import Obstacles
from rona_core.session.captures import Capture, PointerCapture, is_imported
from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session
from rona_core.session.memo import Memo


def capture_setup_digest(kind: str, session: Session) -> str:
    """Return a digest of the part of the set-up that a capture of this kind depends on."""
    seen: list[object] = [session.setup.seed]
    if session.setup.world.profile != NOMINAL_WORLD.profile:
        seen.append(session.setup.world.profile)
    parts = REGISTRY.captures[kind].setup
    return digest(seen + [value for part in parts for value in part(session)])


_REASONS: Memo[str | None] = Memo(256)  # sessions never change, and each result asks those before


def input_digests(result: str, session: Session, message: str = "") -> dict[str, str]:
    """Return the digest of every input of a result as the session holds them now.

    Args:
        result: Its name.
        session: Holds the inputs.
        message: Name of the message that makes it, where it can be made of different things.

    Raises:
        StepBlockedError: an input is missing.
    """
    inputs = REGISTRY.result(result, message).inputs
    wanted = missing(tuple(inputs.values()), session)
    if wanted is not None:
        raise StepBlockedError(f"{result} cannot be computed: first {wanted}")
    return {name: digest_of(item.counted(session)) for name, item in inputs.items()}


def digest_of(value: object) -> str:
    """Return the digest of a value, or of each value in a tuple of them."""
    if isinstance(value, tuple):
        return digest([digest(item) for item in value])
    return digest(value)


def made_of(derived: Derived[Any] | None, name: str, value: object) -> bool:
    """Return whether there is a result and its input of this name was this value."""
    return derived is not None and derived.inputs.get(name) == digest_of(value)


def session_obstacles(session: Session) -> Obstacles:
    """Return what the robot is to keep away from, by all results that are not stale."""
    return obstacles_of(session, lambda name: stale_reason(name, session) is None)


def stale_reason(name: str, session: Session) -> str | None:
    """Return why a result (``"roll"``) or capture (``"capture scan"``) is stale, or None."""
    return _REASONS.get((session,), lambda: _stale_reason(name, session), name)


def _stale_reason(name: str, session: Session) -> str | None:
    if name.startswith(CAPTURE):
        return _stale_capture(name.removeprefix(CAPTURE), session)
    derived = session.results.get(name)
    if derived is None:
        return None
    for key, item in REGISTRY.result(name, derived.message).inputs.items():
        if item.upstream is not None and (reason := stale_reason(item.upstream, session)):
            return reason
        value = item.counted(session)
        nothing = is_missing(value)
        if key not in derived.inputs:  # made by a version that did not know of it
            if nothing and item.optional:
                continue
            return f"the {name} result was computed without {key}: compute it again"
        lost = nothing and not item.optional
        if lost or derived.inputs[key] != digest_of(value):
            return f"{key} has changed since the {name} result was computed"
    return None


def stale_root(inputs: tuple[Input[object], ...], session: Session) -> Input[object] | None:
    """Return what is to be done again first, for inputs that may be stale; None if none is.

    It is stale itself, not for the sake of something before it, and belongs to the earliest step.
    """
    found = [root for item in inputs for root in _stale_roots(item, session)]
    return min(found, key=lambda root: place_of(root.upstream or ""), default=None)


def _stale_roots(item: Input[object], session: Session) -> list[Input[object]]:
    name = item.upstream
    if name is None or stale_reason(name, session) is None:
        return []
    before: tuple[Input[object], ...] = ()
    if name.startswith(CAPTURE):
        after = REGISTRY.captures[name.removeprefix(CAPTURE)].after
        before = () if after is None else (after,)
    elif derived := session.results.get(name):
        before = tuple(REGISTRY.result(name, derived.message).inputs.values())
    roots = [root for one in before for root in _stale_roots(one, session)]
    return roots or [item]


def is_orphan(item: Input[object], session: Session) -> bool:
    """Return whether a capture lacks the result it rests on: a file too old to hold the plan.

    Its scan can be mapped.
    """
    if item.upstream is None or not item.upstream.startswith(CAPTURE):
        return False
    after = REGISTRY.captures[item.upstream.removeprefix(CAPTURE)].after
    if after is None or after.upstream is None or after.upstream.startswith(CAPTURE):
        return False
    return session.results.get(after.upstream) is None


def place_of(name: str) -> int:
    """Return where in the procedure a result or capture comes; -1 for none of them."""
    names = [
        part
        for step in REGISTRY.steps
        for part in (
            *(f"{CAPTURE}{c.name}" for c in step.captures),
            *(r.name for r in step.results),
        )
    ]
    return names.index(name) if name in names else -1


def _stale_capture(kind: str, session: Session) -> str | None:
    held = session.captures.get(kind)
    captures = held if isinstance(held, tuple) else (held,)
    present = capture_setup_digest(kind, session)
    if any(_is_of_another(capture, present, session) for capture in captures):
        return f"the set-up or plan has changed since the {kind} capture was taken"
    after = REGISTRY.captures[kind].after
    if after is not None and after.upstream is not None and held is not None:
        return stale_reason(after.upstream, session)
    return None


def _is_of_another(capture: Capture | None, present: str, session: Session) -> bool:
    if isinstance(capture, PointerCapture) and is_imported(capture):
        return capture.pointer != session.setup.devices.pointer  # all that it depends on
    return capture is not None and capture.setup_digest != present
