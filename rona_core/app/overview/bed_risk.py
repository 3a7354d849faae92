"""How many virtual patients like this one broke the limit of their bed, by a kept study.

A study (`rona study`) puts what it found of its beds into ``beds.json``; the files in
``studied_beds`` are those of the kept ones. A session is compared with the study whose settings it
has, seed and name excepted; where none has them, no number is stated.
"""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

from scipy.special import betaincinv

from rona_core.app.dependencies.judge import fresh
from rona_core.app.messages.message import serialize_arguments
from rona_core.app.steps.implant.derivation import ImplantBed
from rona_core.app.steps.implant.messages import StartBedSearch
from rona_core.devices.limits import limits_of
from rona_core.errors import SessionFormatError
from rona_core.session.document import Session, Setup

KEPT = Path(__file__).with_name("studied_beds")
CONFIDENCE = 0.95  # of the upper bound, one-sided, and of intervals, two-sided
CLASSES = (0.99, 0.999)  # lower ends of the classes of predicted probability
MOST_DIFFERENCES = 3  # that are named
OPTIONAL = {  # results without which a bed is found, too: what a session then lacks
    "mounting": "no gauge plate",
    "second": "no tilted passes",
    "speed": "no caliper",
    "burr": "burr not registered",
}
NOT_COVERED = (
    "Not covered: real devices and bone, errors of the milling itself, what holds the screws."
)

Conditions = Mapping[str, Any]  # what differs from the default, by its place


@dataclass(frozen=True, slots=True, kw_only=True)
class StudiedBeds:
    """What a study found of the beds of its patients, who all had the same settings."""

    title: str
    version: str
    first_seed: int
    last_seed: int
    conditions: Conditions
    limit_mm: float
    failed: int  # patients without a search of a bed, or with a stage before it left out
    no_bed: int  # patients for whom no bed is safe
    beds: tuple[tuple[float, float], ...]  # accepted: predicted probability, true bone left in mm

    @property
    def patients(self) -> int:
        """Patients who came to the search of a bed."""
        return len(self.beds) + self.no_bed


@dataclass(frozen=True, slots=True, kw_only=True)
class BedRisk:
    """What a kept study says of a bed; without `beds`, why none says anything."""

    study: str = ""
    version: str = ""
    differences: tuple[str, ...] = ()  # settings that no study has; empty: one has them all
    patients: int = 0  # who came to the search of a bed
    no_bed: int = 0  # of these
    beds: int = 0  # accepted in the same class of predicted probability
    broken: int = 0  # of these, with less true bone than the limit
    bound: float | None = None  # upper, of 95 %, on the share of such beds
    words: str


def bed_risk(session: Session) -> BedRisk | None:
    """Return what the kept studies say of the bed of a session; None without a bed of now."""
    bed: ImplantBed | None = fresh("bed", session)
    return None if bed is None else risk_among(kept_beds(), bed, conditions_of(session))


def risk_among(
    studies: tuple[StudiedBeds, ...], bed: ImplantBed, conditions: Conditions
) -> BedRisk:
    """Return what studies say of a bed that was found under some conditions."""
    same = next((one for one in studies if one.conditions == conditions), None)
    if same is None:
        return _uncovered(studies, conditions)
    if bed.refusal is not None or bed.placed is None:
        return _of_refused(same)
    return _of_accepted(same, bed.placed.probability)


def _of_refused(study: StudiedBeds) -> BedRisk:
    patients, no_bed = study.patients, study.no_bed
    low, high = interval(no_bed, patients)
    words = (
        f"Of {patients} virtual patients like this one, {no_bed} had no safe bed either "
        f"(95 %: {100.0 * low:.1f} to {100.0 * high:.1f} %)."
    )
    return BedRisk(
        study=study.title, version=study.version, patients=patients, no_bed=no_bed, words=words
    )


def _of_accepted(study: StudiedBeds, probability: float) -> BedRisk:
    low, high, at = _class_of(probability)
    beds = [true_mm for predicted, true_mm in study.beds if low <= predicted < high]
    broken = sum(true_mm < study.limit_mm for true_mm in beds)
    bound = upper_bound(broken, len(beds))
    words = (
        f"Of {len(beds)} virtual patients like this one with a bed accepted at {at}, {broken} had "
        f"less than {study.limit_mm:g} mm of bone below it in truth "
        f"(95 %: below {100.0 * bound:.2g} %). {NOT_COVERED}"
    )
    if not beds:
        words = f"No virtual patient of the kept study has a bed accepted at {at}."
    return BedRisk(
        study=study.title,
        version=study.version,
        patients=study.patients,
        no_bed=study.no_bed,
        beds=len(beds),
        broken=broken,
        bound=bound,
        words=words,
    )


def _uncovered(studies: tuple[StudiedBeds, ...], conditions: Conditions) -> BedRisk:
    nearest = min(
        (_differences(one.conditions, conditions) for one in studies), key=len, default=()
    )
    named = ", ".join(nearest[:MOST_DIFFERENCES])
    more = len(nearest) - MOST_DIFFERENCES
    words = f"No kept study says how often such a bed breaks its limit: it has {named}"
    words += f" and {more} more" if more > 0 else ""
    return BedRisk(differences=nearest, words=f"{words} that none had.")


