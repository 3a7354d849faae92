"""Answers by bounds are those of looking at every pair at every place."""

from dataclasses import replace

import numpy as np
import pytest

from rona_core.devices.workcell import Surroundings
from rona_core.geometry.pose import Pose
from rona_core.robot.collision.collision_world import SLACK_MM, CollisionWorld
from rona_core.robot.collision.obstacles import (
    Box,
    Capsule,
    Obstacle,
    Obstacles,
    head_from_cloud,
    table_and_floor,
    tracker_stand,
)
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.redundancy.constant_roll import (
    evaluate_constant_rolls,
    remove_blocked_rolls,
    working_set_deg,
)
from rona_core.robot.redundancy.margins import MarginLimits
from rona_core.robot.trajectory.joint_moves import joint_move
from rona_core.robot.trajectory.trajectory import sampled_motion
from rona_core.robot.verification.motion_checks import _nearest, dense_motion, judged
from rona_core.robot.verification.tolerances import DENSITY
from tests.scenes.patch_scenes import scene_model, scene_path

ROBOTS = ("rx90", "ur5", "ur10")
# to which Coal finds a distance, wherever its search starts, and how deep one body is in another
SAME_MM, SAME_DEPTH = 2e-3, 1e-3


def close_to(distance_mm):
    """Return a distance as a test compares it: a depth (below 0) to a thousandth of it as well."""
    return pytest.approx(distance_mm, abs=SAME_MM, rel=SAME_DEPTH if distance_mm < 0.0 else 0.0)


def assert_close(found_mm, wanted_mm):
    """Fail where distances are not those that are wanted, see ``close_to``."""
    most = SAME_MM + SAME_DEPTH * np.maximum(0.0, -wanted_mm)
    finite = np.isfinite(wanted_mm)
    np.testing.assert_array_equal(finite, np.isfinite(found_mm))
    assert (np.abs(found_mm - wanted_mm)[finite] <= most[finite]).all()


class Exhaustive(CollisionWorld):
    """Every pair at every place."""

    def nearest_mm(self, qs_rad):
        return self.distances_mm(qs_rad)

    def bounds_mm(self, qs_rad):
        return self.distances_mm(qs_rad)

    def least_of_all(self, qs_rad, bounds_mm):
        return bounds_mm.min(axis=0), bounds_mm.argmin(axis=0)

    def clear(self, qs_rad):
        return (self.distances_mm(qs_rad) >= self.least_mm).all(axis=1)

    def first_hit(self, qs_rad):
        hits = np.flatnonzero(~self.clear(qs_rad))
        return int(hits[0]) if len(hits) else -1


def things(seed, model):
    """Return a head to touch, a tracker, table, floor, and a box and a capsule anywhere."""
    rng = np.random.default_rng(seed)
    tip = (model.forward(model.home_rad[None]) @ model.T_flange_tip).translations[0]
    ball = rng.normal(size=(400, 3))
    ball[:, 2] = np.abs(ball[:, 2])
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    cloud = tip + 90.0 * (ball[ball[:, 2] > 0.8] - (0.0, 0.0, 1.0)) + rng.normal(0, 40, 3)
    side, turn = rng.uniform(-500, 500, 3), rng.normal(size=3)
    anywhere = (
        Obstacle("box", Box((300, 60, 400)), Pose.from_rotvec(turn, side), 20.0),
        Obstacle("pole", Capsule(40.0, 500.0), Pose.from_rotvec(-turn, 0.6 * tip - side), 15.0),
    )
    tracker = tracker_stand(Surroundings(), Pose.from_translation(tip + (900.0, 300.0, 500.0)))
    head = head_from_cloud(cloud, (0.0, 0.0, 1.0), 10.0)
    room = table_and_floor(Surroundings(), Pose.identity(), tip - (0.0, 0.0, 150.0))
    return Obstacles((head, *tracker, *room, *anywhere))


