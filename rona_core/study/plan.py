"""The plan of a study: factors and their levels, and the patients that follow from them.

A plan is a TOML file; ``docs/how-to/run_a_study.md`` explains it. A factor is a field of a message,
by the names that REST and the log have for them.
"""

import dataclasses
import hashlib
import itertools
import json
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

from scipy.stats import qmc

from rona_core import __version__
from rona_core.app.declarations.declarations import Message
from rona_core.app.declarations.figures import FIGURES, Figure
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import message_from
from rona_core.app.procedure import OFFERED, PROCEDURE, Stages, stages
from rona_core.compose import DemoSkull
from rona_core.errors import InvalidInputError, RonaError, storing
from rona_core.session.files import digest_of

SKULL = "skull"  # its fields are those of a DemoSkull
SETUP_STEP = 1  # its commands may be factors: they are sent before anything is recorded
KNOWN = ("title", "until", "skip", "design", "seeds", "keep", "factors")
KEEP = re.compile(r"(worst|best) ([1-9]\d*) of (\w+)")
KEY_LENGTH = 16  # hexadecimal digits
MOST_FACTORS = 64

Level = Any  # a value of TOML


@dataclass(frozen=True, slots=True)
class Range:
    """Levels between two bounds, whole numbers where both bounds are."""

    low: float
    high: float

    def at(self, share: float) -> float:
        """Return the level at a share of the range, at least 0 and below 1."""
        if isinstance(self.low, int) and isinstance(self.high, int):
            return self.low + math.floor(share * (self.high - self.low + 1))
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Patient:
    """One run of the procedure: its seed, its level of every factor, and how far it goes."""

    seed: int
    levels: Mapping[str, Level]  # by the name of the factor, "Message.field"
    until: str
    skip: tuple[str, ...]
    files: Mapping[str, str]  # SHA-256 of every file that its skull is read from
    version: str = __version__

    @property
    def key(self) -> str:
        """What identifies it: a digest of all that its figures follow from."""
        plain = json.dumps(dataclasses.asdict(self), sort_keys=True, allow_nan=False)
        return hashlib.sha256(plain.encode()).hexdigest()[:KEY_LENGTH]

    @property
    def skull(self) -> DemoSkull:
        """What is scanned."""
        return _skull(self._fields().pop(SKULL, {}))

    @property
    def settings(self) -> list[Message]:
        """The commands of the set-up that make its levels."""
        return [one for one in self._messages() if _of_setup(type(one).__name__)]

    @property
    def stages(self) -> Stages:
        """The stages after set-up, with its levels."""
        others = [one for one in self._messages() if not _of_setup(type(one).__name__)]
        return stages(self.until, *others, skip=self.skip)

    def _fields(self) -> dict[str, dict[str, Level]]:
        found: dict[str, dict[str, Level]] = {}
        for name, level in self.levels.items():
            message, _, field = name.partition(".")
            found.setdefault(message, {})[field] = level
        return found

    def _messages(self) -> list[Message]:
        fields = self._fields()
        fields.pop(SKULL, None)
        return [message_from(name, given) for name, given in fields.items()]


