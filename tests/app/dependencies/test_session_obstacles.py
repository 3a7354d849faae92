"""What stands around the robot, as a session knows it, and that nothing moves without asking."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.app.declarations.registry import REGISTRY
from rona_core.app.dependencies.staleness import obstacles_of, session_obstacles
from rona_core.app.steps.roll import certificate_view as plan_reasons
from rona_core.app.steps.roll.certificate_view import certificate_view, plan_reason
from rona_core.app.steps.scan import captures
from rona_core.app.steps.scan.captures import capture_scan
from rona_core.app.steps.tool.messages import StartRobotMove, StartToolCapture
from rona_core.app.steps.tool.robot_motion import record_tool_motion
from rona_core.compose import new_workbench
from rona_core.devices.settings import DeviceSettings, RobotSettings
from rona_core.devices.workcell import Surroundings
from rona_core.errors import NotReachableError
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Pose, Poses
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.robot_model import Spindle
from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
from rona_core.robot.planning.plan_motion import PlanSettings, plan_scan
from rona_core.robot.verification.tolerances import Tolerances
from rona_core.robot.verification.verifier import verify_scan
from rona_core.session.codec import digest
from rona_core.session.document import Derived, Session, Setup
from rona_ui.panels.roll.roll import verdict

RX90 = robot_model("rx90")


def setup_with(**parts):
    return Setup(surroundings=Surroundings(**parts))


def derived(value, **inputs):
    return Derived(value, "Test", {}, inputs)


def measured(session, outward=1.0):
    """Return the session with a registered tool and a touched patch, markers above or below it."""
    rng = np.random.default_rng(3)
    flat = rng.uniform(-30, 30, (400, 2))
    points = np.column_stack((flat, -(flat**2).sum(axis=1) / 180.0)) + (600, 60, 400)
    track = SimpleNamespace(translations=points + (0, 0, outward * 150.0))
    stroke = SimpleNamespace(marker=SimpleNamespace(Ts_tracker_marker=track))
    tool = SimpleNamespace(T_base_tracker=Pose.identity())
    cloud = SimpleNamespace(points_base=points)
    return replace(
        session,
        results=replace(session.results, tool=derived(tool), surface=derived(cloud)),
        captures=replace(session.captures, surface=(stroke,)),
    )


def everything(name):
    return True


def test_before_anything_is_measured_the_head_is_where_the_setup_puts_it():
    found = session_obstacles(Session())
    assert [thing.name for thing in found.things] == ["head", "table", "floor"]
    assert "not touched yet" in found.sentence
    head = found.things[0]
    np.testing.assert_allclose(head.pose.translation, (600.0, 60.0, 310.0))
    moved = DeviceSettings(robot=RobotSettings(base_shift_mm=(100.0, 0.0, 0.0), base_turn_deg=90.0))
    there = session_obstacles(Session(setup=Setup(devices=moved))).things[0]
    np.testing.assert_allclose(there.pose.translation, (60.0, -500.0, 310.0), atol=1e-9)


def test_a_touched_patch_makes_the_head_and_the_registration_the_tracker():
    session = measured(Session())
    found = obstacles_of(session, everything)
    assert [t.name for t in found.things] == ["head", "table", "floor", "tracker", "tracker stand"]
    head = found.things[0]
    assert head.touch_mm > 0.0
    top = head.shape.vertices[:, 2].max()
    assert 395.0 < top < 405.0
    below = obstacles_of(measured(Session(), outward=-1.0), everything).things[0]
    assert below.shape.vertices[:, 2].max() > 600.0, "outward is where the markers were"
    assert obstacles_of(session, everything) is found, "equal inputs, the same value"
    stale = obstacles_of(session, lambda name: name == "tool")
    assert stale.things[0].touch_mm == 0.0, "a stale patch is not used"
    assert "tracker" in {thing.name for thing in stale.things}
    gone = obstacles_of(session, lambda name: False)
    assert gone.digest() == session_obstacles(Session()).digest()


def test_too_small_a_patch_leaves_the_head_where_it_was_put():
    session = measured(Session())
    few = SimpleNamespace(points_base=session.results.surface.value.points_base[:10])
    session = replace(session, results=replace(session.results, surface=derived(few)))
    found = obstacles_of(session, everything)
    assert found.things[0].touch_mm == 0.0
    assert "10 points are too few" in found.sentence


def test_surroundings_are_an_input_of_the_plan():
    session = Session()
    obstacles = REGISTRY.result("roll").inputs["obstacles"]
    assert obstacles.counted(session) == session_obstacles(session).digest()
    assert obstacles.read(session).digest() == obstacles.counted(session)
    wider = Session(setup=setup_with(margin_mm=30.0))
    assert digest(session_obstacles(wider)) != digest(session_obstacles(Session()))


@pytest.fixture(scope="module")
def plan():
    points = np.array((600.0, 60.0, 400.0)) + np.linspace(0, 1, 31)[:, None] * (0.0, 30.0, 0.0)
    path = Path5D(points, np.tile((0.0, 0.0, -1.0), (31, 1)))
    free = setup_with(table=False, head_below_mm=400.0, floor_mm=-2000.0)
    around = session_obstacles(Session(setup=free))
    made = plan_scan(path, RX90, PlanSettings(n_rolls=12, obstacles=around))
    assert made.may_move
    return free, made


def test_a_scan_is_executed_only_among_what_it_was_certified_among(plan):
    free, made = plan
    session = Session(setup=free)
    session = replace(session, results=replace(session.results, roll=derived(made)))
    with pytest.raises(AttributeError):  # it is let through, to devices that are not there
        capture_scan(session, None)
    other = replace(free, surroundings=replace(free.surroundings, floor_mm=-1999.0))
    with pytest.raises(NotReachableError, match="other obstacles"):
        capture_scan(replace(session, setup=other), None)
    moved = replace(made.trajectory, times_s=made.trajectory.times_s * 1.0001)
    forged = replace(session.results, roll=derived(replace(made, trajectory=moved)))
    with pytest.raises(NotReachableError, match="another motion"):
        capture_scan(replace(session, results=forged), None)
    blind = replace(made.certificate, obstacles="")
    forged = replace(session.results, roll=derived(replace(made, certificate=blind)))
    with pytest.raises(NotReachableError, match="other obstacles"):
        capture_scan(replace(session, results=forged), None)


def in_session(setup, plan):
    session = Session(setup=setup)
    return replace(session, results=replace(session.results, roll=derived(plan)))


def test_a_scan_that_was_verified_with_other_tolerances_is_not_executed(plan):
    free, made = plan
    loose = Tolerances(position_mm=0.5)
    motion, search = made.trajectory, made.search
    around = session_obstacles(Session(setup=free))
    speed = free.devices.robot.scan_speed_mm_per_s
    certificate = verify_scan(RX90, motion, search.path, search.rolls_rad, speed, loose, around)
    assert certificate.certified
    session = in_session(free, replace(made, certificate=certificate))
    assert session.results.roll.value.may_move
    with pytest.raises(NotReachableError, match=r"other tolerances .*: plan again$"):
        capture_scan(session, None)
    assert "other tolerances" in plan_reason(session)
    assert not certificate_view(session).certified


OTHER_ROBOTS = {
    "longer": replace(RX90, arm=replace(RX90.arm, upper_arm_mm=500.0)),
    "slower": replace(RX90, limits=replace(RX90.limits, speed_rad_per_s=np.full(6, 1e-3))),
    "heavier": RX90.with_tool(replace(RX90.tool, mass_kg=1.2)),
    "with a spindle": RX90.with_tool(RX90.tool.with_spindle(Spindle())),
    "with all pairs": replace(RX90, held_apart=()),
}


@pytest.mark.parametrize("what", OTHER_ROBOTS)
def test_a_scan_is_executed_only_by_the_robot_it_was_certified_for(plan, what, monkeypatch):
    session = in_session(*plan)
    assert plan_reason(session) is None
    assert certificate_view(session).certified
    for place in (captures, plan_reasons):
        monkeypatch.setattr(place, "robot_model", lambda _: OTHER_ROBOTS[what])
    with pytest.raises(NotReachableError, match=r"another robot .*: plan again$"):
        capture_scan(session, None)
    assert "plan again" in plan_reason(session)
    view = certificate_view(session)
    assert not view.certified
    assert "another motion, robot or tolerances. Plan again" in verdict(view, stale=False)


def test_every_other_motion_is_held_against_the_robot_that_is_to_drive_it():
    around = session_obstacles(Session()).without_touch()
    motion = plan_tool_motion(RX90, ToolMotionSettings(n_pivot=4, n_translate=2), obstacles=around)
    for other in OTHER_ROBOTS.values():
        with pytest.raises(NotReachableError, match=r"another robot .*: plan again$"):
            record_tool_motion("tool", motion, other, around, Session(), None)


def test_no_move_of_the_robot_goes_into_something():
    bench = new_workbench(Session())
    rig = bench.rig()
    before = rig.robot.state().q_rad
    home = RX90.forward(RX90.home_rad[None])[0] @ RX90.T_flange_tip
    into = Poses.stack([Pose(home.rotation, np.array((600.0, 60.0, 420.0)))])
    found = RX90.inverse(into @ RX90.T_flange_tip.inv()).qs_rad[0]
    down = np.rad2deg(found[np.abs(found - RX90.home_rad).max(axis=1).argmin()])
    with pytest.raises(NotReachableError, match=r"head are -?\d+ mm apart, \d+ mm must be kept"):
        bench.run(StartRobotMove(joints_deg=tuple(map(float, down))))
    np.testing.assert_array_equal(rig.robot.state().q_rad, before)
    aside = np.rad2deg(RX90.home_rad) + np.array((20.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    bench.run(StartRobotMove(joints_deg=tuple(map(float, aside))))
    assert np.rad2deg(rig.robot.state().q_rad - before)[0] == pytest.approx(20.0)
    bench.close()


def test_the_tool_motion_is_refused_where_the_table_is_too_high():
    high = setup_with(table_center_mm=(0.0, 0.0, 130.0))
    bench = new_workbench(Session(setup=high))
    with pytest.raises(NotReachableError, match=r"table are -?\d+ mm apart"):
        bench.run(StartToolCapture())
    assert bench.session.captures.tool is None
    bench.close()
