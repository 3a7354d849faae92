"""The tool is weighed in free poses, on moves that keep away from what stands around."""

from types import SimpleNamespace

import numpy as np
import pytest

from rona_core.app.declarations.declarations import ActivityContext
from rona_core.app.steps.scan.captures import TURNS_DEG, identify_payload
from rona_core.app.steps.tool.robot_motion import FreeMoves
from rona_core.devices.live import Live
from rona_core.devices.wrench import ToolLoad
from rona_core.errors import CancelledError, DegenerateGeometryError, NotReachableError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import NOTHING_AROUND, Capsule, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.robot.robot import VirtualRobot
from tests.helpers.tool_weight import weight_wrench

RX90 = robot_model("rx90")
HOME = RX90.home_rad
LOAD = ToolLoad(0.2, np.array((5.0, -3.0, 60.0)), np.zeros(6), 0.0, 0.0, 6)


class WatchedRobot(VirtualRobot):
    """Keeps every motion that it was sent on."""

    def __init__(self, clock):
        super().__init__(RX90, clock)
        self.sent = []

    def move(self, times_s, qs_rad):
        self.sent.append(np.array(qs_rad))
        return super().move(times_s, qs_rad)


def toolbox(cancel=lambda: False):
    clock = CaptureClock()
    robot = WatchedRobot(clock)

    def read():
        rotation = RX90.forward(robot.q_at(clock.now())[None])[0].rotation
        return SimpleNamespace(wrench=weight_wrench(LOAD, rotation))

    rig = SimpleNamespace(clock=clock, robot=robot, force=SimpleNamespace(read=read))
    tools = ActivityContext(lambda: rig, Live(), import_skull=None, uploads=None, cancel=cancel)
    return robot, tools


def ball(center, radius, name="ball"):
    return Obstacles((Obstacle(name, Capsule(radius, 0.0), Pose.from_translation(center), 5.0),))


def probe_at(turn_deg):
    q = HOME + np.concatenate((np.zeros(3), np.deg2rad(turn_deg)))
    return (RX90.forward(q[None])[0] @ RX90.T_flange_probe).translation


def all_clear(robot, around):
    return CollisionWorld(RX90, around).clear(np.concatenate(robot.sent)).all()


def test_with_nothing_around_the_load_is_found_and_the_robot_is_back():
    robot, tools = toolbox()
    load = identify_payload(HOME, RX90, NOTHING_AROUND, tools)
    assert load.n_poses == len(TURNS_DEG)
    assert load.mass_kg == pytest.approx(LOAD.mass_kg, rel=1e-9)
    np.testing.assert_allclose(load.com_sensor_mm, LOAD.com_sensor_mm, atol=1e-6)
    np.testing.assert_allclose(robot.state().q_rad, HOME, atol=1e-12)


def test_a_pose_in_which_something_stands_is_turned_the_other_way():
    around = ball(probe_at((0, 25, 0)), 10.0)
    robot, tools = toolbox()
    load = identify_payload(HOME, RX90, around, tools)
    assert all_clear(robot, around)
    assert load.mass_kg == pytest.approx(LOAD.mass_kg, rel=1e-9)
    free, tools = toolbox()
    identify_payload(HOME, RX90, NOTHING_AROUND, tools)
    assert not all_clear(free, around), "without asking, the tool would have been turned into it"
    plus, minus = np.deg2rad(25.0), np.deg2rad(-25.0)
    reached = np.array([qs[-1, 4] - HOME[4] for qs in robot.sent])
    assert not np.isclose(reached, plus).any()
    assert np.isclose(reached, minus).any()


def test_what_stands_between_two_poses_is_driven_around():
    between = 0.5 * (probe_at((0, 25, 0)) + probe_at((0, -25, 0)))
    # beside the tool at rest, in the way of the straight move from one side to the other
    side = np.cross(probe_at((0, 25, 0)) - probe_at((0, -25, 0)), (0.0, 0.0, 1.0))
    around = ball(between + 45.0 * side / np.linalg.norm(side) - (0.0, 0.0, 25.0), 8.0)
    robot, tools = toolbox()
    load = identify_payload(HOME, RX90, around, tools)
    assert all_clear(robot, around)
    assert load.n_poses == len(TURNS_DEG)
    free, tools = toolbox()
    identify_payload(HOME, RX90, NOTHING_AROUND, tools)
    assert not all_clear(free, around), "the straight moves would have touched it"


