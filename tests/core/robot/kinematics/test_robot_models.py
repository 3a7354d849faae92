"""Laws that hold for every arm: RX90, UR5 and UR10 behind the same interface."""

import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.devices.robots import ROBOTS
from rona_core.geometry.path5d import Path5D
from rona_core.geometry.pose import Poses
from rona_core.robot.collision.obstacles import NOTHING_AROUND
from rona_core.robot.kinematics.arm import BRANCHES
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.pinocchio_model import (
    PinocchioArm,
    joint_placements,
    pinocchio_model,
)
from rona_core.robot.planning.calibration_motion import plan_tool_motion
from rona_core.robot.planning.plan_motion import plan_scan
from rona_core.robot.redundancy.margins import MarginLimits, compute_margins

MODELS = {name: robot_model(name) for name in ROBOTS}
every_arm = pytest.mark.parametrize("name", ROBOTS)
seeds = st.integers(0, 2**32 - 1)
quarter_turns = st.sampled_from((-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi))
tiny = st.sampled_from((0.0, 1e-15, -1e-12, 1e-9, -1e-7, 1e-5, 1e-3))


def random_joints(model, n, seed=1):
    return np.random.default_rng(seed).uniform(model.lower_rad, model.upper_rad, (n, 6))


def turned_apart(a, b):
    difference = a - b
    return np.abs(difference - 2 * np.pi * np.round(difference / (2 * np.pi)))


def residual_mm(model, poses, solutions):
    """Largest error of position (mm) and rotation of all branches that claim to reach."""
    rows, branches = np.nonzero(solutions.valid)
    back = model.forward(solutions.qs_rad[rows, branches])
    off = np.linalg.norm(back.translations - poses.translations[rows], axis=1).max(initial=0.0)
    return off, np.abs(back.rotations - poses.rotations[rows]).max(initial=0.0)


@every_arm
def test_up_of_one_posture_is_that_of_forward(name):
    model = MODELS[name]
    qs = random_joints(model, 200)
    ups = np.array([model.up_flange(q) for q in qs])
    np.testing.assert_allclose(ups, model.forward(qs).rotations[:, 2], atol=1e-14)


@every_arm
def test_forward_agrees_with_pinocchio(name):
    model = MODELS[name]
    qs = random_joints(model, 300)
    ours, theirs = model.forward(qs), PinocchioArm(model).forward(qs)
    np.testing.assert_allclose(ours.translations, theirs.translations, atol=1e-7)
    np.testing.assert_allclose(ours.rotations, theirs.rotations, atol=1e-10)


@every_arm
def test_joints_of_many_postures_are_where_pinocchio_places_each(name):
    built, flange = pinocchio_model(MODELS[name])
    state, qs = built.createData(), random_joints(MODELS[name], 100)
    rotations, places = joint_placements(built, qs)
    flanges = PinocchioArm(MODELS[name]).forward(qs)
    for i, q in enumerate(qs):
        pin.framesForwardKinematics(built, state, q)
        for joint, placed in enumerate(state.oMi):
            np.testing.assert_allclose(rotations[i, joint], placed.rotation, atol=1e-14)
            np.testing.assert_allclose(places[i, joint], placed.translation, atol=1e-14)
        last = state.oMf[flange]
        np.testing.assert_allclose(flanges.rotations[i], last.rotation, atol=1e-14)
        np.testing.assert_allclose(flanges.translations[i], 1e3 * last.translation, atol=1e-11)


@every_arm
@pytest.mark.parametrize("n", [3000, pytest.param(100_000, marks=pytest.mark.slow)])
def test_every_branch_reaches_poses_anywhere(name, n):
    model = MODELS[name]
    qs = random_joints(model, n)
    poses = model.forward(qs)
    solutions = model.inverse(poses)
    off_mm, turned = residual_mm(model, poses, solutions)
    assert off_mm <= 1e-6
    assert turned <= 1e-9
    nearest = turned_apart(solutions.qs_rad, qs[:, None]).max(axis=2)
    nearest[~solutions.valid] = np.inf
    assert np.quantile(nearest.min(axis=1), 0.999) <= 1e-9
    assert nearest.min(axis=1).max() <= 1e-5  # next to a singularity angles are worth less
    assert np.abs(solutions.qs_rad).max() <= np.pi


