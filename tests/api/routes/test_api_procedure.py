"""What to do now, over REST: proposed stages, why, and messages that are sent as they come."""

import pytest

from rona_core.app.procedure import OFFERED, PROCEDURE
from rona_core.app.steps.setup.messages import SetRobot
from rona_ui.api.routes.procedure import get_next
from tests.app.maps.further import covering
from tests.scenes import demo_parts


@pytest.fixture(scope="module")
def demo(client):
    opened = client.post("/sessions/demo").json()["id"]
    yield opened
    client.delete(f"/sessions/{opened}")


def send(client, session, stage):
    """Send the message of a stage as it was offered; return its name."""
    message = stage["message"]
    address = f"/sessions/{session}/{message['kind']}/{message['name']}"
    answer = client.post(address, json=message["arguments"])
    assert answer.is_success, answer.text
    if message["kind"] == "jobs":
        with client.stream("GET", f"/jobs/{answer.json()['id']}/events") as stream:
            last = [line for line in stream.iter_lines() if line.startswith("data")][-1]
        assert '"state":"done"' in last, last
    return message["name"]


def lead(client, session, skip):
    """Send what is next until nothing is; return the names of the messages."""
    sent = []
    while stage := client.get(f"/sessions/{session}/next", params={"skip": skip}).json():
        sent.append(send(client, session, stage))
        assert len(sent) <= len(PROCEDURE), sent
    return sent


def test_an_empty_session_begins_with_the_tool_and_lists_all_stages(at):
    stage = at("GET", "/next").json()
    assert (stage["name"], stage["state"], stage["offered"]) == ("tool", "missing", "")
    assert stage["remedy"] == "record the tool motion (step 2)"
    assert stage["message"]["kind"] == "jobs"
    assert stage["message"]["arguments"]["n_pivot"] == 30
    listed = at("GET", "/procedure").json()
    assert [one["name"] for one in listed] == [one.name for one in PROCEDURE]
    assert {one["name"] for one in listed if one["offered"]} == set(OFFERED)
    assert all(one["reason"] and one["remedy"] for one in listed)


def test_only_what_is_offered_may_be_skipped(at):
    refused = at("GET", "/next", params={"skip": ["gauge", "roll"]})
    assert refused.status_code == 422
    assert "caliper" in refused.json()["detail"]


def test_nothing_is_next_where_all_is_done_and_all_that_is_offered_skipped(client, demo):
    assert client.get(f"/sessions/{demo}/next", params={"skip": OFFERED}).json() is None
    done = client.get(f"/sessions/{demo}/procedure").json()
    assert {one["remedy"] for one in done if one["state"] == "usable"} == {None}


@pytest.mark.slow
def test_what_is_next_leads_from_nothing_to_a_placed_bed(client):
    session = client.post("/sessions", json={"name": "next", "seed": 1}).json()["id"]
    skipped = ["caliper", "milling", "rehearsal"]
    sent = lead(client, session, skipped)
    assert sent[:3] == ["StartToolCapture", "StartPointerCapture", "StartSurfaceCapture"]
    assert sent[-2:] == ["StartBurrCapture", "StartBedSearch"]
    bed = client.get(f"/sessions/{session}/results/implant").json()["results"]["bed"]["value"]
    assert bed["refusal"] is None
    faster = {"scan_speed_mm_per_s": SetRobot().scan_speed_mm_per_s + 5.0}
    assert client.post(f"/sessions/{session}/commands/SetRobot", json=faster).is_success
    again = lead(client, session, skipped)
    assert again[:3] == ["StartRollSearch", "StartScan", "StartMapping"]
    assert again[-1] == "StartBedSearch"
    client.delete(f"/sessions/{session}")


def test_hidden_bone_is_next_with_its_reason_and_what_helps_where_all_else_is_done():
    class Bench:
        session = covering(demo_parts.demo(), 0.0)

    stage = get_next(Bench(), skip=list(OFFERED))
    assert (stage.name, stage.state) == ("maps", "bad")
    assert "hides its inner boundary" in stage.reason
    assert "quick look" in stage.remedy
    assert (stage.message.kind, stage.message.name) == ("jobs", "StartQuickLook")
    assert stage.message.arguments == {"lines": 12}
