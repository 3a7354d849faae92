"""Types of messages: every field of every message takes what it is annotated with, nothing else."""

import dataclasses
from types import NoneType, UnionType
from typing import Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.messages.message import misfits, require_exact
from rona_core.app.runtime.saving.session_files import plain_name
from rona_core.app.runtime.session_step import RenameSession
from rona_core.app.steps.setup.messages import SetSeed, SetTracker, StartSkullImport
from rona_core.app.steps.tool.messages import StartRobotMove
from rona_core.compose import build_registry, new_workbench
from rona_core.devices.limits import INNER, limits_of
from rona_core.devices.settings import hidden_characters
from rona_core.errors import InvalidInputError
from rona_core.session.document import Session
from rona_core.session.files import session_bytes, session_from_bytes

MESSAGES = REGISTRY.command_types | REGISTRY.activity_types
# NUL, ends of lines, escape, DEL, C1, half a character, every control of bidirectional text, zero
# width, a tag: a name with one of them looks like another, or as if it were turned round
HIDDEN_SAMPLES = "\0\n\r\t\x1b\x7f\x85\ud800\u2028\u2029\u061c\u200e\u200f"
HIDDEN_SAMPLES += "\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069"
HIDDEN_SAMPLES += "\u200b\ufeff\u00ad\U000e0041"
# for each plain type, what JSON can send that is of another one, and what fits
WRONG = {
    int: ["1", True, 1.0, 1.5, [1], {}],
    float: ["60", True, False, [1.0], {}],
    bool: ["yes", "true", 1, 0, 1.0, [True], {}],
    str: [1, 1.5, True, ["a"], {}, *(f"a{c}b" for c in HIDDEN_SAMPLES)],
}
FITS = {int: [1], float: [1, 1.5], bool: [True, False], str: ["1"]}


def values(hint, words):
    """Return values that fit a field, and pairs of a wrong value and where it is wrong.

    ``words`` are the limits that the field was declared with; those of lists count here.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        kept = [option for option in arguments if option is not NoneType]
        assert len(kept) == 1, "a field with several kinds needs a rule"
        fits, wrong = values(kept[0], words)
        return [None, *fits], wrong
    if origin is Literal:
        return list(arguments), [(value, ()) for value in (1, True, None, "no such choice", [])]
    if origin is tuple:
        endless = arguments[-1] is Ellipsis
        kinds = arguments[:1] if endless else arguments
        inside = [values(kind, words.get(INNER, {})) for kind in kinds]
        good = [fits[0] for fits, _ in inside]
        wrong = [(value, ()) for value in ("1", 1, {}, True, None)]
        wrong += [] if endless else [([*good, good[0]], ()), (good[1:], ())]
        for place, (_, bad) in enumerate(inside):
            for value, deeper in bad:
                wrong.append(([*good[:place], value, *good[place + 1 :]], (place, *deeper)))
        fits = [good, tuple(good)] + ([[], good * 3] if endless else [])
        if endless:
            least, most = words.get("minItems", 0), words["maxItems"]
            wrong += [(good * (most + 1), ())] + ([(good * (least - 1), ())] if least else [])
            fits = [value for value in fits if least <= len(value) <= most]
        return fits, wrong
    return FITS[hint], [(value, ()) for value in (*WRONG[hint], None)]


def cases():
    """Return (message, field, annotation) for every field of every message."""
    found = []
    for name, kind in MESSAGES.items():
        hints = get_type_hints(kind)
        for field in dataclasses.fields(kind):
            where = f"{name}.{field.name}"
            found.append(pytest.param(kind, field.name, hints[field.name], id=where))
    return found


@pytest.mark.parametrize(("kind", "field", "hint"), cases())
def test_a_field_takes_its_type_and_nothing_else(kind, field, hint):
    fits, wrong = values(hint, limits_of(kind)[field])
    optional = None in fits
    for value in fits:
        assert list(misfits({field: value}, kind)) == [], value
    for value, place in wrong:
        if value is None and optional:
            continue
        found = [misfit.path for misfit in misfits({field: value}, kind)]
        assert found == [(field, *place)], value


@pytest.mark.parametrize(("kind", "field", "hint"), cases())
def test_python_is_refused_the_same(kind, field, hint):
    fits, wrong = values(hint, limits_of(kind)[field])
    hints, limits = get_type_hints(kind), limits_of(kind)
    good = {name: values(hints[name], words)[0][0] for name, words in limits.items()}
    for value, _ in wrong:
        if value is None and None in fits:
            continue
        message = object.__new__(kind)  # its own check may refuse it sooner, with fewer words
        for name in good:
            object.__setattr__(message, name, value if name == field else good[name])
        with pytest.raises(InvalidInputError, match=f"{kind.__name__} /{field}"):
            require_exact(message)


def test_a_workbench_refuses_what_is_lax_and_changes_nothing():
    bench = new_workbench(Session())
    with pytest.raises(InvalidInputError, match="rate_hz must be a number, not True"):
        bench.dispatch(SetTracker(rate_hz=True))
    with pytest.raises(InvalidInputError, match=r"/joints_deg/0: expected a number"):
        bench.start(StartRobotMove(("0", 0, 0, 0, 0, 0)))
    with pytest.raises(InvalidInputError, match=r"/joints_deg: expected 6 values, not 5"):
        bench.run(StartRobotMove((0, 0, 0, 0, 0)))
    assert (bench.store.revision, bench.jobs.all()) == (0, ())
    bench.dispatch(SetSeed(int(np.int64(3))))
    bench.close()


def test_all_faults_are_found_and_unknown_fields_named():
    body = {"joints_deg": [0, True, 0.5, "1", float("nan"), 10**400], "speed": 1}
    found = [(misfit.path, misfit.code) for misfit in misfits(body, StartRobotMove)]
    assert found == [
        (("joints_deg", 1), "float_type"),
        (("joints_deg", 3), "float_type"),
        (("joints_deg", 4), "finite_number"),
        (("joints_deg", 5), "finite_number"),
        (("speed",), "extra_forbidden"),
    ]
    assert [misfit.path for misfit in misfits([], StartRobotMove)] == [()]


def test_text_of_every_script_is_taken():
    for name in ("Schädel 7", "颅骨", "جمجمة", "گل\u200cها", "क्\u200dष", "🧑\u200d⚕️", "a & <b>"):
        assert not hidden_characters(name)
        assert list(misfits({"name": name}, RenameSession)) == []


@pytest.mark.parametrize("character", HIDDEN_SAMPLES)
def test_a_name_shows_every_character_wherever_it_comes_from(character, tmp_path):
    name = f"sk{character}ull"
    hub = build_registry(tmp_path, processes=False)
    for attempt in (
        lambda: hub.create(name),
        lambda: hub.create().dispatch(RenameSession(name)),
        lambda: hub.open_file(name),
        lambda: hub.save(file=name),
        lambda: plain_name(name),
        lambda: StartSkullImport(file=name),
    ):
        with pytest.raises(InvalidInputError) as refused:
            attempt()
        assert character not in str(refused.value)
    hub.close_all()
    if character != "\ud800":  # no file can hold it
        foreign = session_from_bytes(session_bytes(Session(name=name)))
        assert foreign.name == "sk\ufffdull"
