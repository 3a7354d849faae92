"""Forward and inverse kinematics of the arm, and the joint limits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Poses
from rona_core.robot.kinematics.arm import BRANCHES
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.pinocchio_model import PinocchioArm
from rona_core.robot.kinematics.robot_model import JointLimits, shift_to_fit
from rona_core.robot.kinematics.rx90 import PROVENANCE
from rona_core.robot.kinematics.wrists import SphericalWristArm

RX90 = robot_model("rx90")
LIMIT_DEG = 160.0


def random_joints(n, seed=1):
    rng = np.random.default_rng(seed)
    return rng.uniform(RX90.lower_rad, RX90.upper_rad, (n, 6))


def angle_between(a, b):
    difference = a - b
    return np.abs(difference - 2 * np.pi * np.round(difference / (2 * np.pi)))


def test_forward_agrees_with_pinocchio():
    qs = random_joints(500)
    ours, theirs = RX90.forward(qs), PinocchioArm(RX90).forward(qs)
    np.testing.assert_allclose(ours.translations, theirs.translations, atol=1e-9)
    np.testing.assert_allclose(ours.rotations, theirs.rotations, atol=1e-12)


def test_forward_agrees_with_a_denavit_hartenberg_table():
    lengths = np.array((0, 450.0, 0, 0, 0, 0))
    offsets = np.array((420.0, 0, 0, 450.0, 0, 85.0))
    twists = np.deg2rad((-90.0, 0, 90.0, -90.0, 90.0, 0))
    zeros = np.deg2rad((0, -90.0, 90.0, 0, 0, 0))
    for q in random_joints(20, seed=2):
        T = np.eye(4)
        for theta, d, a, alpha in zip(q + zeros, offsets, lengths, twists, strict=True):
            c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
            T = T @ np.array(
                [
                    [c, -s * ca, s * sa, a * c],
                    [s, c * ca, -c * sa, a * s],
                    [0, sa, ca, d],
                    [0, 0, 0, 1],
                ]
            )
        np.testing.assert_allclose(RX90.forward(q[None])[0].matrix(), T, atol=1e-9)


def test_upright_height_is_the_sum_of_the_lengths():
    pose = RX90.forward(np.zeros((1, 6)))[0]
    np.testing.assert_allclose(pose.translation, (0, 0, 1405.0), atol=1e-12)


def test_link_frames_end_at_the_flange_and_keep_the_lengths():
    for q in random_joints(20, seed=3):
        frames = RX90.joint_poses(q)
        assert len(frames) == 7
        flange = RX90.forward(q[None])[0]
        np.testing.assert_allclose(frames[6].matrix(), flange.matrix(), atol=1e-10)
        steps = np.linalg.norm(np.diff(frames.translations, axis=0), axis=1)
        np.testing.assert_allclose(steps, (420, 0, 450, 450, 0, 85), atol=1e-10)


def test_every_branch_reaches_the_pose_and_the_original_is_among_them():
    qs = random_joints(20_000)
    poses = RX90.forward(qs)
    solutions = RX90.inverse(poses)
    assert solutions.valid.all()
    back = RX90.forward(solutions.qs_rad.reshape(-1, 6))
    assert np.abs(back.translations - np.repeat(poses.translations, 8, axis=0)).max() <= 1e-6
    assert np.abs(back.rotations - np.repeat(poses.rotations, 8, axis=0)).max() <= 1e-9
    nearest = angle_between(solutions.qs_rad, qs[:, None]).max(axis=2).min(axis=1)
    assert nearest.max() <= 1e-9
    assert np.abs(solutions.qs_rad).max() <= np.pi


def test_branches_are_what_their_labels_say():
    qs = random_joints(2000, seed=4)
    solutions = RX90.inverse(RX90.forward(qs))
    for index, branch in enumerate(BRANCHES):
        q = solutions.qs_rad[:, index]
        lean = q[:, 1] + q[:, 2]
        out = 450 * np.sin(q[:, 1]) + 450 * np.sin(lean)
        assert ((out >= 0) == (branch.shoulder == "front")).all()
        assert ((q[:, 4] >= 0) == (branch.wrist == "plain")).all()
        # height of the elbow over the line from shoulder to wrist
        up = 450 * np.cos(q[:, 1]) + 450 * np.cos(lean)
        over = 450 * np.cos(q[:, 1]) - up / 2
        assert ((over >= 0) == (branch.elbow == "above")).all()
    assert len({branch.label for branch in BRANCHES}) == 8


def test_the_singular_factors_are_those_of_the_jacobian():
    qs = random_joints(12, seed=5)
    solutions = RX90.inverse(RX90.forward(qs))
    step = 1e-6
    for i, q in enumerate(qs):
        columns = []
        for joint in range(6):
            shift = np.eye(6)[joint] * step
            a, b = RX90.forward((q - shift)[None])[0], RX90.forward((q + shift)[None])[0]
            # move the flange point to the wrist centre, where the determinant factors
            ca, cb = a @ np.array((0, 0, -85.0)), b @ np.array((0, 0, -85.0))
            spin = (b.rotation - a.rotation) @ RX90.forward(q[None])[0].rotation.T / (2 * step)
            columns.append((*((cb - ca) / (2 * step)), spin[2, 1], spin[0, 2], spin[1, 0]))
        determinant = abs(np.linalg.det(np.array(columns)))
        branch = angle_between(solutions.qs_rad[i], q).max(axis=1).argmin()
        factors = (
            450.0**2
            * solutions.sin_elbows[i, 0]
            * solutions.sin_wrist[i, branch]
            * solutions.wrist_distance_mm[i]
        )
        assert determinant == pytest.approx(factors, rel=1e-4)


@given(angle=st.floats(-0.5, 0.5), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_turning_the_base_shifts_joint_one_alone(angle, seed):
    q = np.random.default_rng(seed).uniform(RX90.lower_rad, RX90.upper_rad, (1, 6))
    pose = RX90.forward(q)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))
    turned = Poses(turn @ pose.rotations, pose.translations @ turn.T)
    before, after = RX90.inverse(pose).qs_rad[0], RX90.inverse(turned).qs_rad[0]
    shift = angle_between(after - before, np.array((angle, 0, 0, 0, 0, 0)))
    assert shift.max() <= 1e-7


def test_out_of_reach_and_singular_poses_answer_with_margins():
    stretched = RX90.inverse(RX90.forward(np.zeros((1, 6))))
    assert stretched.valid.all()
    assert stretched.sin_elbows[0, 0] <= 1e-6
    assert stretched.sin_wrist[0].max() <= 1e-12
    assert stretched.wrist_distance_mm[0] <= 1e-12
    far = Poses(np.eye(3)[None], np.array(((1500.0, 0.0, 505.0),)))
    beyond = RX90.inverse(far)
    assert not beyond.valid.any()
    assert beyond.reaches_mm[0].max() == pytest.approx(900.0 - 1500.0)
    assert np.isfinite(beyond.qs_rad).all()


@pytest.mark.parametrize("q5", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_nearly_stretched_wrist_still_reaches_the_pose(q5):
    q = np.array(((0.3, 0.4, 1.1, 0.7, q5, -0.4),))
    pose = RX90.forward(q)
    solutions = RX90.inverse(pose)
    back = RX90.forward(solutions.qs_rad[0])
    assert np.abs(back.rotations - pose.rotations).max() <= 1e-12
    assert solutions.sin_wrist[0, 0] == pytest.approx(np.sin(q5), abs=1e-15)
    sums = solutions.qs_rad[0, 0, 3] + solutions.qs_rad[0, 0, 5]
    assert angle_between(sums, 0.7 - 0.4) <= 1e-9


def test_chunks_make_no_difference():
    poses = RX90.forward(random_joints(1030, seed=6))
    whole = RX90.inverse(poses)
    part = RX90.inverse(poses.select(slice(1020, 1030)))
    np.testing.assert_array_equal(whole.qs_rad[1020:], part.qs_rad)
    assert len(RX90.inverse(poses.select(slice(0, 0)))) == 0


def test_unequal_arms_have_an_inner_border_of_reach():
    arm = SphericalWristArm(400.0, 500.0, 300.0, 80.0)
    pose = Poses(np.eye(3)[None], np.array(((150.0, 0.0, 480.0),)))
    solutions = arm.inverse(pose)
    assert not solutions.valid.any()
    assert solutions.reaches_mm[0].max() == pytest.approx(-50.0)


def test_degenerate_input_is_refused_by_name():
    with pytest.raises(InvalidInputError, match="known robots: rx90"):
        robot_model("puma")
    with pytest.raises(InvalidInputError, match="qs_rad must have shape"):
        RX90.forward(np.zeros(6))
    with pytest.raises(InvalidInputError, match="q_rad must be finite"):
        RX90.joint_poses(np.full(6, np.nan))
    with pytest.raises(InvalidInputError, match="forearm_mm"):
        SphericalWristArm(1.0, 1.0, 0.0, 1.0)
    with pytest.raises(InvalidInputError, match="below the upper"):
        JointLimits(np.ones(6), np.zeros(6), np.ones(6), np.ones(6))


def test_home_is_inside_the_limits_and_points_the_tool_down():
    assert RX90.limits.clearance_rad(RX90.home_rad).min() > np.deg2rad(10)
    T_base_tip = RX90.forward(RX90.home_rad[None])[0] @ RX90.T_flange_tip
    np.testing.assert_allclose(T_base_tip.rotation[:, 2], (0, 0, -1), atol=1e-12)
    T_tip_toolmarker = RX90.T_flange_tip.inv() @ RX90.T_flange_toolmarker
    np.testing.assert_allclose(T_tip_toolmarker.inv().translation, (0, -150, -40), atol=1e-12)


def test_each_figure_of_the_model_names_its_source():
    figures = {figure.name: figure for figure in PROVENANCE}
    assert figures["acceleration"].trust == "assumed"
    assert all(figure.source and figure.unit for figure in PROVENANCE)
    np.testing.assert_allclose(np.rad2deg(RX90.upper_rad), figures["upper limit"].values)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_shifting_finds_the_best_of_all_full_turns(seed):
    rng = np.random.default_rng(seed)
    low, high = np.deg2rad((-270.0, 270.0))
    curve = np.cumsum(rng.uniform(-0.4, 0.4 + rng.uniform(0, 0.3), (40, 1)), axis=0)
    curve += rng.uniform(-4, 4)
    chosen = shift_to_fit(curve, low, high)[:, 0]

    def rank(values):
        room = np.minimum(values - low, high - values)
        if room.min() >= 0:
            return len(values), room.min()
        return int(np.argmax(room < 0)), -np.inf

    every = [rank(curve[:, 0] + 2 * np.pi * k) for k in range(-6, 7)]
    best = max(every)
    assert rank(chosen)[0] == best[0]
    if np.isfinite(best[1]):
        assert rank(chosen)[1] == pytest.approx(best[1], abs=1e-9)
