"""Declarations of what a step consists of: its messages, captures, results and its line.

A step declares itself once, in its folder below `rona_core.app.steps`; routes, labels, staleness,
replay and the step list follow from the declarations (`registry`).
"""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import CancelledError as PoolCancelled
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias, TypeVar, get_type_hints

from rona_core.app.declarations.inputs import Input, input_parts
from rona_core.devices.live import Live
from rona_core.devices.protocols import Cancel, Progress, Rig, never, silent
from rona_core.errors import CancelledError
from rona_core.session.captures import Capture as Recorded
from rona_core.session.document import Results, Session
from rona_core.session.specimen import LoadedSkull
from rona_core.ultrasound.acoustic_calibration.expected_performance import WhatIf

T = TypeVar("T")
ImportSkull = Callable[..., LoadedSkull]
Sweep = Callable[..., WhatIf]
Rehearse = Callable[..., object]  # (session, message, progress=, cancel=) -> what the step stores


class Compute(Protocol):
    """Run a pure function of picklable arguments; it takes ``progress`` and ``cancel`` too."""

    def __call__(
        self, function: Callable[..., T], *args: object, progress: Progress, cancel: Cancel
    ) -> T:
        """Return ``function(*args, progress=…, cancel=…)``, computed here or elsewhere.

        Raises:
            CancelledError: ``cancel`` returned True.
        """
        ...


def compute_here(
    function: Callable[..., T], *args: object, progress: Progress, cancel: Cancel
) -> T:
    """Compute in this thread: for scripts and tests."""
    try:
        return function(*args, progress=progress, cancel=cancel)
    except PoolCancelled as error:
        raise CancelledError("cancelled") from error


@dataclass(frozen=True, slots=True)
class ActivityContext:
    """Handed to an activity when it starts."""

    devices: Callable[[], Rig]  # built when they are asked for: computing needs none
    live: Live
    import_skull: ImportSkull
    uploads: Path
    compute: Compute = compute_here
    sweep: Sweep | None = None  # None where there are no virtual plates to try probes on
    rehearse: Rehearse | None = None  # None where there is no virtual bone to mill
    progress: Progress = field(default=silent)
    cancel: Cancel = field(default=never)

    @property
    def rig(self) -> Rig:
        """The devices."""
        return self.devices()

    def run(self, function: Callable[..., T], *args: object) -> T:
        """Return ``function(*args)``, computed where ``compute`` does, watched and cancellable.

        Raises:
            CancelledError: ``cancel`` returned True.
        """
        return self.compute(function, *args, progress=self.progress, cancel=self.cancel)


# A message is any frozen dataclass of plain values. A function that takes one declares its class,
# which no common type can say.
Message: TypeAlias = Any
Reason: TypeAlias = Callable[[Session], str | None]  # why something cannot be done; None: it can
Arguments: TypeAlias = Mapping[str, object]
# usable and weak are used by what follows; bad is there and fresh, and nothing uses it
Standing: TypeAlias = Literal["usable", "weak", "missing", "stale", "blocked", "bad"]


@dataclass(frozen=True, slots=True)
class Remedy:
    """What mends something that is not usable, in words and as a message that does it."""

    words: str  # "plan the motion (step 7)"
    message: Message | None = None  # None: no message does it, a person must act


@dataclass(frozen=True, slots=True)
class Judgement:
    """State of a result or capture, why it is not usable, and what mends that."""

    state: Standing
    reason: str = ""
    remedy: Remedy | None = None  # None where it is usable alone

    def beside(self, words: str) -> str:
        """Return ``words`` about something as a sentence, with why it is not used or weak."""
        if self.holds:
            return f"{words}; {self.reason}." if self.reason else f"{words}."
        return f"{words}. Not used: {self.reason}."

    @property
    def holds(self) -> bool:
        """Whether what follows uses it."""
        return self.state in ("usable", "weak")


USABLE = Judgement("usable")
# of a value that is there and fresh, and the session that holds it
Judge: TypeAlias = Callable[[Any, Session], Judgement]

Perform: TypeAlias = Callable[[Message, Session, ActivityContext], Iterable[Message]]


@dataclass(frozen=True, slots=True)
class Command:
    """A message that changes the session at once, and the pure function that does it."""

    message: type
    handle: Callable[[Message, Session], Session] | None = None  # None: the store itself does it
    needs: tuple[Input[object], ...] = ()
    takes_stale: bool = False  # it looks itself at what is stale
    done: str = ""  # what happened, as a clause for the log; "": as its results say


@dataclass(frozen=True, slots=True)
class Activity:
    """A message that takes time or touches a device, and what carries it out on a snapshot.

    What ``perform`` returns is dispatched in that order: of a generator while it works, else when
    the activity ends. Activities that use devices run one at a time.
    """

    message: type
    perform: Perform
    doing: str  # what people read while it runs
    needs: tuple[Input[object], ...] = ()
    drives_robot: bool = False
    makes: tuple[str, ...] = ()  # names of the captures that it records
    # a further reason against it, with its remedy; None: there is none
    blocked: Callable[[Session], Judgement | None] | None = None
    check: Callable[[Message, Session], None] | None = None  # raises why this very one is blocked
    shown_in: str | None = None  # the step of the procedure it belongs to; None: the declaring one
    of_several_steps: bool = False

    @property
    def uses_devices(self) -> bool:
        """Whether it uses the devices, as one activity at a time may."""
        return self.drives_robot or bool(self.makes)