def test_where_the_tool_cannot_be_turned_it_says_what_is_in_the_way():
    """A post wherever the probe would be turned to, either way."""
    turns = [np.array(turn) * sign for turn in TURNS_DEG[1:] for sign in (1, -1)]
    posts = {}
    for turn in turns:
        place = tuple(np.round(probe_at(turn), 6))
        name = f"post {len(posts)}"
        posts.setdefault(place, Obstacle(name, Capsule(8.0, 0.0), Pose.from_translation(place), 5))
    around = Obstacles(tuple(posts.values()))
    assert CollisionWorld(RX90, around).clear(HOME[None])[0]
    robot, tools = toolbox()
    with pytest.raises(DegenerateGeometryError, match=r"turn.*post \d are -?\d+ mm apart"):
        identify_payload(HOME, RX90, around, tools)
    assert not robot.sent or all_clear(robot, around)
    np.testing.assert_allclose(robot.state().q_rad, HOME, atol=1e-12)


def test_a_stop_on_the_way_says_so_and_nothing_moves_afterwards():
    asked = [0]

    def cancel():
        asked[0] += 1
        return asked[0] > 5

    robot, tools = toolbox(cancel)
    with pytest.raises(CancelledError, match=r"stopped while the tool was weighed.*no A-scan"):
        identify_payload(HOME, RX90, NOTHING_AROUND, tools)
    sent, stopped = len(robot.sent), robot.state()
    assert not stopped.moving
    tools.rig.clock.wait_until(tools.rig.clock.now() + 5.0)
    assert len(robot.sent) == sent
    np.testing.assert_array_equal(robot.state().q_rad, stopped.q_rad)


def touched_head(depth_mm):
    """A ball that the delay line at home reaches into, as a scan may."""
    home = RX90.forward(HOME[None])[0] @ RX90.T_flange_probe
    center = home @ np.array((0.0, 0.0, 100.0 - depth_mm))
    pose = Pose.from_translation(center)
    return Obstacles((Obstacle("head", Capsule(100.0, 0.0), pose, 10.0, touch_mm=5.0),))


def test_from_the_bone_the_probe_is_drawn_back_before_it_goes_anywhere():
    around = touched_head(3.0)
    goal = HOME + np.array((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    back, move = FreeMoves(RX90, around).plan(HOME, goal)
    probes = RX90.forward(back.qs_rad) @ RX90.T_flange_probe
    way = probes.translations - probes.translations[0]
    axis = probes.rotations[0, :, 2]
    np.testing.assert_allclose(way, np.outer(way @ axis, axis), atol=0.02)
    assert (np.diff(way @ axis) <= 1e-9).all()
    assert way[-1] @ axis == pytest.approx(-30.0, abs=1e-6)
    np.testing.assert_array_equal(back.qs_rad[-1], move.qs_rad[0])
    free = CollisionWorld(RX90, around.without_touch())
    assert free.clear(move.qs_rad).all(), "after that it keeps its distance"
    np.testing.assert_allclose(move.qs_rad[-1], goal)


def test_no_move_but_a_scan_goes_onto_the_bone():
    away = HOME + np.array((0.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    moves = FreeMoves(RX90, touched_head(3.0))
    with pytest.raises(NotReachableError, match=r"probe and head are -?\d+ mm apart"):
        moves.plan(away, HOME)


def test_a_robot_that_stands_in_something_says_so_and_what_to_do():
    moves = FreeMoves(RX90, touched_head(9.0))
    with pytest.raises(NotReachableError, match=r"stands.*head are.*undo"):
        moves.plan(HOME, HOME + np.array((0.5, 0.0, 0.0, 0.0, 0.0, 0.0)))
