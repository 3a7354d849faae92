"""Errors of links at the tip: against links that are really moved, and against the stated size."""

import numpy as np
import pytest

from rona_core.geometry.pose import Pose
from rona_core.robot.kinematics.catalog import robot_model
from rona_core.robot.kinematics.link_errors import link_errors, tip_sensitivities
from rona_core.robot.redundancy.scan_postures import with_other_roll
from rona_core.virtual.robot.joint_errors import JointErrors

POINT, DOWN = np.array((600.0, 60.0, 400.0)), np.array((0.0, 0.0, 1.0))


def around(name, n=200, seed=0):
    """Postures within 15 degrees of the one at rest."""
    model = robot_model(name)
    spread = np.random.default_rng(seed).uniform(-0.26, 0.26, (n, 6))
    return model, model.home_rad + spread


@pytest.mark.parametrize("name", ["rx90", "ur5", "ur10"])
def test_the_whole_is_as_large_as_stated_over_all_directions(name):
    model, qs = around(name)
    squares = sum(
        (tip_sensitivities(model, qs, np.tile(axis, (len(qs), 1)), 0.35) ** 2).sum(axis=1)
        for axis in np.eye(3)
    )
    assert np.sqrt(squares.mean()) == pytest.approx(0.35, rel=1e-6)


@pytest.mark.slow
def test_it_orders_places_as_links_do_that_are_really_off():
    """Over many robots: errors of two postures go together as far as the rows say."""
    model, qs = around("rx90", 12)
    normals = np.tile(DOWN, (len(qs), 1))
    faces = (model.forward(qs) @ model.T_flange_probe).translations
    rows = tip_sensitivities(model, qs, normals, 0.35)
    told = rows @ rows.T
    seen = np.array(
        [JointErrors(seed, model, 0.35).deviations(qs, faces)[0][:, 2] for seed in range(1500)]
    )
    true = seen.T @ seen / len(seen)
    size = np.sqrt(np.diag(told))
    told, true = told / np.outer(size, size), true / np.sqrt(np.outer(np.diag(true), np.diag(true)))
    assert np.abs(told - true).mean() < 0.1


def test_postures_far_apart_have_less_in_common():
    model, qs = around("rx90", 1)
    near, far = qs.copy(), qs.copy()
    near[0, 5] += 0.05
    far[0, 1:4] += 0.8  # a turn about the upright axis changes nothing along it
    rows = tip_sensitivities(model, np.vstack((qs, near, far)), np.tile(DOWN, (3, 1)), 0.35)
    assert np.linalg.norm(rows[0] - rows[1]) < 0.03 < 0.1 < np.linalg.norm(rows[0] - rows[2])


def test_another_roll_reaches_the_same_places_within_the_limits():
    model, qs = around("rx90", 30)
    turn_deg, found = with_other_roll(model, qs)
    before, after = (model.forward(q) @ model.T_flange_probe for q in (qs, found))
    np.testing.assert_allclose(after.translations, before.translations, atol=1e-6)
    np.testing.assert_allclose(after.rotations[:, :, 2], before.rotations[:, :, 2], atol=1e-9)
    cosine = np.einsum("ij,ij->i", after.rotations[:, :, 0], before.rotations[:, :, 0])
    np.testing.assert_allclose(cosine, np.cos(np.deg2rad(turn_deg)), atol=1e-9)
    assert (model.limits.clearance_rad(found) >= 0.0).all()


def test_where_nothing_was_scanned_there_is_no_other_roll():
    assert with_other_roll(robot_model("rx90"), np.zeros((0, 6))) is None


TIP = Pose.from_translation((0.0, 0.0, 120.0))
ARMS = pytest.mark.parametrize("name", ["rx90", "ur5", "ur10"])


def postures(n=30):
    return np.random.default_rng(5).uniform(-1.2, 1.2, (n, 6))


@ARMS
def test_shift_and_turn_have_the_same_share_of_what_is_stated(name):
    found = link_errors(robot_model(name), postures(), TIP, 0.35)
    shifts = (found[:, 3:] ** 2).sum(axis=(1, 2))
    assert np.sqrt(shifts.mean()) == pytest.approx(0.35)
    # shifts and twists of the links have the same share
    assert (found[:, 3:, :18] ** 2).sum() == pytest.approx((found[:, 3:, 18:] ** 2).sum())
    assert np.abs(found[:, :3, :18]).max() == 0.0  # a shift turns nothing


@ARMS
def test_an_error_of_the_last_link_is_fixed_to_the_tool_and_of_the_first_to_the_room(name):
    model, qs = robot_model(name), postures()
    found = link_errors(model, qs, TIP, 0.35)
    R_base_tip = (model.forward(qs) @ TIP).rotations
    for rows in (slice(0, 3), slice(3, 6)):
        of_last = np.swapaxes(R_base_tip, 1, 2) @ found[:, rows, 33:36]
        np.testing.assert_allclose(of_last, np.broadcast_to(of_last[:1], of_last.shape), atol=1e-12)
    turned = qs + np.array((0.7, 0.0, 0.0, 0.0, 0.0, 0.0))
    later = link_errors(model, turned, TIP, 0.35)
    assert np.linalg.norm(later[:, 3:], axis=(1, 2)) == pytest.approx(
        np.linalg.norm(found[:, 3:], axis=(1, 2))
    )


def test_an_exact_arm_has_none():
    assert np.abs(link_errors(robot_model("rx90"), postures(), TIP, 0.0)).max() == 0.0