def motions(seed, model):
    """Return joints (n, 6): a slow way, a fast way, and places anywhere."""
    rng = np.random.default_rng(seed)
    slow = model.home_rad + np.cumsum(rng.normal(0, 0.004, (90, 6)), axis=0)
    middle = 0.5 * (model.lower_rad + model.upper_rad)
    goal = model.home_rad + 0.6 * (rng.uniform(model.lower_rad, model.upper_rad) - middle)
    fast = model.home_rad + np.linspace(0, 1, 75)[:, None] * (goal - model.home_rad)
    anywhere = rng.uniform(model.lower_rad, model.upper_rad, (40, 6))
    return [slow, fast, anywhere, slow[:1], fast[:9], slow[:0]]


@pytest.fixture(params=[(name, seed) for name in ROBOTS for seed in range(2)], ids=str)
def worlds(request):
    """A robot, a seed, its collision world and one that asks every pair."""
    name, seed = request.param
    model = robot_model(name)
    around = things(seed, model)
    return model, seed, CollisionWorld(model, around), Exhaustive(model, around)


@pytest.mark.sweep(3)
def test_what_is_clear_and_what_is_hit_first_are_those_of_every_pair(worlds):
    touched = 0
    model, seed, world, exhaustive = worlds
    for qs in motions(seed, model):
        clear = exhaustive.clear(qs)
        np.testing.assert_array_equal(world.clear(qs), clear)
        assert world.first_hit(qs) == exhaustive.first_hit(qs)
        touched += 0 < clear.sum() < len(clear)
    assert touched >= 1


@pytest.mark.sweep(1)
def test_the_report_is_that_of_every_pair(worlds):
    model, seed, world, exhaustive = worlds
    for qs in motions(seed, model)[:5]:
        found, wanted = world.report(qs), exhaustive.report(qs)
        assert found.first_hit == wanted.first_hit
        np.testing.assert_array_equal(found.closest, wanted.closest)
        assert_close(found.room_mm, wanted.room_mm)
        assert_close(found.clearance_mm, wanted.clearance_mm)


@pytest.mark.sweep(1)
def test_of_every_obstacle_the_nearest_pair_is_known_everywhere(worlds):
    model, seed, world, exhaustive = worlds
    for qs in motions(seed, model)[:5]:
        found, every = world.nearest_mm(qs), exhaustive.distances_mm(qs)
        known = np.isfinite(found)
        assert_close(found[known], every[known])
        for kind in {(pair.group, pair.least_mm) for pair in world.pairs}:
            of_kind = np.array([(pair.group, pair.least_mm) == kind for pair in world.pairs])
            nearest = np.where(of_kind, every, np.inf).argmin(axis=1)
            assert known[np.arange(len(qs)), nearest].all()


@pytest.mark.sweep(1)
def test_bounds_are_no_more_than_the_distances_and_close_where_it_matters(worlds):
    model, seed, world, exhaustive = worlds
    for qs in motions(seed, model)[:5]:
        found, every = world.bounds_mm(qs), exhaustive.distances_mm(qs)
        assert (found <= every).all()
    slow = motions(seed, model)[0]
    kept, nearest = (
        of.min(axis=1) for of in (world.bounds_mm(slow), exhaustive.distances_mm(slow))
    )
    assert np.median(nearest - kept) < 1.0


@pytest.mark.sweep(1)
def test_over_a_motion_the_nearest_of_every_obstacle_is_that_of_every_pair(worlds):
    model, seed, world, exhaustive = worlds
    for qs in motions(seed, model)[:5]:
        every = exhaustive.distances_mm(qs)
        least, at = world.least_of_all(qs, world.bounds_mm(qs))
        for kind in {(pair.group, pair.least_mm) for pair in world.pairs}:
            of_kind = np.array([(pair.group, pair.least_mm) == kind for pair in world.pairs])
            assert least[of_kind].min() == close_to(every[:, of_kind].min())
        known = np.isfinite(least)
        assert_close(least[known], every[at, np.arange(len(at))][known])


