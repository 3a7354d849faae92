"""What every session can do, whatever its steps: rename, undo, redo, replay."""

from dataclasses import replace

from rona_core.app.declarations import declarations as declare
from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.messages.message import Answer, message
from rona_core.app.runtime.recompute import replay_report
from rona_core.devices.limits import limited
from rona_core.session.document import TITLE, Session


@message
class RenameSession:
    """Give the session another name."""

    name: str = limited(**TITLE)


@message
class Undo:
    """Take the last change back."""


@message
class Redo:
    """Do again what was taken back."""


@message
class StartReplay:
    """Compute every result again from the captures and compare; the session stays as it is.

    Results that are stale are left out. What was found is the `result` of the job.
    """


def _rename(message: RenameSession, session: Session) -> Session:
    return replace(session, name=message.name.strip())


def _replay(activity: StartReplay, session: Session, context: ActivityContext) -> tuple[Answer]:
    return (Answer(context.run(replay_report, session)),)


SESSION = declare.Step(
    "session",
    commands=(
        declare.Command(RenameSession, _rename),
        declare.Command(Undo),
        declare.Command(Redo),
    ),
    activities=(declare.Activity(StartReplay, _replay, "Computing all results again"),),
)