@every_arm
def test_answers_differ_from_each_other(name):
    model = MODELS[name]
    poses = model.forward(random_joints(model, 300, seed=9))
    solutions = model.inverse(poses)
    apart = turned_apart(solutions.qs_rad[:, :, None], solutions.qs_rad[:, None]).max(axis=3)
    apart[:, np.arange(8), np.arange(8)] = np.inf
    ok = solutions.valid[:, :, None] & solutions.valid[:, None]
    clear = np.minimum(solutions.sin_elbows, solutions.sin_wrist) > 0.02
    clear &= (solutions.wrist_distance_mm > 5.0)[:, None]
    ok &= clear[:, :, None] & clear[:, None]
    assert ok.any()
    assert apart[ok].min() > 1e-3


@every_arm
def test_margins_are_those_that_pinocchio_finds_from_the_placement_of_the_joints(name):
    model = MODELS[name]
    qs = random_joints(model, 300, seed=2)
    solutions = model.inverse(model.forward(qs))
    branch = turned_apart(solutions.qs_rad, qs[:, None]).max(axis=2).argmin(axis=1)
    rows = np.arange(len(qs))
    wrist, elbow, shoulder_mm = PinocchioArm(model).singular_margins(qs)
    np.testing.assert_allclose(wrist, solutions.sin_wrist[rows, branch], atol=1e-9)
    np.testing.assert_allclose(elbow, solutions.sin_elbows[rows, branch], atol=1e-9)
    np.testing.assert_allclose(shoulder_mm, solutions.wrist_distance_mm, atol=1e-6)


@every_arm
def test_the_jacobian_vanishes_with_the_product_of_the_three_factors(name):
    model = MODELS[name]
    qs = random_joints(model, 40, seed=5)
    axes, origins = PinocchioArm(model).joint_axes(qs)
    center = origins[:, 5][:, None]  # determinants do not depend on the point
    arms = np.cross(axes, center - origins)
    determinants = np.abs(np.linalg.det(np.concatenate((arms, axes), axis=2)))
    wrist, elbow, shoulder_mm = PinocchioArm(model).singular_margins(qs)
    lengths = model.arm.upper_arm_mm * model.arm.forearm_mm
    np.testing.assert_allclose(determinants, lengths * wrist * elbow * shoulder_mm, rtol=1e-6)


@every_arm
@given(seed=seeds, joint=st.sampled_from((1, 2, 4)), at=quarter_turns, off=tiny)
@settings(max_examples=60, deadline=None)
def test_singular_postures_are_answered_with_margins(name, seed, joint, at, off):
    model = MODELS[name]
    q = np.random.default_rng(seed).uniform(-3.0, 3.0, (1, 6))
    q[0, joint] = at + off
    check_answer(model, model.forward(q))


@every_arm
@given(seed=seeds, off=tiny, height=st.floats(-1500.0, 1500.0), straight=st.booleans())
@settings(max_examples=60, deadline=None)
def test_a_wrist_above_axis_one_is_answered_with_margins(name, seed, off, height, straight):
    model = MODELS[name]
    rotation = model.forward(np.random.default_rng(seed).uniform(-3, 3, (1, 6))).rotations
    if straight:
        rotation = np.eye(3)[None]
    back = model.arm.flange_mm * rotation[:, :, 2]
    poses = Poses(rotation, back + np.array((off, 0.0, height)))
    solutions = check_answer(model, poses, known=False)
    assert solutions.wrist_distance_mm[0] <= abs(off) + 1e-9


@every_arm
def test_all_joints_at_zero_and_at_right_angles_are_answered(name):
    model = MODELS[name]
    grid = np.array(np.meshgrid(*[(-np.pi / 2, 0.0, np.pi / 2)] * 6)).reshape(6, -1).T
    poses = model.forward(grid)
    check_answer(model, poses)


def check_answer(model, poses, known=True):
    solutions = model.inverse(poses)
    assert np.isfinite(solutions.qs_rad).all()
    assert np.isfinite(solutions.reaches_mm).all()
    assert ((solutions.reaches_mm >= -1e-8) | ~solutions.valid).all()
    off_mm, turned = residual_mm(model, poses, solutions)
    assert off_mm <= 1e-6
    assert turned <= 1e-9
    if known:
        near = solutions.reaches_mm.max(axis=1) >= -1e-6
        assert near.all()
        edge = np.abs(solutions.reaches_mm).min(axis=1) < 1e-6  # stretched: rounding decides
        assert (solutions.valid.any(axis=1) | edge).all()
    return solutions


@every_arm
def test_far_poses_say_how_far_they_are_outside(name):
    model = MODELS[name]
    poses = Poses(np.repeat(np.eye(3)[None], 2, axis=0), np.array(((3000.0, 0, 0), (0, 0, 4000.0))))
    solutions = model.inverse(poses)
    assert not solutions.valid.any()
    reach = model.arm.upper_arm_mm + model.arm.forearm_mm
    assert (solutions.reaches_mm < reach - 2500.0).all()
    check_answer(model, poses, known=False)