def _differences(studied: Conditions, present: Conditions) -> tuple[str, ...]:
    """Return in words what is otherwise than in a study; `studied` where it is the default now."""
    both = dict.fromkeys((*studied, *present))
    changed = (place for place in both if _at(place, studied) != _at(place, present))
    return tuple(_words(place, present) for place in changed)


def _at(place: str, conditions: Conditions) -> tuple[bool, Any]:
    return place in conditions, conditions.get(place)


def _words(place: str, present: Conditions) -> str:
    if place in OPTIONAL.values() or place == BY_HAND:
        return place if place in present else f"not: {place}"
    label = _labels().get(place, place.rpartition(".")[2])
    value = present.get(place, "the default")
    return f"{label} {value:g}" if isinstance(value, float) else f"{label} {value}"


def _class_of(probability: float) -> tuple[float, float, str]:
    """Return bounds and words of the class of a predicted probability."""
    low, high = CLASSES
    if probability >= high:
        return high, float("inf"), f"{100.0 * high:g} % or more"
    return low, high, f"{100.0 * low:g} to {100.0 * high:g} %"


def upper_bound(count: int, of: int) -> float:
    """Return the one-sided upper bound of Clopper and Pearson, at 95 %, on a share."""
    return 1.0 if count >= of else float(betaincinv(count + 1, of - count, CONFIDENCE))


def interval(count: int, of: int) -> tuple[float, float]:
    """Return the two-sided interval of Clopper and Pearson, of 95 %, of a share."""
    tail = (1.0 - CONFIDENCE) / 2.0
    low = 0.0 if count == 0 else float(betaincinv(count, of - count + 1, tail))
    high = 1.0 if count >= of else float(betaincinv(count + 1, of - count, 1.0 - tail))
    return low, high


# ------------------------------------------------------------------ conditions of a bed

BY_HAND = "bed laid by hand"


def conditions_of(session: Session) -> dict[str, Any]:
    """Return what a session's bed was found with, as far as it is not the default."""
    held = session.results.more["bed"]
    makes = [name for name in OPTIONAL if session.results.get(name) is not None]
    found = conditions_from(session.setup, held.arguments, makes)
    if held.message != StartBedSearch.__name__:
        found[BY_HAND] = True
    return found


def conditions_from(
    setup: Setup, search: Mapping[str, Any], makes: Collection[str]
) -> dict[str, Any]:
    """Return what is not the default of a set-up and of the search of a bed.

    Args:
        setup: Devices, world and region.
        search: Arguments of the search, by name.
        makes: Results that the procedure makes before it.
    """
    asked = serialize_arguments(StartBedSearch())
    found = _changed(setup, Setup()) | {
        f"search.{name}": value
        for name, value in search.items()
        if name in asked and value != asked[name]
    }
    absent = [words for name, words in OPTIONAL.items() if name not in makes]
    return json.loads(json.dumps(found | dict.fromkeys(absent, True)))  # as a file has them


def _changed(value: Any, default: Any, place: str = "") -> dict[str, Any]:
    """Return the fields of a dataclass that are not its default's, by their place; no seed."""
    if type(value) is not type(default) or not is_dataclass(value):
        plain = type(value).__name__ if is_dataclass(value) else value
        return {} if value == default else {place: plain}
    found: dict[str, Any] = {}
    for part in fields(value):
        if part.name != "seed":
            pair = getattr(value, part.name), getattr(default, part.name)
            found |= _changed(*pair, f"{place}.{part.name}".lstrip("."))
    return found


@cache
def _labels() -> dict[str, str]:
    found = {
        f"search.{name}": said["label"]
        for name, said in limits_of(StartBedSearch).items()
        if "label" in said
    }
    return found | _labels_of(Setup())


def _labels_of(value: Any, place: str = "") -> dict[str, str]:
    found: dict[str, str] = {}
    for name, said in limits_of(value).items():
        at = f"{place}.{name}".lstrip(".")
        if "label" in said:
            found[at] = said["label"]
        if is_dataclass(part := getattr(value, name)):
            found |= _labels_of(part, at)
    return found


# ------------------------------------------------------------------ files of the kept studies


@cache
def kept_beds() -> tuple[StudiedBeds, ...]:
    """Return what the kept studies found of the beds of their patients."""
    return tuple(read_beds(path.read_bytes()) for path in sorted(KEPT.glob("*.json")))


def read_beds(data: bytes) -> StudiedBeds:
    """Return what a study found of its beds, from its ``beds.json``.

    Raises:
        SessionFormatError: it is no such file.
    """
    try:
        given = json.loads(data)
        beds = tuple((float(p), float(true_mm)) for p, true_mm in given.pop("beds"))
        return StudiedBeds(**given, beds=beds)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise SessionFormatError(f"not the beds.json of a study: {error}") from error
