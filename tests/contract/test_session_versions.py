"""Every session file that a released schema wrote still loads, and its captures still compute.

The files are small sessions taken with seed 3 at 20 frames a second: that of schema 1 up to the
path, that of schema 2 with all steps, that of schema 3 with what can be done beside them too.
"""

import hashlib
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import stale_reason
from rona_core.app.dependencies.step_states import step_states
from rona_core.app.runtime.handling import handle
from rona_core.app.steps.path.messages import BuildPath
from rona_core.app.steps.pointer.messages import CalibratePointer
from rona_core.app.steps.surface.messages import BuildSurface
from rona_core.app.steps.tool.messages import RegisterTool
from rona_core.session.codec import digest
from rona_core.session.files import load_session, session_bytes, session_from_bytes
from rona_core.session.message_migration import (
    CAPTURES_BEFORE_4,
    RENAMED_IN_4,
    RESULTS_BEFORE_4,
    with_present_message,
)
from rona_core.session.migrate import MIGRATIONS, SCHEMA

FILES = sorted((Path(__file__).parent / "sessions").glob("schema_*.rona"))


def manifest_of(path):
    with zipfile.ZipFile(path) as archive:
        return json.loads(archive.read("manifest.json"))


def test_there_is_a_file_and_a_step_for_every_old_schema():
    assert [manifest_of(path)["schema"] for path in FILES] == list(range(1, SCHEMA))
    assert sorted(MIGRATIONS) == list(range(1, SCHEMA))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_an_old_file_loads_with_all_its_captures_and_is_saved_in_the_present_schema(path):
    session = load_session(path)
    captures = session.captures
    assert None not in (captures.tool, captures.pointer, captures.path)
    assert len(captures.surface) == 1
    assert len(captures.pointer.marker.times_s) > 100
    assert [entry.message for entry in session.log][:2] == ["SetSeed", "SetTracker"]
    again = session_from_bytes(session_bytes(session))
    assert digest(again) == digest(session)


def test_choices_that_are_gone_give_way_to_what_takes_their_place():
    for message, argument, old, new in (
        ("CalibratePointer", "method", "aos", "ml"),
        ("SmoothScanPath", "normal_method", "tls", "jet"),
        ("SmoothScanPath", "normal_method", "robust", "jet"),
        ("SmoothScanPath", "normal_method", "ols", "ols"),
    ):
        held = {"message": message, "arguments": {argument: old, "other": [1]}}
        assert with_present_message(held)["arguments"] == {argument: new, "other": [1]}
    assert with_present_message({"message": "SmoothScanPath"}) == {"message": "SmoothScanPath"}


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_a_step_changes_neither_the_manifest_it_is_given_nor_the_captures(path):
    manifest = manifest_of(path)
    before = hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()
    after = MIGRATIONS[manifest["schema"]](manifest)
    assert hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest() == before
    assert after["schema"] == manifest["schema"] + 1
    taken, kept = manifest["session"]["captures"], after["session"]["captures"]
    for name in ("tool", "pointer", "path"):
        assert {key: kept[name][key] for key in taken[name]} == taken[name]
    assert [stroke["marker"] for stroke in kept["surface"]] == [
        stroke["marker"] for stroke in taken["surface"]
    ]
    assert (kept["scan"] is None) == (taken["scan"] is None)
    if taken["scan"] is not None:
        assert kept["scan"].items() >= taken["scan"].items()
    assert len(after["session"]["archive"]) == len(manifest["session"]["archive"])


def test_results_of_schema_1_are_stale_until_the_pointer_is_calibrated_again():
    session = load_session(FILES[0])
    states = {state.name: state.state for state in step_states(session)}
    assert states["tool"] == states["pointer"] == "ready"
    assert states["surface"] == states["path"] == "stale"
    points = session.results.surface.value.points_base
    for command in (RegisterTool("paper"), CalibratePointer("sphere"), BuildSurface(), BuildPath()):
        session = handle(command, session)
    states = {state.name: state.state for state in step_states(session)}
    assert states["pointer"] == states["surface"] == states["path"] == "done"
    np.testing.assert_allclose(session.results.surface.value.points_base, points, atol=1e-6)


def test_plan_and_maps_of_schema_2_are_computed_again_from_its_scan():
    session = load_session(FILES[1])
    assert len(session.captures.scan.scans) == 22
    states = {state.name: state.state for state in step_states(session)}
    assert states["smoothing"] == "done"
    assert states["roll"] == states["maps"] == "ready"


def test_messages_of_schema_3_have_their_present_names_in_log_and_results():
    manifest, session = manifest_of(FILES[2]), load_session(FILES[2])
    public = {**REGISTRY.command_types, **REGISTRY.activity_types}
    with zipfile.ZipFile(FILES[2]) as archive:
        said = [json.loads(line)["message"] for line in archive.read("commands.jsonl").splitlines()]
    log = [entry.message for entry in session.log]
    outcomes = dict.fromkeys(CAPTURES_BEFORE_4, "StoreCapture")
    outcomes |= dict.fromkeys(RESULTS_BEFORE_4, "StoreResult")
    assert log == [{**RENAMED_IN_4, **outcomes}.get(name, name) for name in said]
    stored = [entry.arguments for entry in session.log if entry.message == "StoreCapture"]
    assert {row["capture"]["ordinal"]: row["kind"] for row in stored}[1] == "block"
    computed = [entry.arguments for entry in session.log if entry.message == "StoreResult"]
    assert computed[0]["message"] == "StartRollSearch"
    assert list(computed[0]["values"]) == ["roll"]
    assert not set(RENAMED_IN_4) & (set(log) | set(public))
    assert set(RENAMED_IN_4.values()) <= set(public)
    results = manifest["session"]["results"]
    held = {k: v["message"] for k, v in results.items() if isinstance(v, dict)}
    made = {name: session.results.get(name).message for name in held}
    assert made == {name: RENAMED_IN_4.get(message, message) for name, message in held.items()}
    assert set(made.values()) <= set(public)
    assert made["path"] == "GenerateScanPattern"
    assert made["sono_maps"] == "StartHandheldMapping"
    assert {name for name in REGISTRY.replayed if stale_reason(name, session) is not None} == set()


def test_the_second_pass_of_schema_5_is_the_first_of_the_further_ones_and_nothing_is_stale():
    session = load_session(FILES[4])
    (held,) = session.captures.second
    assert len(held.scans) == len(session.results.second_detection.value) == 144
    names = [name for name in REGISTRY.replayed if session.results.get(name) is not None]
    assert {"second", "second_detection", "maps"} < set(names)
    assert [stale_reason(name, session) for name in names] == [None] * len(names)
    none = manifest_of(FILES[3])
    for schema in (4, 5):
        none = MIGRATIONS[schema](none)
    assert none["session"]["captures"]["second"] == []