@dataclass(frozen=True, slots=True)
class KeepRule:
    """Which patients' sessions are kept: so many with the worst, or best, values of a figure."""

    which: Literal["worst", "best"]
    count: int
    figure: Figure

    @property
    def words(self) -> str:
        """The rule as the plan has it."""
        return f"{self.which} {self.count} of {self.figure.key}"

    def chosen(self, rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
        """Return the rows that it chooses, the first of them first; ties by their keys."""
        known = [row for row in rows if number(row.get(self.figure.key)) is not None]
        largest = (self.which == "worst") == (self.figure.sense == "at most")

        def order(row: Mapping[str, Any]) -> tuple[float, str]:
            value = float(row[self.figure.key])
            size = abs(value) if self.figure.sense == "at most" else value
            return -size if largest else size, str(row["key"])

        return sorted(known, key=order)[: self.count]


@dataclass(frozen=True, slots=True)
class Plan:
    """A study: factors with their levels, seeds, the last stage, and whose sessions are kept."""

    title: str
    until: str
    skip: tuple[str, ...]
    design: Literal["crossed", "drawn"]
    seeds: range
    factors: Mapping[str, tuple[Level, ...] | Range]
    keep: tuple[KeepRule, ...]
    text: str  # of the file

    @property
    def stages(self) -> Stages:
        """The stages after set-up."""
        return stages(self.until, skip=self.skip)

    @property
    def varied(self) -> tuple[str, ...]:
        """Names of the factors that have more than one level."""
        return tuple(
            name for name, of in self.factors.items() if isinstance(of, Range) or len(of) > 1
        )

    def patients(self) -> list[Patient]:
        """Return the patients of the study, each once, in the order in which they are run.

        Crossed: every level of every factor with every other, for every seed. Drawn: one patient
        a seed, its levels by a scrambled sequence of Sobol, whose beginning does not depend on how
        many seeds there are.
        """
        drawn = self._crossed() if self.design == "crossed" else self._drawn()
        digests: dict[str, str] = {}
        patients: dict[str, Patient] = {}
        for seed, levels in drawn:
            files = {
                path: digests.setdefault(path, "") or _digest_file(path, digests)
                for path in _files(levels)
            }
            patient = Patient(seed, levels, self.until, self.skip, files)
            patients.setdefault(patient.key, patient)
        return list(patients.values())

    def _crossed(self) -> list[tuple[int, dict[str, Level]]]:
        levels = [cast(tuple[Level, ...], of) for of in self.factors.values()]
        combined = [dict(zip(self.factors, one, strict=True)) for one in itertools.product(*levels)]
        return [(seed, one) for seed in self.seeds for one in combined]

    def _drawn(self) -> list[tuple[int, dict[str, Level]]]:
        if not self.factors:
            return [(seed, {}) for seed in self.seeds]
        draw = qmc.Sobol(len(self.factors), rng=0)
        shares = draw.random_base2(math.ceil(math.log2(max(len(self.seeds), 2))))
        return [
            (seed, {name: _level(of, u) for (name, of), u in zip(self.factors.items(), row)})  # noqa: B905
            for seed, row in zip(self.seeds, shares.tolist(), strict=False)
        ]


def _level(of: tuple[Level, ...] | Range, share: float) -> Level:
    return of.at(share) if isinstance(of, Range) else of[math.floor(share * len(of))]


def _files(levels: Mapping[str, Level]) -> list[str]:
    names = (f"{SKULL}.path", f"{SKULL}.inner")
    return [str(levels[name]) for name in names if levels.get(name)]


def _digest_file(path: str, digests: dict[str, str]) -> str:
    with storing(path):
        digests[path] = digest_of(Path(path).read_bytes())
    return digests[path]


def number(value: object) -> float | None:
    """Return a value of a figure as a number; None for words, a yes or no, and none."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value)


# ------------------------------------------------------------------ reading


def read_plan(path: Path) -> Plan:
    """Read a plan and look at every level of it before anything is run.

    Raises:
        InvalidInputError: not TOML, an unknown name, or a level that its message refuses.
        StorageError: it cannot be read.
    """
    with storing(path):
        data = path.read_bytes()
    try:
        text = data.decode("utf-8")
        return plan_of(tomllib.loads(text), path.stem, text)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"{path}: not TOML: {error}") from error
    except RonaError as error:
        raise InvalidInputError(f"{path}: {error}") from error


def plan_of(given: Mapping[str, Any], name: str, text: str = "") -> Plan:
    """Return the plan that a table of TOML holds.

    Raises:
        InvalidInputError: an unknown name, or a level that its message refuses.
    """
    for key in given:
        _require(key in KNOWN, f"{key} is not known: a plan has {', '.join(KNOWN)}")
    design = given.get("design", "crossed")
    _require(design in ("crossed", "drawn"), f"design is crossed or drawn, not {design!r}")
    skip = tuple(_list(given.get("skip", []), "skip"))
    for stage in skip:
        _require(stage in OFFERED, f"skip: one of {', '.join(OFFERED)}, not {stage!r}")
    plan = Plan(
        title=str(given.get("title", name)),
        until=str(given.get("until", PROCEDURE[-1].name)),
        skip=skip,
        design=design,
        seeds=_seeds(given.get("seeds")),
        factors=_factors(given.get("factors", {}), design),
        keep=tuple(_rule(words) for words in _list(given.get("keep", []), "keep")),
        text=text,
    )
    _look_at_levels(plan)
    return plan


def _require(holds: bool, words: str) -> None:
    if not holds:
        raise InvalidInputError(words)


def _list(value: Any, name: str) -> list[Any]:
    _require(isinstance(value, list), f"{name} is a list, [...], not {value!r}")
    return value


def _seeds(value: Any) -> range:
    says = "seeds is { first = 0, count = 100 }, both whole numbers, count at least 1"
    _require(isinstance(value, dict) and set(value) == {"first", "count"}, says)
    whole = all(isinstance(one, int) and not isinstance(one, bool) for one in value.values())
    _require(whole and value["count"] >= 1 and value["first"] >= 0, says)
    return range(value["first"], value["first"] + value["count"])


def _factors(value: Any, design: str) -> dict[str, tuple[Level, ...] | Range]:
    found: dict[str, tuple[Level, ...] | Range] = {}
    _require(isinstance(value, dict), "factors is a table")
    for message, fields in value.items():
        says = f"factors: {message} is followed by a field, such as SetRobot.model = [...]"
        _require(isinstance(fields, dict), says)
        for field, levels in fields.items():
            name = f"{message}.{field}"
            _require_field(message, field)
            found[name] = _levels(name, levels, design)
    _require(len(found) <= MOST_FACTORS, f"at most {MOST_FACTORS} factors, not {len(found)}")
    return found


def _require_field(message: str, field: str) -> None:
    """Refuse what is no field of a message that a patient is run with."""
    staged = {type(stage.message).__name__ for stage in PROCEDURE}
    known = sorted(staged | {name for name in REGISTRY.command_types if _of_setup(name)} | {SKULL})
    _require(message in known, f"{message} is no message of a run: one of {', '.join(known)}")
    kind = DemoSkull if message == SKULL else REGISTRY.messages[message]
    fields = [one.name for one in dataclasses.fields(kind)]
    _require(field in fields, f"{message} has no field {field!r}: it has {', '.join(fields)}")


def _levels(name: str, levels: Any, design: str) -> tuple[Level, ...] | Range:
    if isinstance(levels, list):
        _require(bool(levels), f"{name} has no level")
        return tuple(levels)
    says = f"{name} is a list of levels, or {{ from = 1.0, to = 2.0 }}"
    _require(isinstance(levels, dict) and set(levels) == {"from", "to"}, says)
    bounds = [levels["from"], levels["to"]]
    _require(all(number(one) is not None for one in bounds) and bounds[0] < bounds[1], says)
    _require(design == "drawn", f'{name} is a range: that needs design = "drawn"')
    return Range(*bounds)


def _of_setup(message: str) -> bool:
    of_setup = message in REGISTRY.command_types and REGISTRY.number_of(message) == SETUP_STEP
    return of_setup and message != "SetSeed"


def _skull(fields: Mapping[str, Level]) -> DemoSkull:
    given: dict[str, Any] = {
        name: tuple(level) if isinstance(level, list) else level for name, level in fields.items()
    }
    return DemoSkull(**given)


def _rule(words: Any) -> KeepRule:
    found = KEEP.fullmatch(words) if isinstance(words, str) else None
    if found is None:
        raise InvalidInputError(f'keep: "worst 5 of thickness_rms_mm" or "best ...", not {words!r}')
    which, count, key = found.groups()
    _require(key in FIGURES, f"keep: there is no figure {key}, see docs/metrics.md")
    return KeepRule(cast(Literal["worst", "best"], which), int(count), FIGURES[key])


def _look_at_levels(plan: Plan) -> None:
    """Make the messages with every level once, both ends of a range, so that bad ones are refused.

    Others stand at their first level meanwhile.
    """
    ends = {
        name: (of.low, of.high) if isinstance(of, Range) else of
        for name, of in plan.factors.items()
    }
    first = {name: levels[0] for name, levels in ends.items()}
    _look_at(plan, first, "")
    for name, levels in ends.items():
        for level in levels[1:]:
            _look_at(plan, {**first, name: level}, f"{name} = {level!r}: ")


def _look_at(plan: Plan, levels: Mapping[str, Level], where: str) -> None:
    patient = Patient(plan.seeds.start, levels, plan.until, plan.skip, {})
    for path in _files(levels):
        _require(Path(path).is_file(), f"{where}there is no file {path}")
    try:
        _ = patient.settings, patient.stages, patient.skull
    except RonaError as error:
        raise InvalidInputError(f"{where}{error}") from error
