"""Steps 5 and 6 over REST: parameters, patterns and changes by hand; refusals change nothing."""

from pathlib import Path

import pytest

from rona_core.session.files import session_bytes

FILE = Path(__file__).parents[2] / "sessions" / "path.rona"
FIRST = (
    ("RegisterTool", {"method": "paper"}),
    ("CalibratePointer", {"method": "sphere"}),
    ("BuildSurface", {}),
    ("BuildPath", {}),
    ("SmoothScanPath", {"tolerance_mm": 1.5}),
)


def uploaded(client, data):
    opened = client.post("/sessions/upload", content=data)
    assert opened.status_code < 300, opened.text
    return f"/sessions/{opened.json()['id']}"


@pytest.fixture(scope="module")
def smoothed(web, client):
    """The file of a session whose path is smoothed."""
    address = uploaded(client, FILE.read_bytes())
    for name, body in FIRST:
        assert client.post(f"{address}/commands/{name}", json=body).status_code == 200
    data = session_bytes(web.hub.get(address.rpartition("/")[2]).session)
    client.delete(address)
    return data


@pytest.fixture
def address(client, smoothed):
    address = uploaded(client, smoothed)
    yield address
    client.delete(address)


def smoothing(client, address):
    return client.get(f"{address}/results/smoothing").json()["results"]["smoothing"]["value"]


@pytest.mark.sweep(3)
@pytest.mark.parametrize("metric", ["k1", "k2", "k3"])
@pytest.mark.parametrize("method", ["optimal", "fast", "greedy", "rdp"])
def test_every_metric_is_answered_with_the_method_that_was_used(
    client, address, monkeypatch, metric, method
):
    monkeypatch.setattr("rona_core.path.simplification.simplify.MAX_WORK", 1e3)  # a long path
    body = {"metric": metric, "method": method}
    answer = client.post(f"{address}/commands/SmoothScanPath", json=body)
    assert answer.status_code == 200, answer.text
    found = smoothing(client, address)["simplified"]
    assert found["metric"] == metric
    assert found[{"k1": "k1_mm", "k2": "k2_mm", "k3": "k3_mm2"}[metric]] <= 1.0 + 1e-9
    replaced = metric != "k1" and method in ("optimal", "fast")
    assert (f"greedy in place of {method}" in found["rule"]) == replaced
    assert found["method"] == "greedy" or not replaced


def test_the_path_of_the_demo_session_is_smoothed_by_root_mean_square(client):
    demo = client.post("/sessions/demo").json()["id"]
    try:
        body = {"metric": "k2"}  # all else as it is by default
        answer = client.post(f"/sessions/{demo}/commands/SmoothScanPath", json=body)
        assert answer.status_code == 200, answer.text
        found = smoothing(client, f"/sessions/{demo}")["simplified"]
        assert (found["method"], found["exact"]) == ("greedy", False)
        assert found["k2_mm"] <= 1.0 + 1e-9
    finally:
        client.delete(f"/sessions/{demo}")


def test_points_of_the_path_are_moved_and_taken_back_over_rest(client, address):
    before = smoothing(client, address)
    assert before["simplified"]["method"] == "optimal"
    assert before["simplified"]["exact"]
    assert max(before["from_filtered_mm"]) <= 1.5 + 1e-9
    x, y, z = before["corners_base"][2]
    body = {"index": 2, "point_base_mm": [x + 2.0, y, z]}
    assert client.post(f"{address}/commands/MovePathPoint", json=body).status_code == 200
    after = smoothing(client, address)
    assert before["corners_base"][2] not in after["corners_base"]
    assert client.post(f"{address}/undo").status_code == 200
    assert smoothing(client, address) == before


def test_a_change_that_cannot_be_made_is_a_problem_and_changes_nothing(client, address):
    before = smoothing(client, address)
    for name, body, status, code in (
        ("DeletePathPoint", {"index": 999}, 422, "invalid_input"),
        ("MovePathPoint", {"index": 1, "point_base_mm": [0, 0, 0]}, 409, "degenerate_geometry"),
        ("InsertPathPoint", {"after": 0}, 422, "invalid_input"),
        ("GenerateScanPattern", {"kind": "zigzag"}, 422, "invalid_input"),
        ("GenerateScanPattern", {"boundary_base_mm": [[0, 0, 0]]}, 422, "invalid_input"),
    ):
        answer = client.post(f"{address}/commands/{name}", json=body)
        assert (answer.status_code, answer.json()["code"]) == (status, code), name
    assert smoothing(client, address) == before


def test_a_pattern_is_made_smoothed_and_reproduced_over_rest(client, address, replayed):
    body = {"kind": "spiral", "spacing_mm": 5.0, "radius_mm": 15.0}
    assert client.post(f"{address}/commands/GenerateScanPattern", json=body).status_code == 200
    assert client.post(f"{address}/commands/SmoothScanPath", json={}).status_code == 200
    states = {s["name"]: s["state"] for s in client.get(f"{address}/steps").json()}
    assert (states["path"], states["smoothing"], states["roll"]) == ("done", "done", "ready")
    found = replayed(address.rpartition("/")[2])
    same = {r["result"]: r["stored"] == r["recomputed"] for r in found["results"]}
    assert same["path"]
    assert same["smoothing"]
