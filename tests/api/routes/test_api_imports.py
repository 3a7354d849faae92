"""Recordings over REST: download a capture, upload it, and have it back as another one."""

import json

import numpy as np
import pytest

from rona_core.devices.files.poses.sequences import read_igs_mha

QUICK = {"cone_deg": 25.0, "duration_s": 3.0}


def finished(web, answer):
    assert answer.status_code == 202, answer.text
    job = answer.json()
    return web.hub.get(job["session"]).jobs.wait(job["id"], 120)


def upload(at, name, data):
    assert at("POST", "/uploads", params={"name": name}, content=data).status_code == 201


@pytest.fixture
def pivot(at, web):
    """The file of a pivot that was measured here."""
    finished(web, at("POST", "/jobs/StartPointerCapture", json=QUICK))
    answer = at("GET", "/captures/1/file", params={"format": "igs.mha"})
    assert answer.status_code == 200
    assert answer.headers["content-type"] == "application/octet-stream"
    assert "test_1_pointer6d.igs.mha" in answer.headers["content-disposition"]
    return answer.content


def test_a_capture_leaves_and_comes_back(at, web, pivot):
    track = read_igs_mha(pivot).track("pointer6d")
    before = at("GET", "/results/pointer").json()
    held = before["captures"]["pointer"]["value"]["marker"]
    assert held["times_s"] == track.times_s.tolist()
    upload(at, "back.igs.mha", pivot)
    body = {"file": "back.igs.mha", "purpose": "pivot"}
    assert finished(web, at("POST", "/jobs/StartRecordingImport", json=body)).state == "done"
    after = at("GET", "/results/pointer").json()
    assert after["results"]["pointer"]["value"] == before["results"]["pointer"]["value"]
    assert [c["ordinal"] for c in at("GET", "").json()["captures"]] == [1, 2]
    tips = {row["key"]: row["value"] for row in at("GET", "/quality").json()}
    assert tips["pointer_tip_error_mm"] is None


def test_a_pivot_of_markers_with_their_geometry(at, web):
    tip, body = np.array([5.0, 150.0, -30.0]), np.array([[0, 0, 0], [80, 0, 0], [20, 60, 0.0]])
    rng = np.random.default_rng(0)
    rows = ["frame,marker,x,y,z"]
    for i in range(40):
        angle = rng.uniform(-0.5, 0.5, 3)
        rotation = np.linalg.qr(np.eye(3) + np.cross(np.eye(3), angle))[0]
        rotation *= np.sign(np.diag(rotation))
        if np.linalg.det(rotation) < 0:
            continue
        points = (body - tip) @ rotation.T + (0.0, 0.0, 1500.0)
        rows += [f"{i},{k},{p[0]!r},{p[1]!r},{p[2]!r}" for k, p in enumerate(points.tolist())]
    upload(at, "m.csv", "\n".join(rows).encode())
    upload(at, "t.csv", b"marker,x,y,z\n0,0,0,0\n1,80,0,0\n2,20,60,0")
    wanted = {"files": ["m.csv"], "geometry": "t.csv"}
    assert finished(web, at("POST", "/jobs/StartPivotImport", json=wanted)).state == "done"
    found = at("GET", "/results/pointer").json()["results"]["pointer"]["value"]
    assert found["tip_pointermarker"] == pytest.approx(tip.tolist(), abs=1e-6)
    assert found["pivot_tracker"] == pytest.approx([0.0, 0.0, 1500.0], abs=1e-6)


def test_refusals_are_problems(at, web, pivot):
    for path, status, code in (
        ("/captures/7/file", 404, "not_found"),
        ("/captures/x/file", 422, "invalid_input"),
        ("/captures/1/file?format=csv", 422, "invalid_input"),
    ):
        answer = at("GET", path)
        assert (answer.status_code, answer.json()["code"]) == (status, code)
    for body in ({}, {"file": "../x"}, {"file": "x", "purpose": "tool"}, {"file": "x", "y": 1}):
        assert at("POST", "/jobs/StartRecordingImport", json=body).status_code == 422
    for body in ({}, {"files": []}, {"files": "x"}, {"files": ["a/b"]}):
        assert at("POST", "/jobs/StartPivotImport", json=body).status_code == 422
    blocked = at("POST", "/jobs/StartRecordingImport", json={"file": "x", "purpose": "path"})
    assert (blocked.status_code, blocked.json()["code"]) == (409, "step_blocked")
    upload(at, "cut.igs.mha", pivot[:-3])
    ended = finished(web, at("POST", "/jobs/StartRecordingImport", json={"file": "cut.igs.mha"}))
    assert (ended.state, ended.error_code) == ("failed", "invalid_input")
    assert ended.error.startswith("cut.igs.mha is damaged: expected")


def test_while_a_recording_plays_the_program_says_replay(at, web, client, pivot, monkeypatch):
    told = []
    bench = web.hub.get()
    genuine = bench.live.put

    def put(**parts):
        genuine(**parts)
        if parts.get("origin") and not told:
            told.append(client.get("/status").json()["origin"])

    monkeypatch.setattr(bench.live, "put", put)
    upload(at, "p.igs.mha", pivot)
    body = {"file": "p.igs.mha", "play": True}
    assert finished(web, at("POST", "/jobs/StartRecordingImport", json=body)).state == "done"
    assert told == ["REPLAY"]
    assert client.get("/status").json()["origin"] == "VIRTUAL"


def test_the_document_names_the_formats(client):
    document = json.dumps(client.get("/openapi.json").json()["paths"])
    assert "igs.mha" in document
