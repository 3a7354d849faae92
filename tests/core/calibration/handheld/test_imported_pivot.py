"""Calibration of recorded pivots: the tip, its verdict, and why there is none."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rona_core.calibration.handheld.pointer import calibrate_recorded_pivot
from rona_core.calibration.pivot.pivot_calibration import solve_pivot
from rona_core.calibration.tracking_error import EVEN
from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Poses
from rona_core.geometry.rigid_fit import fit_rigid_many
from tests.helpers.pivot_data import TIP, poses
from tests.helpers.strategies import random_pose, seeds

METHODS = ("ml", "sphere")


@pytest.mark.parametrize("method", METHODS)
def test_poses_without_noise_give_tip_and_pivot(method):
    made, pivot = poses(n=80)
    found = calibrate_recorded_pivot(made, method=method)
    assert (found.verdict, found.reasons, found.n_used, found.n_rejected) == ("good", (), 80, 0)
    np.testing.assert_allclose(found.tip_marker, TIP, atol=1e-6)
    np.testing.assert_allclose(found.pivot_tracker, pivot, atol=1e-6)
    assert found.rmse_mm < 1e-6


@settings(max_examples=10)
@given(seed=seeds)
def test_moving_the_tracker_moves_the_pivot_and_not_the_tip(seed):
    made, _ = poses(1, n=60, sigma_mm=0.2)
    motion = random_pose(np.random.default_rng(seed), 500.0)
    a = calibrate_recorded_pivot(made, method="ml")
    b = calibrate_recorded_pivot(motion @ made, method="ml")
    np.testing.assert_allclose(b.tip_marker, a.tip_marker, atol=1e-6)
    np.testing.assert_allclose(b.pivot_tracker, motion @ a.pivot_tracker, atol=1e-6)
    assert (b.verdict, b.n_used) == (a.verdict, a.n_used)
    assert b.sigma_mm == pytest.approx(a.sigma_mm, rel=1e-6)


def test_the_scatter_is_the_rms_distance_of_the_used_tips():
    made, _ = poses(2, n=70, sigma_mm=0.3)
    found = calibrate_recorded_pivot(made, method="ml")
    away = np.linalg.norm(made @ found.tip_marker - found.pivot_tracker, axis=1)
    if found.n_rejected == 0:
        assert found.rmse_mm == pytest.approx(np.sqrt((away**2).mean()))
    assert found.rmse_mm <= np.sqrt((away**2).mean()) + 1e-12


def test_gross_errors_are_counted_and_do_not_count():
    made, _ = poses(3, n=100, sigma_mm=0.1)
    t = made.translations.copy()
    t[::20] += 30.0
    found = calibrate_recorded_pivot(Poses(made.rotations, t))
    assert (found.n_used, found.n_rejected) == (95, 5)
    assert np.linalg.norm(found.tip_marker - TIP) < 0.5
    t[::7] += 30.0
    found = calibrate_recorded_pivot(Poses(made.rotations, t))
    assert found.verdict == "weak"
    assert "poses are rejected" in " ".join(found.reasons)


def planar(n=60):
    turns = Rotation.from_rotvec(np.column_stack((np.linspace(-0.5, 0.5, n), np.zeros((n, 2)))))
    rotations = turns.as_matrix()
    return Poses(rotations, np.array([0.0, 0.0, 1500.0]) - rotations @ TIP)


def slipping():
    made, _ = poses(4, n=60)
    t = made.translations.copy()
    t[20:] += np.linspace(0.0, 40.0, 40)[:, None]
    return Poses(made.rotations, t)


def still():
    made, _ = poses(5, n=1)
    return Poses(np.repeat(made.rotations, 40, axis=0), np.repeat(made.translations, 40, axis=0))


BAD = {
    "few": (lambda: poses(n=7)[0], "too few poses: at least 10 are needed, not 7"),
    "none": (lambda: Poses.stack([]), "too few poses"),
    "static": (still, "hardly turned"),
    "planar": (planar, "one plane"),
    "narrow": (lambda: poses(n=60, half_angle_deg=3.0)[0], "half-angle"),
    "creep": (slipping, "share no tip|centre uncertain"),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("make", "words"), BAD.values(), ids=BAD)
def test_what_determines_no_tip_is_bad_with_its_reason_and_without_figures(make, words, method):
    made = make()
    found = calibrate_recorded_pivot(made, method=method)
    assert found.verdict == "bad"
    assert re.search(words, found.reasons[0])
    assert found.tip_marker is found.pivot_tracker is found.sigma_mm is found.rmse_mm is None
    assert (found.n_used, found.n_rejected) == (0, len(made))


def test_a_narrow_and_noisy_swing_is_not_good_and_says_what_to_do():
    weak = calibrate_recorded_pivot(poses(6, n=60, half_angle_deg=8.0, sigma_mm=0.35)[0])
    assert weak.verdict == "weak"
    assert any("sweep to" in reason for reason in weak.reasons)
    bad = calibrate_recorded_pivot(poses(6, n=15, half_angle_deg=7.0, sigma_mm=1.0)[0])
    assert bad.verdict == "bad"
    assert any("sweep to" in reason for reason in bad.reasons)


BODY = np.array([[-45.0, -28.0, 0.0], [43.0, -34.0, 0.0], [36.0, 31.0, 0.0], [-34.0, 33.0, 0.0]])


def measured(made, shape_mm, seed):
    """The poses fitted to markers of BODY at these poses, with errors (3,) per axis."""
    rng = np.random.default_rng(seed)
    points = np.einsum("nij,mj->nmi", made.rotations, BODY) + made.translations[:, None]
    points = points + rng.normal(size=points.shape) * shape_mm
    return fit_rigid_many(BODY, points, np.ones(points.shape[:2], dtype=np.bool_)).Ts_b_a


@pytest.mark.parametrize(
    ("ratio", "trials"),
    [(3.0, 4), *(pytest.param(ratio, 60, marks=pytest.mark.slow) for ratio in (1.0, 3.0))],
)
def test_likelihood_beats_the_sphere_with_and_without_a_geometry_and_knows_its_error(ratio, trials):
    shape = np.array((1.0, 1.0, ratio)) * 0.35 / np.sqrt(2.0 + ratio**2)
    squares = {"geometry": [], "none": [], "sphere": []}
    nees = {"geometry": [], "none": []}
    for seed in range(trials):
        seen = measured(poses(seed, n=60)[0], shape, seed)
        found = {
            "geometry": calibrate_recorded_pivot(seen, geometry_marker=BODY),
            "none": calibrate_recorded_pivot(seen),
            "sphere": calibrate_recorded_pivot(seen, method="sphere"),
        }
        for name, one in found.items():
            off = float(((one.tip_marker - TIP) ** 2).sum())
            squares[name].append(off)
            if name in nees:
                nees[name].append(off / one.sigma_mm**2)
    rms = {name: np.sqrt(np.mean(values)) for name, values in squares.items()}
    assert rms["geometry"] < 1.02 * rms["none"] < rms["sphere"]
    assert all(0.6 < np.mean(values) < 1.6 for values in nees.values())


@pytest.mark.parametrize(
    ("ratio", "least", "trials"),
    [(6.0, 1.0, 8)]
    + [
        pytest.param(ratio, least, 60, marks=pytest.mark.slow)
        for ratio, least in ((1.0, 0.97), (3.0, 1.1), (6.0, 1.3))
    ],
)
def test_depth_errors_are_found_in_the_scatter_and_weighed(ratio, least, trials):
    shape = np.array((1.0, 1.0, ratio)) * 0.35 / np.sqrt(2.0 + ratio**2)
    even, found, nees = [], [], []
    for seed in range(trials):
        seen = measured(poses(seed, n=60)[0], shape, seed)
        fit = solve_pivot(seen, dof=6, method="ml", at_least=10, positions_marker=BODY, noise=EVEN)
        even.append(((fit.tip_marker - TIP) ** 2).sum())
        one = calibrate_recorded_pivot(seen, geometry_marker=BODY)
        found.append(((one.tip_marker - TIP) ** 2).sum())
        nees.append(found[-1] / one.sigma_mm**2)
    assert np.sqrt(np.mean(even) / np.mean(found)) > least
    wide = np.sqrt(60 / trials)
    assert 0.7 / wide < np.mean(nees) < 1.4 * wide


def test_a_5d_tool_has_its_tip_on_the_line():
    made, pivot = poses(n=80, tip=(0.0, 0.0, 290.0))
    found = calibrate_recorded_pivot(made, dof=5)
    np.testing.assert_allclose(found.tip_marker, (0.0, 0.0, 290.0), atol=1e-6)
    np.testing.assert_allclose(found.pivot_tracker, pivot, atol=1e-6)
    behind, _ = poses(n=80, tip=(0.0, 0.0, -290.0))
    found = calibrate_recorded_pivot(behind, dof=5)
    assert found.verdict == "bad"
    assert "behind the markers" in found.reasons[0]


def test_unknown_methods_and_tools_are_refused():
    made, _ = poses(n=20)
    with pytest.raises(InvalidInputError, match="method must be one of ml, sphere"):
        calibrate_recorded_pivot(made, method="magic")
    with pytest.raises(InvalidInputError, match="dof must be 6 or 5"):
        calibrate_recorded_pivot(made, dof=3)
