"""The registry of declared steps: everything that can be asked of a session, by name.

`rona_core.app.steps` fills it when `rona_core.app` is imported, in each process. Nothing here knows
a step; all that is looked up follows from what the steps declare.
"""

from collections.abc import Iterable

from rona_core.app.declarations.declarations import (
    Activity,
    Capture,
    Command,
    Export,
    Result,
    Step,
    StepLine,
)
from rona_core.errors import InvalidInputError, NotFoundError
from rona_core.session.codec import allow_type
from rona_core.session.document import Session


class Registry:
    """Holds the declared steps in order, and finds their parts by name."""

    def __init__(self) -> None:
        self.steps: tuple[Step, ...] = ()
        self.commands: dict[str, Command] = {}
        self.outcomes: dict[str, Command] = {}
        self.activities: dict[str, Activity] = {}
        self.captures: dict[str, Capture] = {}
        self.exports: dict[str, Export] = {}
        self._results: dict[str, dict[str, Result]] = {}  # name -> message -> declaration
        self._step_of: dict[str, Step] = {}  # message -> step that declares it

    def declare(self, steps: Iterable[Step]) -> None:
        """Add steps.

        Raises:
            InvalidInputError: a step, message, capture or export of this name is declared already.
        """
        for step in steps:
            kinds = [part.message.__name__ for part in (*step.commands, *step.activities)]
            taken = [name for name in kinds if name in self._step_of]
            taken += [part.name for part in step.captures if part.name in self.captures]
            taken += [part.name for part in step.exports if part.name in self.exports]
            if taken or any(step.name == known.name for known in self.steps):
                raise InvalidInputError(f"declared twice: {', '.join([step.name, *taken])}")
            self._add(step, kinds)

    def _add(self, step: Step, kinds: list[str]) -> None:
        self.steps = (*self.steps, step)
        self.commands = self.commands | {part.message.__name__: part for part in step.commands}
        self.outcomes = self.outcomes | {part.message.__name__: part for part in step.outcomes}
        self.activities = self.activities | {p.message.__name__: p for p in step.activities}
        self.captures = self.captures | {part.name: part for part in step.captures}
        self.exports = self.exports | {part.name: part for part in step.exports}
        self._step_of = self._step_of | dict.fromkeys(kinds, step)
        for result in step.results:
            made = self._results.get(result.name, {}) | {result.message.__name__: result}
            self._results = self._results | {result.name: made}
        for part in (*step.captures, *step.results):
            for kind in part.types:
                allow_type(kind)

    def export(self, session: Session, name: str) -> bytes:
        """Return a file of a session for other programs.

        Places are in ``base``, in mm; the milling path is in ``bed``.

        Args:
            session: With the result that the file is made of.
            name: One of ``exports``.

        Raises:
            NotFoundError: there is no such file.
            StepBlockedError: its result is missing, or does not suffice.
            StaleResultError: its result is out of date.
            RonaError: the file cannot be made of this result; the message says why.
        """
        if name not in self.exports:
            raise NotFoundError(f"there is no file {name!r} to export: {', '.join(self.exports)}")
        return self.exports[name].make(session)

    @property
    def lines(self) -> dict[str, StepLine]:
        """The lines of the list of steps, in order: the steps of the procedure, by name."""
        return {step.name: step.line for step in self.steps if step.line is not None}

    @property
    def step_names(self) -> tuple[str, ...]:
        """Names of the steps of the procedure, in order."""
        return tuple(self.lines)

    @property
    def listed(self) -> tuple[str, ...]:
        """Names of the steps whose captures and results are listed: together, that is all."""
        return tuple(
            step.name
            for step in self.steps
            if step.line is not None or (step.part_of is None and (step.captures or step.results))
        )

    @property
    def messages(self) -> dict[str, type]:
        """All public messages by name."""
        return {**self.command_types, **self.activity_types}

    @property
    def command_types(self) -> dict[str, type]:
        """All commands by name."""
        return {name: part.message for name, part in self.commands.items()}

    @property
    def activity_types(self) -> dict[str, type]:
        """All activities by name."""
        return {name: part.message for name, part in self.activities.items()}

    @property
    def result_names(self) -> tuple[str, ...]:
        """Names of all declared results, in the order of the steps."""
        return tuple(self._results)

    @property
    def replayed(self) -> tuple[str, ...]:
        """Names of the results that a replay computes again, in the order of the steps."""
        return tuple(name for name in self._results if self.result(name).derive is not None)

    def result(self, name: str, message: str = "") -> Result:
        """Return the declaration of a result, as a message makes it; else as its first one does.

        Raises:
            InvalidInputError: no such result.
        """
        made = self._results.get(name)
        if made is None:
            raise InvalidInputError(f"there is no result {name!r}")
        return made.get(message) or next(iter(made.values()))

    def results_of(self, message: str) -> tuple[Result, ...]:
        """Return the declared results that a message makes."""
        return tuple(made[message] for made in self._results.values() if message in made)

    def activity(self, message: object) -> Activity:
        """Return the declaration of an activity.

        Raises:
            InvalidInputError: there is none.
        """
        name = type(message).__name__
        if name not in self.activities:
            raise InvalidInputError(f"there is no activity {name}")
        return self.activities[name]

    def shown_in(self, activity: str) -> str | None:
        """Return the step of the procedure that an activity belongs to; None where several."""
        part = self.activities.get(activity)
        if part is None or part.of_several_steps:
            return None
        step = self._step_of[activity]
        shown = part.shown_in or step.part_of or step.name
        return shown if shown in self.step_names else None

    def number_of(self, message: str) -> int | None:
        """Return the number of the step that declares a command or outcome; None: of none."""
        for step in self.steps:
            if any(part.message.__name__ == message for part in (*step.commands, *step.outcomes)):
                name = step.part_of or step.name
                return self.step_names.index(name) + 1 if name in self.step_names else None
        return None

    def parts_of(self, step: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the names of captures and of results that are listed with a step."""
        parts = [one for one in self.steps if step in (one.name, one.part_of)]
        captures = tuple(part.name for one in parts for part in one.captures)
        results = dict.fromkeys(part.name for one in parts for part in one.results)
        return captures, tuple(results)


REGISTRY = Registry()
