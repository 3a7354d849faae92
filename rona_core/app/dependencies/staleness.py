"""Inputs by name, and staleness: whether those of a result or capture have changed since."""

from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numpy as np

from rona_core.app.declarations.inputs import Input, Quantity, is_missing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import (
    CAPTURE,
    done,
    title,
    what_changed,
    what_changed_since,
)
from rona_core.calibration.hand_eye.tool_registration import ToolRegistration
from rona_core.calibration.surface_registration import SurfaceRegistration
from rona_core.devices.workcell import workcell_pose
from rona_core.devices.world_settings import NOMINAL_WORLD
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.geometry.arrays import Vector3
from rona_core.geometry.rigid_fit import bulging
from rona_core.geometry.surface.cloud import SurfaceCloud
from rona_core.robot.collision.obstacles import (
    Obstacle,
    Obstacles,
    added_boxes,
    head_as_placed,
    head_from_cloud,
    head_from_mesh,
    table_and_floor,
    tracker_stand,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.captures import Capture, PointerCapture, imported_setup, is_imported
from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session
from rona_core.session.memo import Memo
from rona_core.session.specimen import LoadedSkull

T = TypeVar("T")


@cache
def result_input(name: str, *, optional: bool = False) -> Input[Any]:
    """Return the value of a result as an input: one object for each result."""

    def read(session: Session) -> object:
        derived = session.results.get(name)
        return None if derived is None else derived.value

    return Input(read, None, name, optional)


@cache
def capture_input(name: str) -> Input[Any]:
    """Return a capture as an input: one object for each capture."""
    return Input(lambda session: session.captures.get(name), None, f"{CAPTURE}{name}")


def wanted_for(item: Input[object]) -> str:
    """Return what to do to get an input."""
    if item.wanted is not None or item.upstream is None:
        return item.wanted or ""
    return wanted_of(item.upstream)


def wanted_of(name: str) -> str:
    """Return what to do to get a result (``"roll"``) or capture (``"capture scan"``)."""
    if name.startswith(CAPTURE):
        return REGISTRY.captures[name.removeprefix(CAPTURE)].wanted
    return REGISTRY.result(name).wanted


def missing(inputs: tuple[Input[object], ...], session: Session) -> str | None:
    """Return what to do first, or None if nothing is missing."""
    for item in inputs:
        if not item.optional and is_missing(item.read(session)):
            return wanted_for(item)
    return None


def required(item: Input[T] | Quantity[T], session: Session) -> T:
    """Return an input or a quantity; raise StepBlockedError that says what to do first."""
    value = item.read(session)
    if value is None or is_missing(value):
        parts = (item,) if isinstance(item, Input) else tuple(item.inputs().values())
        raise StepBlockedError(f"first {missing(parts, session) or wanted_for(parts[0])}")
    return value


UP = np.array((0.0, 0.0, 1.0))

_KNOWN: Memo[Obstacles] = Memo(16)


def obstacles_of(session: Session, fresh: Callable[[str], bool]) -> Obstacles:
    """Return everything that the robot is to keep away from, in ``base``.

    The head is the registered skull of a file, else what a large head could be under the measured
    patch, else a large head at its place in the set-up. Equal inputs give the same value.

    Args:
        session: Set-up, captures and results.
        fresh: Maps a result's name to whether it is there and not stale; stale ones are not used.
    """
    results, setup = session.results, session.setup
    tool = results.tool.value if results.tool and fresh("tool") else None
    cloud = results.surface.value if results.surface and fresh("surface") else None
    skull = results.registration
    usable = cloud and skull and skull.value.verdict != "bad" and fresh("registration")
    found = skull.value if usable and skull else None
    parts = (
        setup.surroundings,
        setup.devices.robot,
        setup.specimen,
        tool,
        cloud,
        found,
        session.captures.surface,
    )
    return _KNOWN.get(parts, lambda: _build(session, tool, cloud, found))


def _build(
    session: Session,
    tool: ToolRegistration | None,
    cloud: SurfaceCloud | None,
    found: SurfaceRegistration | None,
) -> Obstacles:
    settings = session.setup.surroundings
    robot = session.setup.devices.robot
    room, work_room = workcell_pose(robot), np.array(robot_model(robot.model).work_area.region_base)
    head, sentence = _head(session, room @ work_room, tool, cloud, found)
    stand = () if tool is None else tracker_stand(settings, tool.T_base_tracker)
    return Obstacles(
        things=(
            head,
            *table_and_floor(settings, room, work_room),
            *stand,
            *added_boxes(settings, room),
        ),
        self_margin_mm=settings.self_margin_mm,
        sentence=sentence,
    )


def _head(
    session: Session,
    work_base: Vector3,
    tool: ToolRegistration | None,
    cloud: SurfaceCloud | None,
    found: SurfaceRegistration | None,
) -> tuple[Obstacle, str]:
    settings, skull = session.setup.surroundings, session.setup.specimen
    keep = settings.head_margin_mm
    if cloud is not None:
        try:
            if found is not None and isinstance(skull, LoadedSkull):
                vertices, T_base_skull = skull.mesh_vertices_skull, found.T_b_a.inv()
                head = head_from_mesh(vertices, T_base_skull, cloud.points_base, keep)
                return head, "Head: convex hull of the registered skull and of the touched points."
            outward = outward_of_surface(tool, cloud, session.captures.surface)
            head = head_from_cloud(cloud.points_base, outward, keep)
            return head, "Head: all that a large head could be under the touched patch."
        except DegenerateGeometryError as error:
            why = f" ({error})"
    else:
        why = " (not touched yet)"
    below = np.array((0.0, 0.0, settings.head_below_mm))
    head = head_as_placed(work_base - below, keep)
    return head, f"Head: a large head at its place in the set-up{why}."


def outward_of_surface(
    tool: ToolRegistration | None, cloud: SurfaceCloud, strokes: tuple[PointerCapture, ...]
) -> Vector3:
    """Return the direction from the patch to where the markers of the pointer were.

    Where nothing was touched it is that in which the patch bulges; of a flat one up.
    """
    seen = [stroke.marker.Ts_tracker_marker.translations for stroke in strokes]
    markers = [places for places in seen if len(places)]
    if tool is None or not markers:
        return bulging(cloud.points_base)
    way = tool.T_base_tracker @ np.vstack(markers).mean(axis=0) - cloud.points_base.mean(axis=0)
    length_mm = float(np.linalg.norm(way))
    return way / length_mm if length_mm > 0.0 else UP


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
        raise StepBlockedError(f"first {wanted}")
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
    items = REGISTRY.result(name, derived.message).inputs.items()
    # what is itself made of recordings and results says less than those
    for key, item in sorted(items, key=lambda one: bool(one[1].title and one[1].counts)):
        if item.upstream is not None and (reason := stale_reason(item.upstream, session)):
            return reason
        value = item.counted(session)
        nothing = is_missing(value)
        if key not in derived.inputs:  # made by a version that did not know of it
            if nothing and item.optional:
                continue
            return f"{done(name, derived.message)} without {title(item)}: do it again"
        lost = nothing and not item.optional
        if lost or derived.inputs[key] != digest_of(value):
            was_missing = derived.inputs[key] in (digest_of(None), digest_of(()))
            words = what_changed(item, was_missing=was_missing, is_missing=nothing)
            return f"{words} since {done(name, derived.message)}"
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
    for capture in captures:
        if _is_of_another(capture, present, session):
            return what_changed_since(kind, capture, session)
    after = REGISTRY.captures[kind].after
    if after is not None and after.upstream is not None and held is not None:
        return stale_reason(after.upstream, session)
    return None


def _is_of_another(capture: Capture | None, present: str, session: Session) -> bool:
    if capture is None:
        return False
    if not is_imported(capture):
        return capture.setup_digest != present
    if isinstance(capture, PointerCapture):
        return capture.pointer != session.setup.devices.pointer  # all that it depends on
    return imported_setup(capture) != setup_of_import(capture, session)


def setup_of_import(capture: Capture, session: Session) -> str:
    """Return the digest of what of the set-up an imported capture rests on; "" for nothing.

    Joint angles mean nothing without their robot, and A-scans nothing without their probe.
    """
    devices, parts = session.setup.devices, list[object]()
    if any(hasattr(capture, name) for name in ("joints", "qs_rad")):
        parts.append(devices.robot.model)
    if any(hasattr(capture, name) for name in ("scans", "tracks")):
        parts.append(devices.probe.name)
    return digest(parts) if parts else ""
