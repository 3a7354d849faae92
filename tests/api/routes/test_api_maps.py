"""Files of step 9 over REST: the echo volume and draws of the maps, and what of them is refused."""

import io

import nrrd
import numpy as np
import pytest
import trimesh

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.steps.maps.comparison import compare_maps
from rona_core.app.steps.maps.inputs import drawn_maps
from rona_core.app.steps.maps.volume import echo_volume
from tests.scenes.map_ct import ct_of

pytestmark = pytest.mark.usefixtures("readers_here")


@pytest.fixture(scope="module")
def demo(client):
    made = client.post("/sessions/demo").json()
    yield made["id"]
    client.delete(f"/sessions/{made['id']}")


def test_the_volume_is_the_one_that_a_script_gets(web, client, demo):
    answer = client.get(f"/sessions/{demo}/volume")
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/octet-stream"
    assert "echo_volume.nrrd" in answer.headers["content-disposition"]
    file = io.BytesIO(answer.content)
    header = nrrd.read_header(file)
    volume = echo_volume(web.hub.get(demo).session)
    np.testing.assert_array_equal(nrrd.read_data(header, file), volume.amplitude)
    assert (header["compounding"], header["interpolation"]) == ("mean", "linear")


def test_a_finer_grid_and_no_filling_can_be_asked_for(client, demo):
    wanted = {"depth_step_mm": 0.5, "fill_radius_mm": 0}
    coarse = nrrd.read_header(
        io.BytesIO(client.get(f"/sessions/{demo}/volume", params=wanted).content)
    )
    assert np.linalg.norm(coarse["space directions"][2]) == pytest.approx(0.5)
    assert coarse["fill radius (mm)"] == "0"


@pytest.mark.parametrize(
    ("name", "value"),
    [("depth_step_mm", "0"), ("depth_step_mm", "2"), ("depth_step_mm", "nan")]
    + [("fill_radius_mm", "-1"), ("fill_radius_mm", "inf"), ("fill_radius_mm", "many")],
)
def test_what_is_out_of_range_is_refused_by_name(client, demo, name, value):
    answer = client.get(f"/sessions/{demo}/volume", params={name: value})
    assert answer.status_code == 422
    assert name in answer.text


def test_without_maps_it_says_what_to_do_first(at):
    answer = at("GET", "/volume")
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")
    assert "scan" in answer.json()["detail"]


def test_draws_of_the_maps_are_those_that_a_script_gets(web, client, demo):
    wanted = {"count": 4, "seed": 3, "same_robot": True}
    answer = client.get(f"/sessions/{demo}/maps/draws", params=wanted)
    assert answer.status_code == 200, answer.text
    draws = drawn_maps(web.hub.get(demo).session, 4, 3, same_robot=True)
    with np.load(io.BytesIO(answer.content)) as got:
        assert set(got) == {"T_base_map", "u_mm", "v_mm", "ok", "outer_mm", "inner_mm"}
        np.testing.assert_allclose(got["outer_mm"], draws.outer_mm, atol=1e-5)
        np.testing.assert_allclose(got["inner_mm"], draws.inner_mm, atol=1e-5)
        np.testing.assert_array_equal(got["T_base_map"], draws.maps.outer.T_base_map.matrix())
        assert got["outer_mm"].shape == (4, len(got["u_mm"]), len(got["v_mm"]))


@pytest.mark.parametrize("wanted", [{"count": 0}, {"count": 1001}, {"seed": -1}])
def test_draws_out_of_bounds_are_refused(client, demo, wanted):
    answer = client.get(f"/sessions/{demo}/maps/draws", params=wanted)
    assert (answer.status_code, answer.json()["code"]) == (422, "invalid_input")


def test_draws_of_no_maps_are_refused(at):
    answer = at("GET", "/maps/draws")
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")
    assert "compute the maps" in answer.json()["detail"]


