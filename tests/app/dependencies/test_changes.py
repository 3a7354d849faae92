"""What people read about changes: sentences of the declarations, and no internal name."""

import re
from dataclasses import replace

import pytest

from rona_core.app.declarations.inputs import Input, input_parts
from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.changes import (
    logged,
    sentence,
    title,
    what_changed,
    what_changed_since,
)
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.steps.setup.messages import MoveTracker, SetProbe, SetRobot
from rona_core.compose import new_workbench
from rona_core.session.codec import digest
from rona_core.session.document import LogEntry, Session

RESULTS = tuple(part for step in REGISTRY.steps for part in step.results)
MESSAGES = (*REGISTRY.messages, *REGISTRY.outcomes)
NAMES = {*REGISTRY.captures, *REGISTRY.result_names}


def every_input() -> dict[str, Input[object]]:
    """Return each input of each result, by result and key, those that are not digested too."""
    found = {f"{part.name}, {key}": item for part in RESULTS for key, item in part.inputs.items()}
    for part in RESULTS:
        if part.known is not None:
            known = input_parts(part.known)
            more = {**known.implied, **known.free}
            found |= {f"{part.name}, {key}": item for key, item in more.items()}
    return found


def internal(words: str) -> list[str]:
    """Return what of a sentence is the name of a class, or of a thing in the code."""
    return [
        word
        for word in re.findall(r"\w+", words)
        if "_" in word or (re.search(r"[a-z][A-Z]", word) and word != "SonoPointer")
    ]


@pytest.mark.parametrize(("name", "item"), every_input().items(), ids=list(every_input()))
def test_every_input_has_a_title(name, item):
    for was_missing, is_missing in ((False, False), (True, False), (False, True)):
        words = what_changed(item, was_missing=was_missing, is_missing=is_missing)
        assert re.fullmatch(r"(the|what) .+ (is|are|was|were) .+", words)
        assert not internal(words)
    assert re.fullmatch(r"(the|what) .+", title(item))
    assert title(item).removeprefix("the ").partition(" (")[0] not in NAMES - TITLES


# names of results and captures that are words of the field themselves
TITLES = {"maps", "surface", "scan", "landmarks", "milling"}


@pytest.mark.parametrize("part", [*RESULTS, *REGISTRY.captures.values()], ids=lambda p: p.name)
def test_every_result_and_capture_has_a_clause(part):
    assert re.fullmatch(r"the .+ (was|were) \w+( .+)?", part.done)
    assert not internal(part.done)


@pytest.mark.parametrize("kind", REGISTRY.captures)
def test_every_capture_names_what_it_depends_on(kind):
    words = what_changed_since(kind, None, Session())
    assert re.fullmatch(r"the .+ or the seed was changed since the .+", words)
    assert not internal(words)


@pytest.mark.parametrize("message", MESSAGES)
def test_every_message_has_a_sentence(message):
    words = sentence(message)
    assert re.fullmatch(r"[A-Z][^.]+", words)
    assert not internal(words)
    assert message in REGISTRY.activities or re.search(r" (was|were) ", words)


def test_a_message_of_an_older_version_is_logged_in_words():
    assert logged(LogEntry(1, "PlanSecondPass", {}, "")) == "Plan second pass"
    stored = LogEntry(1, "StoreResult", {"message": "StartGapScan", "values": {"gone": {}}}, "")
    assert logged(stored) == "Start gap scan"


def test_the_log_says_what_was_made(demo):
    lines = [logged(entry) for entry in demo.log]
    assert "The tilted passes were scanned" in lines
    assert "The motion was planned" in lines
    assert not [line for line in lines if internal(line)]


def test_a_changed_setting_is_named_with_its_step(demo):
    slower = new_workbench(demo)
    slower.dispatch(SetRobot(scan_speed_mm_per_s=7.0))
    assert stale_reason("roll", slower.session) == (
        "the scan speed (step 1) was changed since the motion was planned"
    )
    slower.close()


def test_the_log_says_which_part_of_the_set_up_a_capture_lacks(demo):
    bench = new_workbench(demo)
    bench.dispatch(MoveTracker(shift_mm=(5.0, 0.0, 0.0)))  # no scan depends on it
    bench.dispatch(SetProbe(name="1MHz"))
    for name in ("capture scan", "detection", "maps"):
        assert stale_reason(name, bench.session) == (
            "the probe (step 1) was changed since the scan was recorded"
        )
    bare = replace(bench.session, log=())
    assert stale_reason("capture scan", bare) == what_changed_since("scan", None, Session())
    bench.close()


def test_what_is_made_anew_or_gone_is_said(demo):
    fewer = replace(demo, captures=replace(demo.captures, second=demo.captures.second[:2]))
    assert stale_reason("second_detection", fewer) == (
        "the tilted passes were scanned anew (step 9) since the boundaries of the tilted passes "
        "were detected"
    )
    bare = replace(demo, results=replace(demo.results, speed=None))
    assert stale_reason("maps", bare) == (
        "the calibration of the speed of sound (step 9) was removed or became out of date since "
        "the maps were computed"
    )
    before = replace(demo.results.maps, inputs={**demo.results.maps.inputs, "speed": digest(None)})
    first = demo.with_result("maps", before)
    assert stale_reason("maps", first) == (
        "the calibration of the speed of sound was computed (step 9) since the maps were computed"
    )
