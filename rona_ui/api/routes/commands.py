"""One route per command, made from the command list; undo and redo also under short addresses."""

from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from typing import Annotated, Any

from fastapi import APIRouter, Body

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.session_step import Redo, Undo
from rona_core.app.runtime.workbench import Workbench
from rona_ui.api.bodies import BodyRoute, body_bytes
from rona_ui.api.context import EXACT, Bench

router = APIRouter(route_class=BodyRoute, tags=["commands"])


@dataclass(frozen=True, slots=True)
class Changed:
    """What a command did: the session has this revision now."""

    command: str
    revision: int


def changed(bench: Workbench, command: Any) -> Changed:
    """Send a command and return what it did."""
    change = bench.dispatch(command)
    return Changed(change.message, change.revision)


def body_of(kind: Any) -> Any:
    """Return the parameter type of a message's body; it may be left out if all has defaults."""
    optional = all(
        field.default is not MISSING or field.default_factory is not MISSING
        for field in fields(kind)
    )
    body = Body(default_factory=kind) if optional else Body()
    return Annotated[kind, EXACT, body]


@router.post("/sessions/{session_id}/undo")
def undo(bench: Bench) -> Changed:
    """Take the last change back; the same as the command `Undo`."""
    return changed(bench, Undo())


@router.post("/sessions/{session_id}/redo")
def redo(bench: Bench) -> Changed:
    """Do again what was taken back; the same as the command `Redo`."""
    return changed(bench, Redo())


def declared_routes(
    tag: str,
    kinds: Mapping[str, type],
    handler: Callable[[type], Callable[..., Any]],
    status_code: int = 200,
) -> APIRouter:
    """Return a route for each message that the steps declare.

    Args:
        tag: Last part of the address before the name, and group in the document.
        kinds: Types of the messages by name.
        handler: Returns what answers the route of a type.
        status_code: Of an answer without a problem.
    """
    made = APIRouter(tags=[tag], route_class=BodyRoute)
    for name, kind in kinds.items():
        made.add_api_route(
            f"/sessions/{{session_id}}/{tag}/{name}",
            handler(kind),
            methods=["POST"],
            status_code=status_code,
            max_body_size=body_bytes(kind),
            name=name,
            operation_id=name,
            summary=(kind.__doc__ or name).splitlines()[0],
            description=kind.__doc__,
        )
    return made


def _handler(kind: type) -> Callable[..., Changed]:
    def send(bench: Bench, command: Any) -> Changed:
        return changed(bench, command)

    send.__annotations__["command"] = body_of(kind)
    return send


def declared_commands() -> APIRouter:
    """Return a route for each command that the steps declare."""
    return declared_routes("commands", REGISTRY.command_types, _handler)
