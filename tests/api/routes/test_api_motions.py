"""Motions over REST: certified ones as files, and the verdict on one that was uploaded."""

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.session.codec import digest


@pytest.fixture(scope="module")
def session(client):
    made = client.post("/sessions/demo").json()["id"]
    yield made
    client.delete(f"/sessions/{made}")


def test_a_motion_is_downloaded_in_each_format(client, web, session):
    bench = web.hub.get(session)
    for ending in ("csv", "json", "yaml"):
        answer = client.get(f"/sessions/{session}/roll/motion", params={"format": ending})
        assert answer.content == REGISTRY.export(bench.session, f"scan_motion.{ending}")
        assert f"scan_motion.{ending}" in answer.headers["content-disposition"]
    assert client.get(f"/sessions/{session}/implant/motion").status_code == 200
    refused = client.get(f"/sessions/{session}/roll/motion", params={"format": "script"})
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid_input")
    assert client.get(f"/sessions/{session}/maps/motion").status_code == 422
    assert client.get(f"/sessions/{session}/roll/motion?format=val3").status_code == 422


def test_an_uploaded_motion_is_judged(client, web, session):
    data = REGISTRY.export(web.hub.get(session).session, "scan_motion.json")
    upload = client.post(f"/sessions/{session}/uploads", params={"name": "scan.json"}, content=data)
    assert upload.status_code == 201
    at = f"/sessions/{session}/motion/verdict"
    found = client.get(at, params={"file": "scan.json"}).json()
    assert (found["certified"], found["samples"]) == (True, 1944)
    assert "head" in found["obstacles"]
    alone = client.get(at, params={"file": "scan.json", "obstacles": "self", "robot": "ur5"}).json()
    assert not alone["certified"] or alone["robot"] == "ur5"
    picture = client.get(at, params={"file": "scan.json", "format": "svg"})
    assert picture.headers["content-type"].startswith("image/svg+xml")
    for params, status in (
        ({"file": "none.csv"}, 422),
        ({"file": "../x"}, 422),
        ({}, 422),
        ({"file": "scan.json", "robot": "ur7"}, 422),
        ({"file": "scan.json", "interpolation": "cubic"}, 422),
    ):
        assert client.get(at, params=params).status_code == status, params


@pytest.mark.slow
def test_captures_come_back_over_rest(client, web, session):
    data = client.get(f"/sessions/{session}/export/captures.h5").content
    bench = web.hub.get(session)
    setup = bench.session.setup
    made = client.post("/sessions", json={"name": "mine", "seed": setup.seed}).json()["id"]
    try:
        at = f"/sessions/{made}"
        assert (
            client.post(f"{at}/uploads", params={"name": "c.h5"}, content=data).status_code == 201
        )
        body = {"file": "c.h5", "only": ["pointer"]}
        job = client.post(f"{at}/jobs/StartImport", json=body)
        assert job.status_code == 202
        assert web.hub.get(made).jobs.wait(job.json()["id"], 120).state == "done"
        back = web.hub.get(made).session
        tracks = [one.captures.pointer.marker for one in (back, bench.session)]
        assert digest(tracks[0]) == digest(tracks[1])
        tips = [one.results.pointer.value.tip_pointermarker for one in (back, bench.session)]
        np.testing.assert_allclose(*tips, atol=1e-6)  # another processor made the demo session
    finally:
        client.delete(f"/sessions/{made}")
