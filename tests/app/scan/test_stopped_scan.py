"""A scan that was stopped early is partial, not done; the probe is drawn back from the bone."""

from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from rona_core.app.dependencies.judge import step_states
from rona_core.app.dependencies.staleness import session_obstacles
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.maps.messages import StartMapping
from rona_core.app.steps.roll.messages import StartRollSearch
from rona_core.app.steps.scan.messages import StartHome, StartRetract, StartScan
from rona_core.app.steps.setup.clearance import stands_clear
from rona_core.compose import virtual_services
from rona_core.errors import DegenerateGeometryError, StepBlockedError
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.session.document import Results
from tests.scenes import demo_parts

IN_THE_SCAN = 1750  # times that a scan has asked whether to stop, when A-scans come


def states(session):
    return {state.name: state for state in step_states(session)}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The demo planned anew and stopped in its first scan: the probe stands on the bone."""
    demo = demo_parts.demo()
    kept = ("tool", "pointer", "surface", "path", "smoothing")
    results = Results(**{name: getattr(demo.results, name) for name in kept})
    captures = replace(demo.captures, scan=None, second=())
    bench = Workbench(
        replace(demo, captures=captures, results=results),
        virtual_services(),
        tmp_path_factory.mktemp("uploads"),
    )
    bench.run(StartRollSearch(n_rolls=12))
    questions = count()
    bench.run(StartScan(), cancel=lambda: next(questions) >= IN_THE_SCAN)
    yield bench
    bench.close()


def test_a_stopped_scan_is_partial_and_says_how_much_there_is(bench):
    scan = bench.session.captures.scan
    assert scan.partial
    found = states(bench.session)
    assert found["scan"].state == "partial"
    came = len(scan.scans)
    assert f"after {came} of " in found["scan"].reason
    planned = int(found["scan"].reason.split(" of ")[1].split()[0])
    assert 0 < came < 0.5 * planned
    assert found["scan"].blocked is None  # it can be done again


def test_the_maps_of_it_are_announced_as_a_part(bench):
    before = states(bench.session)["maps"]
    assert before.state == "ready"
    assert "cover only part" in before.reason
    mapped = Workbench(bench.session, virtual_services(), bench.uploads)
    mapped.run(StartMapping())
    after = states(mapped.session)["maps"]
    mapped.close()
    assert after.state == "partial"
    assert "cover only part" in after.reason


def test_a_row_of_it_is_no_map_and_the_session_stays(bench):
    scan = bench.session.captures.scan
    row = slice(0, 40)
    track = replace(
        scan.scans,
        times_s=scan.scans.times_s[row],
        rf=scan.scans.rf[row],
        clipped=scan.scans.clipped[row],
    )
    cut = bench.session.with_capture("scan", replace(scan, scans=track))
    mapped = Workbench(cut, virtual_services(), bench.uploads)
    with pytest.raises(DegenerateGeometryError, match=r"strip of .* mm.*scan more rows"):
        mapped.run(StartMapping())
    assert mapped.session is cut
    mapped.close()


def test_the_probe_is_drawn_back_along_its_axis_and_then_there_is_nothing_to_draw_back(bench):
    session, robot = bench.session, bench.rig().robot
    clock = bench.rig().clock
    clock.wait_until(clock.now() + 0.2)  # joint angles arrive late
    stood = robot.state().q_rad
    assert not stands_clear(session, stood)
    revision = bench.store.revision
    bench.run(StartRetract())
    assert bench.store.revision == revision, "the session knows nothing of it"
    now = robot.state().q_rad
    assert stands_clear(session, now)
    model = robot_model(session.setup.devices.robot.model)
    assert CollisionWorld(model, session_obstacles(session).without_touch()).clear(now[None])[0]
    probes = model.forward(np.stack((stood, now))) @ model.T_flange_probe
    way = probes[0].inv() @ probes[1].translation
    np.testing.assert_allclose(way, (0.0, 0.0, -30.0), atol=0.05)  # straight back, by 30 mm
    with pytest.raises(StepBlockedError, match="stands clear"):
        bench.run(StartRetract())


def test_from_the_bone_the_robot_goes_home_with_the_probe_drawn_back_first(bench):
    session, robot, clock = bench.session, bench.rig().robot, bench.rig().clock
    model = robot_model(session.setup.devices.robot.model)
    questions = count()
    bench.run(StartScan(), cancel=lambda: next(questions) >= IN_THE_SCAN)
    clock.wait_until(clock.now() + 0.2)
    stood = robot.state().q_rad
    assert not stands_clear(session, stood)
    driven = []
    move = robot.move
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(robot, "move", lambda times, qs: driven.append(qs) or move(times, qs))
        bench.run(StartHome())
    np.testing.assert_allclose(robot.state().q_rad, model.home_rad, atol=1e-6)
    probes = model.forward(np.stack((stood, driven[0][-1]))) @ model.T_flange_probe
    np.testing.assert_allclose(probes[0].inv() @ probes[1].translation, (0.0, 0.0, -30.0), atol=0.1)
    with pytest.raises(StepBlockedError, match="at home"):
        bench.run(StartHome())
