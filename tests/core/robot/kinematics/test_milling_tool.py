"""The spindle in the robot's hand: the tip stays, the bodies change."""

import numpy as np
import pytest

from rona_core.devices.robots import ROBOTS
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import BURR, SPINDLE, collision_bodies
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import Capsule, Obstacle, Obstacles
from rona_core.robot.kinematics.catalog import milling_robot, robot_model
from rona_core.robot.kinematics.robot_model import Spindle


@pytest.mark.parametrize("name", ROBOTS)
def test_the_tip_of_the_burr_is_that_of_the_calibrated_tool(name):
    plain, milling = robot_model(name), milling_robot(name, 2.5)
    np.testing.assert_array_equal(milling.T_flange_probe.matrix(), plain.T_flange_tip.matrix())
    assert milling.tool.spindle == Spindle(2.5)
    assert plain.tool.spindle is None
    names = {body.name for body in collision_bodies(milling)}
    assert names - {body.name for body in collision_bodies(plain)} == {SPINDLE, BURR}


@pytest.mark.parametrize("radius_mm", [1.0, 2.5, 6.0])
def test_the_body_of_the_burr_holds_the_ball_and_no_more_than_its_octagon(radius_mm):
    model = milling_robot("rx90", radius_mm)
    body = next(body for body in collision_bodies(model) if body.name == BURR)
    tip = model.T_flange_tip.inv() @ body.vertices
    rng = np.random.default_rng(0)
    way = rng.normal(size=(500, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    reach = (way @ tip.T).max(axis=1)  # support of the body
    ball = radius_mm - radius_mm * way[:, 2]  # of a ball whose lowest place is the tip
    assert (reach >= ball - 1e-9).all()
    down = way[:, 2] > 0.9
    assert (reach - ball)[down].max() < 0.1 * radius_mm


def test_only_the_burr_may_reach_into_what_may_be_touched():
    model = milling_robot("rx90", 2.5)
    tip = model.forward(model.home_rad[None])[0] @ model.T_flange_tip
    for depth_mm, apart in ((3.0, True), (5.5, False)):
        below = tip @ Pose.from_translation((0.0, 0.0, 50.0 - depth_mm))
        head = Obstacle("head", Capsule(50.0, 0.0), below, 10.0, touch_mm=4.5)
        world = CollisionWorld(model, Obstacles((head,)))
        assert world.clear(model.home_rad[None])[0] == apart
        least = {p.first: p.least_mm for p in world.pairs if p.second == "head"}
        assert (least[BURR], least[SPINDLE]) == (-4.5, 10.0)
    untouched = Obstacle("head", Capsule(50.0, 0.0), below, 10.0)
    pairs = CollisionWorld(model, Obstacles((untouched,))).pairs
    assert {p.least_mm for p in pairs if p.second == "head" and p.first == BURR} == {10.0}


def test_a_spindle_without_a_burr_is_refused():
    with pytest.raises(InvalidInputError, match="burr_radius_mm"):
        Spindle(0.0)


def test_the_registered_tip_moves_the_burr_and_not_the_marker():
    drawn, model = milling_robot("rx90", 2.5), milling_robot("rx90", 2.5, (0.3, -0.2, 0.1))
    moved = drawn.T_flange_tip.inv() @ model.T_flange_tip
    np.testing.assert_allclose(moved.translation, (0.3, -0.2, 0.1), atol=1e-12)
    np.testing.assert_allclose(moved.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_array_equal(model.T_flange_probe.matrix(), model.T_flange_tip.matrix())
    np.testing.assert_array_equal(
        model.T_flange_toolmarker.matrix(), drawn.T_flange_toolmarker.matrix()
    )
    assert model.tool.burr_offset_tip == (0.3, -0.2, 0.1)
