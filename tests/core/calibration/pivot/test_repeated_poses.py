"""A pose that the tracker repeats is one measurement, however many rows it has."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.calibration.handheld.pointer import calibrate_recorded_pivot
from rona_core.calibration.pivot.motion_extent import repeated_poses
from rona_core.calibration.pivot.pivot_calibration import REPEATED, solve_pivot
from rona_core.errors import DegenerateGeometryError
from rona_core.geometry.pose import Poses
from tests.helpers.pivot_data import BODY, TIP, poses
from tests.helpers.recorded_pivots import random_pivot


def held(made, starts, length):
    """Return poses in which runs repeat the pose before them, as some trackers do."""
    rows = np.arange(len(made))
    for start in starts:
        rows[start : start + length] = start
    return made.select(rows), rows


@pytest.mark.sweep(4)
@pytest.mark.parametrize("method", ["ml", "sphere"])
@pytest.mark.parametrize("seed", range(6))
def test_runs_change_nothing(seed, method):
    """The law: repeating poses, here or there and however often, is no information."""
    made = random_pivot(seed, n=120).poses
    counts = np.random.default_rng(seed).choice((1, 1, 1, 2, 5, 60), 120)
    a = calibrate_recorded_pivot(made, method=method)
    b = calibrate_recorded_pivot(made.select(np.repeat(np.arange(120), counts)), method=method)
    np.testing.assert_allclose(b.tip_marker, a.tip_marker, atol=1e-6)
    assert b.sigma_mm == pytest.approx(a.sigma_mm, rel=1e-6)
    assert (b.verdict, b.reasons, b.n_used, b.n_rejected) == (
        a.verdict,
        a.reasons,
        a.n_used,
        a.n_rejected,
    )
    assert b.n_repeated == counts.sum() - 120


@pytest.mark.slow
def test_the_predicted_error_is_that_of_the_poses_that_differ():
    ratios = []
    for seed in range(60):
        right = random_pivot(500 + seed, n=150, outliers=False, noise_mm=0.3)
        found = calibrate_recorded_pivot(held(right.poses, (30,), 100)[0])
        ratios.append(np.linalg.norm(found.tip_marker - right.tip) / found.sigma_mm)
    assert 0.6 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_runs_are_equal_up_to_print_and_sign_of_quaternions():
    made, rows = held(poses(1, n=40, sigma_mm=0.1)[0], (5, 20), 8)
    expected = np.concatenate(([False], np.diff(rows) == 0))
    np.testing.assert_array_equal(repeated_poses(made), expected)
    q = Rotation.from_matrix(made.rotations).as_quat() * np.where(np.arange(40) % 2, 1, -1)[:, None]
    printed = Poses(Rotation.from_quat(q.round(6)).as_matrix(), made.translations.round(3))
    np.testing.assert_array_equal(repeated_poses(printed), expected)
    single = Poses(made.rotations.astype(np.float32), made.translations.astype(np.float32))
    np.testing.assert_array_equal(repeated_poses(single), expected)
    assert repeated_poses(Poses.stack([])).shape == (0,)


def test_no_measured_pose_repeats_another():
    for seed in range(10):
        assert not repeated_poses(random_pivot(seed, noise_mm=0.1).poses).any()


def test_repeated_poses_are_listed_and_too_few_others_are_refused():
    made, _ = held(poses(2, n=60, sigma_mm=0.05)[0], (10,), 21)
    fit = solve_pivot(made, dof=6, method="ml", at_least=10, positions_marker=BODY)
    assert fit.n_repeated == 20
    assert [r.index for r in fit.rejected if r.reason == REPEATED] == list(range(11, 31))
    assert np.linalg.norm(fit.tip_marker - TIP) < 0.5
    few, _ = held(poses(3, n=60)[0], range(0, 60, 10), 10)
    with pytest.raises(
        DegenerateGeometryError, match=r"only 6 of 60 poses differ .* in view"
    ) as no:
        solve_pivot(few, dof=6, method="ml", at_least=10, positions_marker=BODY)
    assert no.value.data["cause"] == "repeated"