@dataclass(frozen=True, slots=True)
class Result:
    """A computed result: the message that makes it, its inputs, and how it is computed.

    Where several messages make a result, each has a declaration. One that follows from captures is
    declared by `of`, and replayed: ``derive(known, message)`` is pure; that of an activity takes
    ``progress`` and ``cancel``, too. ``recompute`` replaces it in a replay where the arguments are
    more than those of the message.
    """

    name: str
    message: type
    inputs: Mapping[str, Input[object]]
    wanted: str = ""  # what to do to get it
    judged: Judge | None = None  # None: one that is fresh is usable
    types: tuple[type, ...] = ()  # further classes a session file may hold below Results.more
    derive: Callable[..., object] | None = None  # None: it follows from no capture
    known: type | None = None  # the class of the values that ``derive`` takes
    recompute: Callable[[Any, Arguments, Progress, Cancel], object] | None = None
    settings: tuple[str, ...] = ()  # fields of the message that it uses, of several results
    spared: bool = False  # left out where an input is missing, of several results
    done: str = ""  # what happened, as a clause: "the maps were computed"

    @classmethod
    def of(
        cls,
        name: str,
        message: type,
        derive: Callable[..., object],
        wanted: str,
        *,
        judged: Judge | None = None,
        settings: tuple[str, ...] = (),
        done: str,
    ) -> "Result":
        """Declare a result by its derivation, from a class of inputs to the class of the result.

        Raises:
            InvalidInputError: the first parameter has no such class.
        """
        hints = get_type_hints(derive)
        known = next(iter(hints.values()))
        counted = input_parts(known).counted
        types = () if name in {part.name for part in fields(Results)} else (hints["return"],)
        return cls(
            name,
            message,
            counted,
            wanted,
            judged,
            types,
            derive,
            known,
            settings=settings,
            done=done,
        )


@dataclass(frozen=True, slots=True)
class SetupPart:
    """A part of the set-up, or of what came before, that captures depend on."""

    read: Callable[[Session], list[object]]  # the values that are digested
    changed_by: tuple[str, ...]  # names of messages, results and captures ("capture scan")

    def __call__(self, session: Session) -> list[object]:
        """Return the values that are digested."""
        return self.read(session)


@dataclass(frozen=True, slots=True)
class Capture:
    """A capture: the parts of the set-up that it depends on, and how it is put into the session."""

    name: str
    wanted: str  # what to do to get it
    setup: tuple[SetupPart, ...]  # digested in this order
    after: Input[object] | None = None  # what it rests on
    # (session, recorded, append) -> what the session holds under the name; None: the recorded one
    place: Callable[[Session, Any, bool], object] | None = None
    judged: Judge | None = None  # of what the session holds; None: one that is whole is usable
    adds: bool = False  # always to those before, so that one that was stopped early counts, too
    # (before, after) -> after, without what belonged to the capture before
    stored: Callable[[Session, Session], Session] | None = None
    types: tuple[type, ...] = ()  # further classes a session file may hold below Captures.more
    done: str = ""  # what happened, as a clause: "the scan was recorded"

    def placed(self, session: Session, recorded: Recorded, append: bool) -> object:
        """Return what the session holds under the name once ``recorded`` is stored."""
        return recorded if self.place is None else self.place(session, recorded, append)


def _nothing(session: Session) -> tuple[Input[object], ...]:
    return ()


@dataclass(frozen=True, slots=True)
class StepLine:
    """A step in the list of steps: its title, its activity and the inputs that it leaves."""

    title: str
    summary: Callable[[Session], str]  # one line about what there is; empty if nothing yet
    message: type | None = None  # what does the step; None: it is always done
    leaves: Callable[[Session], tuple[Input[object], ...]] = _nothing
    # what it lacks because a recording was stopped early; None: asked of the captures it leaves
    partial: Reason | None = None
    partial_without: bool = True  # whether that counts before there is a result, too
    stale: Reason = lambda session: None  # a further reason for what is there to be stale


ExportKind = Literal["maps", "bed", "volume", "motion", "captures"]


@dataclass(frozen=True, slots=True)
class Export:
    """A file for other programs: its name, what it holds, and what makes it of a session."""

    name: str
    says: str
    make: Callable[[Session], bytes]
    kind: ExportKind | None = None  # with which others it is written; None: by its name alone


@dataclass(frozen=True, slots=True)
class Step:
    """All that belongs to a step. One without a line is part of another, or of several."""

    name: str
    commands: tuple[Command, ...] = ()
    outcomes: tuple[Command, ...] = ()  # stored by activities of the step; no route leads there
    activities: tuple[Activity, ...] = ()
    captures: tuple[Capture, ...] = ()
    results: tuple[Result, ...] = ()
    exports: tuple[Export, ...] = ()
    line: StepLine | None = None
    part_of: str | None = None  # the step whose captures and results are listed with these
