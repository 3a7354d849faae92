"""Captures go stale by the part of the set-up that they were taken with, and by no other."""

from dataclasses import replace
from pathlib import Path

import pytest

from rona_core.app.dependencies.staleness import capture_setup_digest, stale_reason
from rona_core.devices.settings import TrackerSettings
from rona_core.session.codec import digest
from rona_core.session.document import Session
from rona_core.session.files import load_session, session_bytes, session_from_bytes

TESTS = Path(__file__).parents[2]
DEMO = TESTS.parent / "sessions" / "demo.rona"
PLAIN = TrackerSettings(stereo=False, occlusion=False)


def with_tracker(session, tracker):
    devices = replace(session.setup.devices, tracker=tracker)
    return replace(session, setup=replace(session.setup, devices=devices))


@pytest.mark.parametrize("path", [DEMO, *sorted((TESTS / "sessions").glob("*.rona"))], ids=str)
def test_a_stored_session_is_saved_as_it_was(path):
    session = load_session(path)
    assert digest(session_from_bytes(session_bytes(session))) == digest(session)


def test_the_demo_session_loads_and_none_of_its_captures_is_stale():
    session = session_from_bytes(DEMO.read_bytes())
    for kind in ("tool", "pointer", "surface", "path", "scan"):
        assert stale_reason(f"capture {kind}", session) is None


@pytest.mark.parametrize(
    "change", [{"stereo": True}, {"occlusion": True}, {"latency_ms": 5.0}, {"drift_mm": 0.1}]
)
def test_another_fault_makes_captures_of_the_tracker_stale_and_no_others(change):
    old = with_tracker(Session(), PLAIN)
    new = with_tracker(Session(), replace(PLAIN, **change))
    for kind in ("tool", "pointer", "surface", "path"):
        assert capture_setup_digest(kind, new) != capture_setup_digest(kind, old)
    assert capture_setup_digest("scan", new) == capture_setup_digest("scan", old)


def test_covering_a_tool_makes_no_capture_stale():
    old, new = (
        with_tracker(Session(), TrackerSettings(hidden_tools=hidden))
        for hidden in ((), ("toolmarker",))
    )
    assert capture_setup_digest("tool", new) == capture_setup_digest("tool", old)
