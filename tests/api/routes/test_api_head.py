"""What the marker on the head tells, over REST."""

import pytest

from rona_core.app.procedure import run_procedure
from rona_core.app.steps.setup.messages import SetRegion, SetWorld
from tests.app.scan.test_watched_head import TO_SCAN


def require_shifts(told):
    assert [shift["capture"] for shift in told["shifts"][:3]] == ["surface", "path", "scan"]
    scan = told["shifts"][2]
    assert scan["state"] in ("still", "moved")
    assert len(scan["shift_mm"]) == len(scan["sigma_mm"]) == 3
    assert scan["range_mm"] > 0.0
    assert "step 4" in told["sentence"]


def test_the_head_of_the_demo_session_is_told(client, at):
    assert at("GET", "/robot/head").json() is None
    demo = client.post("/sessions/demo").json()["id"]
    require_shifts(client.get(f"/sessions/{demo}/robot/head").json())
    client.delete(f"/sessions/{demo}")


@pytest.mark.ci
def test_the_head_of_each_capture_is_told(web, session, at):
    bench = web.hub.get(session)
    bench.dispatch(SetWorld(profile="nominal", head_drift_mm=0.3))
    bench.dispatch(SetRegion(radius_mm=12.0))
    assert run_procedure(bench, TO_SCAN).failed_step is None
    told = at("GET", "/robot/head").json()
    require_shifts(told)
    assert len(told["shifts"]) == 3
