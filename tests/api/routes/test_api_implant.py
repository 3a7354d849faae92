"""Files of step 10 over REST: the milling path, the bed, and what of them is refused."""

import io

import numpy as np
import pytest
import trimesh

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.runtime.session_step import Undo
from rona_core.app.steps.implant.messages import PlaceBed
from rona_core.app.steps.implant.view import milling_view


@pytest.fixture(scope="module")
def demo(client):
    made = client.post("/sessions/demo").json()
    yield made["id"]
    client.delete(f"/sessions/{made['id']}")


def test_the_path_is_a_table_with_a_row_for_each_place(web, client, demo):
    answer = client.get(f"/sessions/{demo}/export/bed_path.csv")
    assert answer.status_code == 200, answer.text
    assert "bed_path.csv" in answer.headers["content-disposition"]
    milling = milling_view(web.hub.get(demo).session)
    rows = np.genfromtxt(
        io.StringIO(answer.text), delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    tips = np.column_stack([rows[name] for name in ("x_mm", "y_mm", "z_mm")])
    np.testing.assert_allclose(tips, milling.path.tips_bed, atol=1e-4)
    np.testing.assert_allclose(rows["feed_mm_per_s"], milling.feeds_mm_per_s, rtol=1e-5)


def test_the_path_is_g_code_where_that_is_asked_for(web, client, demo):
    answer = client.get(f"/sessions/{demo}/export/bed_path.gcode")
    assert "bed_path.gcode" in answer.headers["content-disposition"]
    assert answer.content == REGISTRY.export(web.hub.get(demo).session, "bed_path.gcode")
    lines = answer.text.splitlines()
    assert {"G21", "G90"} <= set(lines)
    assert lines[-1] == "M30"
    refused = client.get(f"/sessions/{demo}/export/bed_path.step")
    assert (refused.status_code, refused.json()["code"]) == (404, "not_found")
    assert "bed_path.gcode" in refused.text


def test_the_bed_is_a_closed_body_where_the_implant_goes(web, client, demo):
    answer = client.get(f"/sessions/{demo}/export/bed.stl")
    assert "bed.stl" in answer.headers["content-disposition"]
    body = trimesh.load(io.BytesIO(answer.content), file_type="stl")
    assert body.is_watertight
    milling = milling_view(web.hub.get(demo).session)
    cell_mm2 = (milling.bed.x_mm[1] - milling.bed.x_mm[0]) ** 2
    assert body.volume == pytest.approx(milling.bed.depth_mm.sum() * cell_mm2, rel=0.05)
    off = milling.placed.T_base_bed.inv() @ body.vertices
    assert np.abs(off[:, :2].mean(axis=0)).max() < 0.5


def test_markups_of_the_bed_are_in_the_frame_of_the_base(web, client, demo):
    answer = client.get(f"/sessions/{demo}/export/bed.mrk.json")
    assert "bed.mrk.json" in answer.headers["content-disposition"]
    placed = milling_view(web.hub.get(demo).session).placed
    *_, last = answer.json()["markups"]
    np.testing.assert_allclose(last["controlPoints"][0]["position"], placed.thinnest_base)


@pytest.mark.parametrize(
    "path", ["/export/bed_path.csv", "/export/bed.stl", "/export/bed.mrk.json"]
)
def test_without_a_bed_it_says_what_to_do_first(at, path):
    answer = at("GET", path)
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")
    assert "place the implant bed (step 10)" in answer.json()["detail"]


def test_a_stale_bed_and_one_outside_of_the_maps_are_refused(client):
    demo = client.post("/sessions/demo").json()["id"]
    laid = client.post(f"/sessions/{demo}/commands/PlaceBed", json={"u_mm": -20.0, "v_mm": 0.0})
    assert laid.status_code == 200, laid.text
    answer = client.get(f"/sessions/{demo}/export/bed_path.csv")
    assert (answer.status_code, answer.json()["code"]) == (409, "step_blocked")
    assert "choose another place" in answer.json()["detail"]
    client.post(f"/sessions/{demo}/undo")
    assert client.get(f"/sessions/{demo}/export/bed_path.csv").status_code == 200
    client.post(f"/sessions/{demo}/commands/SetProbe", json={"name": "1MHz"})
    answer = client.get(f"/sessions/{demo}/export/bed.stl")
    assert (answer.status_code, answer.json()["code"]) == (409, "stale_result")
    assert "stale" in answer.json()["detail"]
    client.delete(f"/sessions/{demo}")


def test_the_motion_of_the_robot_is_given_as_long_as_it_is_of_this_bed(web, client, demo):
    bench = web.hub.get(demo)
    answer = client.get(f"/sessions/{demo}/export/milling_motion.csv")
    assert "milling_motion.csv" in answer.headers["content-disposition"]
    assert answer.content == REGISTRY.export(bench.session, "milling_motion.csv")
    script = client.get(f"/sessions/{demo}/export/milling_motion.script")
    assert (script.status_code, script.json()["code"]) == (422, "invalid_input")
    assert "Universal Robots" in script.text
    at = bench.session.results.get("bed").value.placed.placement
    bench.dispatch(PlaceBed(at.u_mm + 0.5, at.v_mm, float(np.rad2deg(at.angle_rad)), lift_mm=1.0))
    refused = client.get(f"/sessions/{demo}/export/milling_motion.csv")
    assert (refused.status_code, refused.json()["code"]) == (409, "stale_result")
    bench.dispatch(Undo())
    assert client.get(f"/sessions/{demo}/export/milling_motion.csv").content == answer.content