@every_arm
def test_a_branch_keeps_its_label_along_a_path(name):
    model = MODELS[name]
    ends = random_joints(model, 200, seed=7)
    for start, end in zip(ends[:100], ends[100:], strict=True):
        q = start + np.linspace(0.0, 0.02, 40)[:, None] * (end - start)
        solutions = model.inverse(model.forward(q))
        clear = np.minimum(solutions.sin_elbows, solutions.sin_wrist).min(axis=0) > 0.1
        clear &= solutions.wrist_distance_mm.min() > 60.0
        clear &= solutions.valid.all(axis=0)
        steps = turned_apart(solutions.qs_rad[1:], solutions.qs_rad[:-1]).max(axis=(0, 2))
        assert (steps[clear] < 0.2).all()


@every_arm
def test_chunks_make_no_difference(name):
    model = MODELS[name]
    poses = model.forward(random_joints(model, 1030, seed=6))
    whole, part = model.inverse(poses), model.inverse(poses.select(slice(1020, 1030)))
    np.testing.assert_allclose(whole.qs_rad[1020:], part.qs_rad, atol=1e-14)
    assert len(model.inverse(poses.select(slice(0, 0)))) == 0


@every_arm
def test_labels_are_those_of_the_angles(name):
    model = MODELS[name]
    solutions = model.inverse(model.forward(random_joints(model, 500, seed=4)))
    for index, branch in enumerate(BRANCHES):
        q = solutions.qs_rad[solutions.valid[:, index], index]
        assert len(q) > 200
        assert ((q[:, 4] >= 0) == (branch.wrist == "plain")).all()
        bends = q[:, 2] if branch.shoulder == "front" else -q[:, 2]
        assert ((bends >= 0) == (branch.elbow == "above")).all()


@every_arm
def test_home_points_the_tool_down_clear_of_the_limits_and_of_the_head(name):
    model = MODELS[name]
    assert model.limits.clearance_rad(model.home_rad).min() > np.deg2rad(10)
    T_base_tip = model.forward(model.home_rad[None])[0] @ model.T_flange_tip
    np.testing.assert_allclose(T_base_tip.rotation[:, 2], (0, 0, -1), atol=1e-9)
    assert np.linalg.norm(T_base_tip.translation - model.work_area.region_base) > 180.0
    assert np.isfinite(model.home_rad).all()
    assert not model.home_rad.flags.writeable


@pytest.mark.sweep(1)
@every_arm
def test_the_tool_motion_in_the_work_area_is_certified(name):
    motion = plan_tool_motion(MODELS[name])
    assert motion.certificate.certifies(motion, MODELS[name], NOTHING_AROUND)
    np.testing.assert_allclose(
        motion.T_base_tip_center.translation, MODELS[name].work_area.pivot_base
    )


@pytest.mark.sweep(1)
@every_arm
def test_a_path_in_the_work_area_is_planned_and_certified(name):
    model = MODELS[name]
    steps = np.linspace(-20.0, 20.0, 41)
    points = np.array(model.work_area.region_base) + np.stack(
        (steps, 10.0 * np.sin(steps / 8.0), np.zeros(41)), axis=1
    )
    tilted = np.stack((0.005 * steps, np.zeros(41), -np.ones(41)), axis=1)
    path = Path5D(points, tilted / np.linalg.norm(tilted, axis=1, keepdims=True))
    plan = plan_scan(path, model)
    assert plan.may_move
    assert plan.search.n_feasible >= 20


@every_arm
def test_rooms_of_a_branch_are_its_own(name):
    """A branch with a bent elbow passes where another branch has a straight one."""
    model = MODELS[name]
    qs = random_joints(model, 4000, seed=11)
    solutions = model.inverse(model.forward(qs))
    margins = compute_margins(model, model.forward(qs), MarginLimits())
    sine = np.minimum(solutions.sin_elbows, solutions.sin_wrist)
    clear = (sine > np.sin(np.deg2rad(5.0))) & (solutions.wrist_distance_mm > 30.0)[:, None]
    np.testing.assert_array_equal(margins.singularity > 0.0, clear)
    assert ((margins.reach >= 0.0) == solutions.valid).all()


@every_arm
def test_models_go_to_another_process_whole(name):
    model = MODELS[name]
    copy = pickle.loads(pickle.dumps(model))
    qs = random_joints(model, 3)
    np.testing.assert_array_equal(copy.forward(qs).translations, model.forward(qs).translations)
    assert copy.name == name
