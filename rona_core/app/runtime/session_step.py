"""What every session can do, whatever its steps: rename, undo, redo, replay."""

from dataclasses import replace

from rona_core.app.declarations.declarations import Activity, ActivityContext, Command, Step
from rona_core.app.messages.outcomes import Answer
from rona_core.app.messages.session_messages import Redo, RenameSession, StartReplay, Undo
from rona_core.app.runtime.recompute import replay_report
from rona_core.session.document import Session


def _rename(message: RenameSession, session: Session) -> Session:
    return replace(session, name=message.name.strip())


def _replay(activity: StartReplay, session: Session, context: ActivityContext) -> tuple[Answer]:
    return (Answer(context.run(replay_report, session)),)


SESSION = Step(
    "session",
    commands=(Command(RenameSession, _rename), Command(Undo), Command(Redo)),
    activities=(Activity(StartReplay, _replay, "Computing all results again"),),
)
