"""Sessions of schema 1 knew no faults of the tracker: they load, with all of them off."""

import io
import json
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from rona_core.app.dependencies.staleness import capture_setup_digest, stale_reason
from rona_core.devices.settings import FIRST_PLACE, TrackerPlace, TrackerSettings
from rona_core.errors import SessionFormatError
from rona_core.session.codec import decode, digest
from rona_core.session.document import Session
from rona_core.session.files import session_bytes, session_from_bytes
from rona_core.session.migrate import PLAIN_TRACKER, from_1

DEMO = Path(__file__).parents[3] / "sessions" / "demo.rona"
PLAIN = TrackerSettings(stereo=False, occlusion=False)


def as_schema_1(session, change=lambda tracker: None):
    """The bytes of a session as a program of schema 1 wrote them."""
    with zipfile.ZipFile(io.BytesIO(session_bytes(session))) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    manifest = json.loads(members["manifest.json"])
    manifest["schema"] = 1
    tracker = manifest["session"]["setup"]["devices"]["tracker"]
    for name in PLAIN_TRACKER:
        del tracker[name]
    change(manifest["session"]["setup"]["devices"])
    members["manifest.json"] = json.dumps(manifest).encode()
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return out.getvalue()


def with_tracker(session, tracker):
    devices = replace(session.setup.devices, tracker=tracker)
    return replace(session, setup=replace(session.setup, devices=devices))


def test_an_old_session_loads_as_the_same_with_all_faults_off():
    old = with_tracker(Session(name="old"), replace(PLAIN, profile="white035", rate_hz=30.0))
    back = session_from_bytes(as_schema_1(old))
    assert back.setup.devices.tracker == replace(PLAIN, profile="white035", rate_hz=30.0)
    assert digest(back) == digest(old)


def test_the_step_fills_every_field_that_is_new_and_changes_nothing_else():
    manifest = {
        "schema": 1,
        "session": {
            "setup": {"seed": 4, "devices": {"tracker": {"rate_hz": 20.0}, "robot": 1}},
            "captures": {
                "tool": {"marker": 6},
                "pointer": None,
                "surface": [{"marker": 7}],
                "path": None,
                "scan": {"scans": 8},
            },
            "archive": [{"marker": 6}, {"marker": 7}, {"scans": 8}],
            "results": {"tool": 1, "pointer": 2, "surface": 3, "smoothing": 4, "maps": 5},
        },
    }
    before = json.dumps(manifest)
    migrated = from_1(manifest)
    assert json.dumps(manifest) == before
    tracker = migrated["session"]["setup"]["devices"].pop("tracker")
    assert tracker == {"rate_hz": 20.0, **PLAIN_TRACKER}
    assert migrated["session"]["setup"] == {
        "seed": 4,
        "devices": {"robot": 1},
        "use_base_marker": True,
    }
    place = {"$type": "TrackerPlace", "shift_mm": [0.0, 0.0, 0.0], "turn_deg": 0.0}
    assert decode(PLAIN_TRACKER["place"], TrackerPlace, {}) == FIRST_PLACE
    assert TrackerSettings(**{**PLAIN_TRACKER, "place": FIRST_PLACE}) == PLAIN
    new = {"base": None, "tracker_place": place}
    assert migrated["session"]["captures"] == {
        "tool": {"marker": 6, **new},
        "pointer": None,
        "surface": [{"marker": 7, **new}],
        "path": None,
        "scan": {"scans": 8},
    }
    assert migrated["session"]["archive"] == [
        {"marker": 6, **new},
        {"marker": 7, **new},
        {"scans": 8},
    ]
    gone = {"tool": None, "pointer": None, "smoothing": None}
    new = {"registration": None}
    assert migrated["session"]["results"] == {"surface": 3, "maps": 5, **gone, **new}
    assert migrated["schema"] == 2


def test_an_old_file_without_a_tracker_is_refused_by_name():
    data = as_schema_1(Session(), lambda devices: devices.pop("tracker"))
    with pytest.raises(SessionFormatError, match="tracker"):
        session_from_bytes(data)


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