def test_an_exported_file_is_the_one_that_a_script_gets(web, client, demo, at):
    answer = client.get(f"/sessions/{demo}/export/bone.stl")
    assert answer.status_code == 200, answer.text
    assert answer.content == REGISTRY.export(web.hub.get(demo).session, "bone.stl")
    assert 'filename="bone.stl"' in answer.headers["content-disposition"]
    answer = client.get(f"/sessions/{demo}/export/bone.stp")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
    assert "maps.zip, outer.ply" in answer.json()["detail"]
    answer = at("GET", "/export/maps.csv")
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")


def compared(web, client, demo, name, data, **options):
    """Upload a reference, compare the maps with it, and return how the job stands at its end."""
    client.post(f"/sessions/{demo}/uploads", params={"name": name}, content=data)
    body = {"file": name, **options}
    answer = client.post(f"/sessions/{demo}/jobs/StartComparison", json=body)
    assert answer.status_code == 202, answer.text
    web.hub.get(demo).jobs.wait(answer.json()["id"], 120)
    return client.get(f"/jobs/{answer.json()['id']}").json()


@pytest.mark.ci
def test_maps_are_compared_with_the_true_bone_and_with_a_file(web, client, demo, at):
    path = f"/sessions/{demo}/maps/comparison"
    truth = client.get(path).json()
    assert (truth["reference"], truth["registration"]) == ("true bone", None)
    rows = {row["name"]: row for row in truth["figures"]}
    assert 0.0 < rows["outer"]["rms_mm"] < 0.5
    mesh = REGISTRY.export(web.hub.get(demo).session, "bone.ply")
    found = compared(web, client, demo, "bone.ply", mesh, register="surface")["result"]
    wanted = compare_maps(web.hub.get(demo).session, mesh, "bone.ply", "surface")
    assert found["reference"] == "bone.ply"
    assert found["figures"][0]["rms_mm"] == pytest.approx(wanted.figures[0].rms_mm, abs=1e-9)
    np.testing.assert_allclose(found["registration"]["T_base_mesh"], np.eye(4), atol=0.1)
    assert at("GET", "/maps/comparison").json()["code"] == "step_blocked"
    answer = at("POST", "/jobs/StartComparison", json={"file": "bone.ply"})
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")


@pytest.mark.slow
def test_maps_are_compared_with_a_ct_at_its_threshold(web, client, demo):
    ct = ct_of(web.hub.get(demo).session.results.maps.value)
    refused = compared(web, client, demo, "head.nii", ct)
    assert (refused["state"], refused["error_code"]) == ("failed", "invalid_input")
    assert "give the threshold" in refused["error"]
    found = compared(web, client, demo, "head.nii", ct, threshold=750)["result"]
    assert found["figures"][0]["p95_mm"] < 0.1  # a fifth of a voxel


@pytest.mark.sweep(2)
@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("bone.gif", {}, "expected one of"),
        ("ball.ply", {"register": "points"}, "points in both frames"),
        ("ball.ply", {"register": "points", "points_base_mm": [[1, 2, 3]] * 3}, "points"),
        ("ball.ply", {}, "is it in the frame of the robot's base?"),
    ],
)
def test_a_comparison_that_cannot_be_is_refused_by_name(web, client, demo, name, options, words):
    ball = trimesh.creation.icosphere(subdivisions=1, radius=50.0).export(file_type="ply")
    refused = compared(web, client, demo, name, ball, **options)
    assert (refused["state"], refused["result"]) == ("failed", None)
    assert refused["error_code"] in ("invalid_input", "degenerate_geometry")
    assert words in refused["error"]


def test_a_comparison_with_what_was_not_uploaded_says_so(web, client, demo):
    started = client.post(f"/sessions/{demo}/jobs/StartComparison", json={"file": "none.ply"})
    ended = web.hub.get(demo).jobs.wait(started.json()["id"], 60)
    assert (ended.state, ended.error_code) == ("failed", "not_found")
    assert "upload it first" in ended.error
