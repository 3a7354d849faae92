"""The tip of a tool by turning it in a seat: exact, as sure as it says, and refused by name."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.calibration.hand_eye.seated_tip import MIN_POSES, solve_seated_tip
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses

SEAT = np.array((560.0, -50.0, 560.0))
OFFSET = np.array((0.31, -0.22, 0.14))
seeds = st.integers(0, 2**32 - 1)


def turned(offset, n=30, cone_deg=30.0, seed=1):
    """Return poses (n) that a robot believes of its tip while the true one sits in the seat."""
    random = np.random.default_rng(seed)
    tilts = np.deg2rad(cone_deg) * random.uniform(-1.0, 1.0, (n, 2))
    vectors = np.column_stack((tilts, random.uniform(-0.2, 0.2, n)))
    down = np.diag((1.0, -1.0, -1.0))
    rotations = down @ Rotation.from_rotvec(vectors).as_matrix()
    return Poses(rotations, SEAT - rotations @ offset)


@settings(max_examples=25)
@given(seeds)
def test_an_offset_is_found_exactly_where_nothing_errs(seed):
    random = np.random.default_rng(seed)
    offset = random.normal(0.0, 0.5, 3)
    found = solve_seated_tip(turned(offset, n=8, seed=seed))
    np.testing.assert_allclose(found.offset_tip, offset, atol=1e-9)
    np.testing.assert_allclose(found.seat_base, SEAT, atol=1e-9)
    assert found.residuals_mm.max() < 1e-9
    # another place and another base change nothing of the tool
    T = Pose.from_rotvec(random.normal(size=3), random.normal(0.0, 300.0, 3))
    again = solve_seated_tip(T @ turned(offset, n=8, seed=seed))
    np.testing.assert_allclose(again.offset_tip, offset, atol=1e-9)
    np.testing.assert_allclose(again.seat_base, T @ SEAT, atol=1e-9)


def test_a_marker_on_the_flange_knows_nothing_of_the_tip():
    """Without a seat the flange moves as it is told wherever the tip is: the offset is zero."""
    free = turned(np.zeros(3))
    np.testing.assert_allclose(solve_seated_tip(free).offset_tip, 0.0, atol=1e-9)


def test_the_covariance_is_that_of_many_draws():
    poses, sd_mm, random = turned(OFFSET, n=20), 0.05, np.random.default_rng(3)
    errors, predicted = [], []
    for _ in range(400):
        off = random.normal(0.0, sd_mm, (20, 3))
        found = solve_seated_tip(Poses(poses.rotations, poses.translations + off))
        errors.append(found.offset_tip - OFFSET)
        predicted.append(found.covariance)
    spread, claimed = np.cov(np.array(errors).T), np.mean(predicted, axis=0)
    np.testing.assert_allclose(np.diag(spread) / np.diag(claimed), 1.0, atol=0.25)
    squares = [e @ np.linalg.solve(P, e) / 3 for e, P in zip(errors, predicted, strict=True)]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_errors_of_the_robot_move_it_as_the_derivatives_say():
    poses = turned(OFFSET, n=12)
    true_minus_believed = 0.3 * np.random.default_rng(4).normal(size=(12, 3))
    found = solve_seated_tip(Poses(poses.rotations, poses.translations - true_minus_believed))
    moved = np.einsum("knj,nj->k", found.by_robot, true_minus_believed)
    np.testing.assert_allclose(found.offset_tip - OFFSET, moved, atol=1e-9)


def test_a_pose_left_out_does_not_count_and_keeps_its_residual():
    poses = turned(OFFSET, n=9)
    translations = poses.translations.copy()
    translations[4] += (5.0, 0.0, 0.0)
    slipped = Poses(poses.rotations, translations)
    out = np.arange(9) == 4
    found = solve_seated_tip(slipped, out)
    np.testing.assert_allclose(found.offset_tip, OFFSET, atol=1e-9)
    assert found.residuals_mm[4] == pytest.approx(5.0)
    assert not found.by_robot[:, 4].any()
    assert np.linalg.norm(solve_seated_tip(slipped).offset_tip - OFFSET) > 0.1


def test_what_does_not_tell_the_tip_is_refused_by_name():
    with pytest.raises(InvalidInputError, match=f"at least {MIN_POSES} poses in its seat, not 4"):
        solve_seated_tip(turned(OFFSET, n=4))
    with pytest.raises(DegenerateGeometryError, match="hardly turned"):
        solve_seated_tip(turned(OFFSET, cone_deg=0.0).select(np.zeros(9, dtype=np.int64)))
    one_axis = Rotation.from_rotvec(np.outer(np.linspace(-0.5, 0.5, 9), (1.0, 0.0, 0.0)))
    with pytest.raises(DegenerateGeometryError, match="one plane"):
        solve_seated_tip(Poses(one_axis.as_matrix(), np.tile(SEAT, (9, 1))))
