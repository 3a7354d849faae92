"""The procedure over REST: how each stage stands, and what to do now, why, and how to send it."""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query

from rona_core.app.declarations.declarations import Message, Standing
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import serialize_arguments
from rona_core.app.procedure import OFFERED, PROCEDURE, Stage, next_stage
from rona_core.errors import InvalidInputError
from rona_core.session.document import Session
from rona_ui.api.bodies import BodyRoute
from rona_ui.api.context import Bench

router = APIRouter(route_class=BodyRoute, tags=["procedure"])
Skip = Annotated[
    list[str] | None,
    Query(max_length=50, description="names of offered stages that are to be passed over"),
]


@dataclass(frozen=True, slots=True)
class Sent:
    """A message to be sent: POST `arguments` to `/sessions/{id}/{kind}/{name}`."""

    kind: Literal["commands", "jobs"]
    name: str
    arguments: dict[str, Any]


@dataclass(frozen=True, slots=True)
class StageState:
    """One stage of the procedure.

    `offered` says what a stage brings that may be left out; it is empty for the others. `remedy`
    and `message` are null where the stage is done, `message` also where a person must act.
    """

    name: str
    step: str  # of the list of steps
    title: str
    offered: str
    state: Standing
    reason: str  # why it is not usable, or weak
    remedy: str | None  # what to do, in words
    message: Sent | None


@router.get("/sessions/{session_id}/procedure")
def get_procedure(bench: Bench) -> tuple[StageState, ...]:
    """List the stages of the procedure after set-up in order, and how each stands."""
    session = bench.session
    return tuple(_state(stage, session) for stage in PROCEDURE)


@router.get("/sessions/{session_id}/next")
def get_next(bench: Bench, skip: Skip = None) -> StageState | None:
    """Return the stage to be done now, why, and the message to send; null where all is done.

    A stage that is `offered` is proposed until it is done, or named in `skip`.
    """
    skipped = skip or []
    for name in skipped:
        if name not in OFFERED:
            raise InvalidInputError(f"skip {name!r}: expected one of {', '.join(OFFERED)}")
    session = bench.session
    stage = next_stage(session, skipped)
    return None if stage is None else _state(stage, session)


def _state(stage: Stage, session: Session) -> StageState:
    found = stage.judgement(session)
    message = stage.next_message(session)
    return StageState(
        name=stage.name,
        step=stage.step,
        title=stage.title,
        offered=stage.offered,
        state=found.state,
        reason=found.reason,
        remedy=None if found.remedy is None else found.remedy.words,
        message=None if message is None else sent(message),
    )


def sent(message: Message) -> Sent:
    """Return how a message is sent."""
    name = type(message).__name__
    kind = "commands" if name in REGISTRY.command_types else "jobs"
    return Sent(kind, name, serialize_arguments(message))