@pytest.mark.sweep(1)
def test_the_certificate_is_that_of_every_pair(worlds):
    model, seed, world, exhaustive = worlds
    for goal in motions(seed, model)[1][[20, -1]]:
        dense = dense_motion(model, sampled_motion(joint_move(model, model.home_rad, goal)))
        found, wanted = (judged(w, _nearest(w, dense)) for w in (world, exhaustive))
        for check, other in zip(found[0], wanted[0], strict=True):
            assert (check.name, check.holds) == (other.name, other.holds)
            assert check.value == close_to(other.value)
            if check.index != other.index:  # as near there
                places = slice(DENSITY * check.index, DENSITY * (check.index + 1) + 1)
                here = exhaustive.distances_mm(dense.qs_rad[places])
                of_group = [pair.group in check.name for pair in world.pairs]
                assert here[:, of_group].min() == close_to(check.value)
        assert found[1] == close_to(wanted[1])


@pytest.mark.sweep(1)
@pytest.mark.parametrize(("name", "scene"), [("rx90", "S0"), ("rx90", "S5"), ("ur10", "S2")])
def test_the_rolls_that_are_blocked_are_those_of_every_pair(name, scene):
    path, model = scene_path(scene, 90), scene_model(name)
    evaluation = evaluate_constant_rolls(
        path, model, working_set_deg(24, 0.0, 360.0), MarginLimits()
    )
    changed = 0
    for side in (-1.0, 1.0):
        place = path.points_base[0] + np.array((side * 60.0, side * 220.0, 120.0))
        post = Obstacle("post", Capsule(60.0, 300.0), Pose.from_translation(place), 10.0)
        around = Obstacles((post,))
        found, wanted = (
            remove_blocked_rolls(evaluation, kind(model, around))
            for kind in (CollisionWorld, Exhaustive)
        )
        for verdict, other in zip(found.verdicts, wanted.verdicts, strict=True):
            assert verdict.value == close_to(other.value)
            assert replace(verdict, value=other.value) == other
        assert found.ranked == wanted.ranked
        np.testing.assert_array_equal(found.rolls.qs_rad, wanted.rolls.qs_rad)
        changed += found.ranked != evaluation.ranked
    assert changed > 0


@pytest.mark.parametrize("name", ROBOTS)
def test_no_pair_moves_farther_than_its_levers(name):
    model = robot_model(name)
    world = CollisionWorld(model, things(3, model))
    rng = np.random.default_rng(5)
    levers_mm = world._bodies.pair_levers_mm(world.pairs)
    for q in rng.uniform(model.lower_rad, model.upper_rad, (60, 6)):
        step = rng.normal(0.0, 0.05, 6)
        before, after = world.distances_mm(np.stack((q, q + step)))
        assert (np.abs(after - before) <= np.abs(step) @ levers_mm + 0.01).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_planes_tell_the_distance_where_they_separate_and_a_lesser_one_about_it(name):
    model = robot_model(name)
    world = CollisionWorld(model, things(3, model))
    every = np.arange(len(world.pairs))
    rng = np.random.default_rng(6)
    for q in rng.uniform(model.lower_rad, model.upper_rad, (12, 6)):
        qs = q + rng.normal(0.0, 0.1, (9, 6)) * (np.arange(9) != 4)[:, None]
        apart = world.distances_mm(qs)
        world.distances_mm(qs[4:5])
        normals = world._bodies.normals_base(every)
        found = world._planes.bounds_mm(*model.arm.link_frames(qs), every, normals)
        assert (found <= apart + SLACK_MM).all()
        np.testing.assert_allclose(found[4], apart[4], rtol=0.0, atol=0.2)


def test_far_pairs_are_not_looked_at(monkeypatch):
    model = robot_model("rx90")
    world = CollisionWorld(model, things(0, model))
    looked = {"meets": 0, "distances_mm": 0}
    for name in looked:
        plain = getattr(world._bodies, name)

        def counted(q, name=name, plain=plain):
            looked[name] += int(world._bodies._chosen.sum())
            return plain(q)

        monkeypatch.setattr(world._bodies, name, counted)
    qs = motions(1, model)[0]
    every = len(qs) * len(world.pairs)
    world.clear(qs)
    assert sum(looked.values()) < 0.1 * every
    looked.update(meets=0, distances_mm=0)
    world.nearest_mm(qs)
    assert looked["distances_mm"] < 0.6 * every
