"""Rolls with which the robot would touch something are not offered, and say what is in the way."""

import numpy as np
import pytest

from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.collision_world import CollisionWorld
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.redundancy.constant_roll import (
    evaluate_constant_rolls,
    remove_blocked_rolls,
    working_set_deg,
)
from rona_core.robot.redundancy.margins import MarginLimits, joint_path
from tests.scenes.patch_scenes import scene_model, scene_path


class Wall:
    """A collision world in which everything touches that a rule does not let pass."""

    def __init__(self, passes):
        self.passes = passes
        self.own = CollisionWorld(scene_model(), NOTHING_AROUND)

    def clear(self, qs_rad):
        return np.array([self.passes(q) for q in qs_rad], dtype=bool)

    def first_hit(self, qs_rad):
        return next((i for i, q in enumerate(qs_rad) if not self.passes(q)), -1)

    def report(self, qs_rad):
        return self.own.report(qs_rad)


@pytest.fixture(scope="module")
def evaluation():
    path, model = scene_path("S0", 90), scene_model()
    return evaluate_constant_rolls(path, model, working_set_deg(24, 0.0, 360.0), MarginLimits())


def test_where_nothing_touches_nothing_changes(evaluation):
    after = remove_blocked_rolls(evaluation, Wall(lambda q: True))
    assert after.verdicts == evaluation.verdicts
    assert after.ranked == evaluation.ranked
    assert np.array_equal(after.rolls.qs_rad, evaluation.rolls.qs_rad)


def test_where_everything_touches_no_roll_is_left_and_each_says_so(evaluation):
    after = remove_blocked_rolls(evaluation, Wall(lambda q: False))
    assert after.ranked == ()
    for old, new in zip(evaluation.verdicts, after.verdicts, strict=True):
        assert not new.feasible
        assert new.reason == ("blocked" if old.feasible else old.reason)
        if old.feasible:
            assert "mm are needed" in new.sentence
            assert 0 <= new.index < len(evaluation.path)


def test_a_roll_keeps_the_best_branch_that_touches_nothing(evaluation):
    feasible = [i for i, verdict in enumerate(evaluation.verdicts) if verdict.feasible]
    usual = np.sign(np.median(evaluation.rolls.qs_rad[4][feasible]))
    wall = Wall(lambda q: q[4] * usual < 0.0)  # the wrist has to be turned the other way
    after = remove_blocked_rolls(evaluation, wall)
    changed = 0
    for i, verdict in enumerate(after.verdicts):
        if not verdict.feasible:
            continue
        roll_rad = np.deg2rad(verdict.roll_deg)
        curve = joint_path(
            evaluation.path,
            evaluation.model,
            roll_rad,
            verdict.branch,
        )
        np.testing.assert_allclose(after.rolls.qs_rad[:, i].T, curve, atol=1e-9)
        assert wall.clear(curve[::4]).all()
        better = [p for p in evaluation.ranked if p.index == i and p.margin > verdict.margin + 1e-9]
        for pair in better:
            other = joint_path(
                evaluation.path,
                evaluation.model,
                roll_rad,
                pair.branch,
            )
            assert not wall.clear(other).all()
        assert after.rolls.branches[i] == verdict.branch
        assert after.rolls.margins[i].min() == pytest.approx(verdict.margin)
        changed += verdict.branch != evaluation.verdicts[i].branch
    assert changed > 0
    kept = {(pair.index, pair.branch) for pair in after.ranked}
    assert kept < {(pair.index, pair.branch) for pair in evaluation.ranked}


class Ceiling(Wall):
    """The probe may be on the path, but not drawn back from its last point by 5 mm."""

    def __init__(self, evaluation, room_mm):
        super().__init__(None)
        path, model = evaluation.path, evaluation.model
        end, axis = path.points_base[-1], path.axes_base[-1]

        def passes(q):
            face = (model.forward(q[None])[0] @ model.T_flange_probe).translation
            return np.linalg.norm(face - end) > 8.0 or -(face - end) @ axis <= room_mm

        self.passes = passes


def test_a_roll_from_which_the_probe_cannot_be_drawn_back_is_not_offered(evaluation):
    last = len(evaluation.path) - 1
    after = remove_blocked_rolls(evaluation, Ceiling(evaluation, 3.5))
    assert not after.ranked
    for old, new in zip(evaluation.verdicts, after.verdicts, strict=True):
        assert not new.feasible
        if old.feasible:
            assert (new.reason, new.index) == ("no way", last)
            assert "can only be drawn back by 3 mm" in new.sentence
    assert remove_blocked_rolls(evaluation, Ceiling(evaluation, 5.5)).ranked == evaluation.ranked


def test_without_anything_around_only_the_drawing_back_counts():
    """At the end of its reach the arm can follow the path, but not draw the probe back outwards."""
    model = scene_model()
    q = model.home_rad + np.array((0.0, 0.55, -0.75, 0.0, 0.0, 0.0))
    face = model.forward(q[None])[0] @ model.T_flange_probe
    outward = face.translation * (1.0, 1.0, 0.0)
    outward /= np.linalg.norm(outward)
    found = None
    for reach_mm in np.arange(600.0, 1100.0, 2.0):  # the probe looks back at the robot's base
        along = np.linspace(-5.0, 5.0, 11)[:, None] * np.array((0.0, 0.0, 1.0))
        points = reach_mm * outward + np.array((0.0, 0.0, 700.0)) + along
        path = Path5D(points, np.tile(-outward, (11, 1)))
        rolls = evaluate_constant_rolls(
            path, model, working_set_deg(12, 0.0, 360.0), MarginLimits()
        )
        after = remove_blocked_rolls(rolls, None)
        if len(after.ranked) < len(rolls.ranked):
            found = rolls, after
            break
    assert found is not None
    rolls, after = found
    lost = {(p.index, p.branch) for p in rolls.ranked} - {(p.index, p.branch) for p in after.ranked}
    for index, branch in lost:
        roll_rad = np.deg2rad(rolls.verdicts[index].roll_deg)
        ends = joint_path(rolls.path, model, roll_rad, branch)[[0, -1]]
        probes = model.forward(ends) @ model.T_flange_probe
        back = Poses(probes.rotations, probes.translations - 5.0 * probes.rotations[:, :, 2])
        solved = model.inverse(back @ model.T_flange_probe.inv())
        limits = model.limits.clearance_rad(solved.qs_rad[:, branch]).min(axis=1)
        assert not (solved.valid[:, branch] & (limits >= 0.0)).all()
