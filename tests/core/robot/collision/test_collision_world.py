"""The collision world: bodies that contain the robot, and their distances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial import ConvexHull

from rona_core.devices.workcell import Surroundings
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_geometry import (
    collision_bodies,
    solid_hulls,
)
from rona_core.robot.collision.collision_world import ITSELF, CollisionWorld
from rona_core.robot.collision.obstacles import (
    Box,
    Capsule,
    Hull,
    Obstacle,
    Obstacles,
    table_and_floor,
)
from rona_core.robot.collision.solids import Solid
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.wrists import SphericalWristArm
from rona_core.robot.meshes.link_meshes import link_shapes, tool_shapes

PLACE_OF_WORK = (600.0, 60.0, 400.0)  # of the RX90, in the room

RX90 = robot_model("rx90")
ARM = [bound.name for bound in collision_bodies(RX90)]


def ball(name, center, radius=60.0, margin=10.0, touch=0.0):
    return Obstacle(name, Capsule(radius, 0.0), Pose.from_translation(center), margin, touch)


def random_qs(n, seed=0):
    return np.random.default_rng(seed).uniform(RX90.lower_rad, RX90.upper_rad, (n, 6))


def around(seed=1):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 60, (40, 3))
    wall = Pose.from_rotvec((0.1, 0.2, 0.3), (-100, 500, 300))
    return Obstacles(
        (
            Obstacle("rock", Hull(points), Pose.from_translation((600, 100, 300)), 12.0, 7.0),
            ball("ball", (300, -500, 600), 80.0),
            Obstacle("wall", Box((800, 40, 900)), wall, 25.0),
            *table_and_floor(Surroundings(), Pose.identity(), PLACE_OF_WORK),
        )
    )


WORLD = CollisionWorld(RX90, around())
DRAWN_TOOL = {shape.name for shape in tool_shapes(RX90)} - {"force sensor"}
DRAWN_ARM = [
    Solid(shape.frame, shape.name, shape.mesh)
    for shape in link_shapes(RX90)
    if shape.name not in DRAWN_TOOL
]


@pytest.mark.parametrize(
    "bounds", [collision_bodies(RX90), solid_hulls(DRAWN_ARM) + collision_bodies(RX90)[-5:]]
)
def test_everything_that_is_drawn_lies_within_the_bounds(bounds):
    faces = [(b.link, ConvexHull(b.vertices).equations) for b in bounds]
    for shape in link_shapes(RX90):
        outside = np.full(len(shape.mesh.vertices), np.inf)
        for link, planes in faces:
            if link == shape.frame:
                height = (shape.mesh.vertices @ planes[:, :3].T + planes[:, 3]).max(axis=1)
                outside = np.minimum(outside, height)
        assert outside.max() <= 1e-6, shape.name


def test_an_arm_of_another_build_is_refused():
    with pytest.raises(InvalidInputError, match="no collision bodies for the build of 'unknown'"):
        collision_bodies(replace(RX90, name="unknown", arm=None))


def test_distances_to_a_ball_are_those_of_the_nearest_point_of_a_hull():
    """The nearest point of a hull by non-negative least squares over weights that sum to one."""
    center = np.array((500.0, 200.0, 500.0))
    world = CollisionWorld(RX90, Obstacles((ball("ball", center, 50.0),)))
    bounds = {bound.name: bound for bound in collision_bodies(RX90)}
    checked = 0
    for q in random_qs(6, seed=5):
        found = world.distances_mm(q[None])[0]
        frames = RX90.joint_poses(q)
        for pair, distance in zip(world.pairs, found, strict=True):
            if pair.group != "ball" or distance < 1.0:
                continue
            corners = frames[bounds[pair.first].link] @ bounds[pair.first].vertices
            heavy = 1e6
            matrix = np.vstack(((corners - center).T, np.full(len(corners), heavy)))
            weights = nnls(matrix, np.array((0.0, 0.0, 0.0, heavy)))[0]
            nearest = np.linalg.norm(weights @ (corners - center)) / weights.sum()
            assert distance == pytest.approx(nearest - 50.0, abs=0.01)
            checked += 1
    assert checked > 40


def test_depth_is_negative_and_exact_for_a_ball_in_a_box():
    """A box so large that the tool is in it whole: the depth is that of the farthest corner."""
    box = Obstacle("box", Box((4000.0, 4000.0, 1000.0)), Pose.identity(), 0.0)
    world = CollisionWorld(RX90, Obstacles((box,)))
    q = RX90.home_rad
    column = [pair.first for pair in world.pairs if pair.group == "box"].index("probe")
    columns = [k for k, pair in enumerate(world.pairs) if pair.group == "box"]
    frames = RX90.joint_poses(q)
    (probe,) = (bound for bound in collision_bodies(RX90) if bound.name == "probe")
    lowest = (frames[6] @ probe.vertices)[:, 2].min()
    found = world.distances_mm(q[None])[0, columns[column]]
    assert found == pytest.approx(lowest - 500.0, abs=0.01)


@settings(max_examples=15, deadline=None)
@given(turn=st.floats(-2.0, 2.0), seed=st.integers(0, 50))
def test_turning_base_joint_and_obstacles_together_changes_no_distance(turn, seed):
    things = around().things[:3]
    about = Pose.from_rotvec((0.0, 0.0, turn))
    turned = tuple(replace(thing, pose=about @ thing.pose) for thing in things)
    q = random_qs(1, seed)
    q[0, 0] = 0.3
    other = q.copy()
    other[0, 0] += turn
    world = CollisionWorld(RX90, Obstacles(things))
    before = world.distances_mm(q)[0]
    after = CollisionWorld(RX90, Obstacles(turned)).distances_mm(other)[0]
    columns = [k for k, pair in enumerate(world.pairs) if not pair.first.startswith("base")]
    np.testing.assert_allclose(before[columns], after[columns], atol=0.02)


def test_clear_is_what_the_report_says_and_never_sees_more_with_wider_margins():
    qs = random_qs(300, 3)
    report, clear = WORLD.report(qs), WORLD.clear(qs)
    sure = np.abs(report.room_mm) > 0.01
    assert 30 < clear.sum() < 270
    np.testing.assert_array_equal(clear[sure], report.room_mm[sure] > 0.0)
    assert report.first_hit == np.flatnonzero(report.room_mm < 0)[0]
    wide = tuple(replace(thing, margin_mm=thing.margin_mm + 40.0) for thing in around().things)
    wider = CollisionWorld(RX90, Obstacles(wide)).clear(qs)
    assert not (wider & ~clear).any()
    assert (clear & ~wider).any()


def test_the_report_names_the_pair_and_the_place():
    center = (RX90.forward(RX90.home_rad[None]) @ RX90.T_flange_tip).translations[0]
    obstacles = Obstacles((ball("apple", center, 20.0), ball("moon", (0, 0, 5000.0), 300.0)))
    world = CollisionWorld(RX90, obstacles)
    assert "moon" not in {pair.group for pair in world.pairs}, "out of reach"
    away = RX90.home_rad + np.array((0.8, 0, 0, 0, 0, 0))
    report = world.report(np.stack((away, RX90.home_rad)))
    assert report.first_hit == 1
    closest = report.closest_pair(1)
    assert (closest.first, closest.second, closest.least_mm) == ("probe", "apple", 10.0)
    assert closest.apart_mm < 0.0
    assert world.clear(away[None])[0]
    assert report.clearance_mm[0] > 5.0 > 0.0 > report.clearance_mm[1]


def test_only_the_delay_line_may_touch_and_only_so_deep():
    home = RX90.forward(RX90.home_rad[None])[0] @ RX90.T_flange_probe
    deep = np.array((-2.0, 4.0, 6.0))
    for depth in deep:
        center = home @ np.array((0.0, 0.0, 80.0 - depth))
        bone = ball("bone", center, 80.0, margin=10.0, touch=5.0)
        world = CollisionWorld(RX90, Obstacles((bone,)))
        report = world.report(RX90.home_rad[None])
        line = [(pair.first, pair.second) for pair in world.pairs].index(("delay line", "bone"))
        distance = world.distances_mm(RX90.home_rad[None])[0, line]
        assert distance == pytest.approx(-depth, abs=0.02)
        assert world.clear(RX90.home_rad[None])[0] == (depth <= 5.0)
        assert report.clearance_mm[0] > 0.0, "what may touch is left out"
        hard = CollisionWorld(RX90, Obstacles((replace(bone, touch_mm=0.0),)))
        assert not hard.clear(RX90.home_rad[None])[0]


def test_the_robot_can_meet_itself_but_not_at_home():
    alone = CollisionWorld(RX90)
    assert {pair.group for pair in alone.pairs} == {ITSELF}
    assert alone.clear(RX90.home_rad[None])[0]
    folded = np.deg2rad((0.0, 137.0, 142.0, 0.0, 0.0, 0.0))
    hit = alone.report(folded[None])
    assert hit.first_hit == 0
    closest = hit.closest_pair(0)
    assert {"base", "shoulder column", "shoulder"} & {closest.first, closest.second}


def test_levers_bound_every_motion():
    rng = np.random.default_rng(2)
    bounds = collision_bodies(RX90)
    for q in random_qs(20, 8):
        step = rng.normal(0, 0.05, 6)
        most = np.abs(step) @ WORLD._bodies.levers_mm
        before, after = RX90.joint_poses(q), RX90.joint_poses(q + step)
        for bound in bounds:
            moved = after[bound.link] @ bound.vertices - before[bound.link] @ bound.vertices
            assert np.linalg.norm(moved, axis=1).max() <= most + 1e-9


def test_an_arm_whose_frames_are_not_where_it_moves_is_refused():
    class Bent(SphericalWristArm):
        def link_frames(self, qs_rad):
            rotations, positions = super().link_frames(qs_rad)
            return rotations, positions + np.array((1.0, 0.0, 0.0))

    arm = RX90.arm
    bent = Bent(arm.shoulder_mm, arm.upper_arm_mm, arm.forearm_mm, arm.flange_mm)
    with pytest.raises(InvalidInputError, match="link 1 of rx90 is not where its joints say"):
        CollisionWorld(replace(RX90, arm=bent))


def test_wrong_shapes_are_refused():
    with pytest.raises(InvalidInputError, match=r"shape \(n, 6\)"):
        WORLD.clear(np.zeros((3, 5)))
    with pytest.raises(InvalidInputError, match="finite"):
        WORLD.report(np.full((1, 6), np.nan))
