import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.calibration.handheld.pointer import calibrate_pointer as calibrate
from rona_core.calibration.tracking_error import EVEN
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Poses
from tests.helpers.strategies import noisy, pivot_poses, random_pose, seeds

few = settings(max_examples=20, deadline=None)
TIP_6D = np.array((4.0, -160.0, -20.0))
TIP_5D = np.array((0.0, 0.0, 290.0))
METHODS = ("ml", "sphere")
kinds = st.sampled_from([(dof, method) for dof in (6, 5) for method in METHODS])
MARKERS = {dof: GEOMETRIES[f"pointer{dof}d"].positions_marker for dof in (6, 5)}


def calibrate_pointer(poses, *, dof, method="ml", **options):
    """Calibrate with the geometry of a pointer and the same noise in all directions."""
    positions = MARKERS.get(dof, MARKERS[6])
    return calibrate(
        poses, dof=dof, method=method, positions_pointermarker=positions, noise=EVEN, **options
    )


def tip_of(dof):
    return TIP_6D if dof == 6 else TIP_5D


def tip_errors(dof, method, *, cone_deg, trials, n=100, sigma_mm=0.06, sigma_deg=0.06):
    errors, sigmas = [], []
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        poses, _ = pivot_poses(rng, tip_of(dof), n=n, half_angle_deg=cone_deg)
        fit = calibrate_pointer(
            noisy(rng, poses, sigma_mm, sigma_deg), pointer="p", dof=dof, method=method
        )
        errors.append(np.linalg.norm(fit.tip_pointermarker - tip_of(dof)))
        sigmas.append(fit.tip_sigma_mm)
    return np.array(errors), np.array(sigmas)


@given(seed=seeds, kind=kinds, cone=st.sampled_from([8.0, 25.0, 60.0]))
@few
def test_an_exact_swing_gives_the_tip_exactly(seed, kind, cone):
    dof, method = kind
    poses, pivot = pivot_poses(np.random.default_rng(seed), tip_of(dof), n=40, half_angle_deg=cone)
    fit = calibrate_pointer(poses, pointer="p", dof=dof, method=method)
    np.testing.assert_allclose(fit.tip_pointermarker, tip_of(dof), atol=1e-7)
    np.testing.assert_allclose(fit.pivot_tracker, pivot, atol=1e-7)
    assert fit.rmse_mm < 1e-7
    assert fit.n_used == 40
    assert 0.7 * cone < fit.cone_deg < 1.35 * cone
    assert (fit.pointer, fit.dof, fit.method) == ("p", dof, method)


@given(seed=seeds, kind=kinds)
@few
def test_moving_the_tracker_moves_the_pivot_and_not_the_tip(seed, kind):
    dof, method = kind
    rng = np.random.default_rng(seed)
    poses = noisy(rng, pivot_poses(rng, tip_of(dof))[0], 0.1, 0.1)
    T_room_tracker = random_pose(rng)
    fit = calibrate_pointer(poses, pointer="p", dof=dof, method=method)
    moved = calibrate_pointer(T_room_tracker @ poses, pointer="p", dof=dof, method=method)
    np.testing.assert_allclose(moved.tip_pointermarker, fit.tip_pointermarker, atol=1e-5)
    np.testing.assert_allclose(moved.pivot_tracker, T_room_tracker @ fit.pivot_tracker, atol=1e-5)
    assert moved.cone_deg == pytest.approx(fit.cone_deg, abs=1e-5)


@given(seed=seeds, method=st.sampled_from(METHODS))
@few
def test_the_roll_of_a_5d_pointer_does_not_matter(seed, method):
    rng = np.random.default_rng(seed)
    poses = noisy(rng, pivot_poses(rng, TIP_5D)[0], 0.1, 0.1)
    rolls = Rotation.from_rotvec(np.outer(rng.uniform(-np.pi, np.pi, 100), (0, 0, 1)))
    rolled = Poses(poses.rotations @ rolls.as_matrix(), poses.translations)
    fit = calibrate_pointer(poses, pointer="p", dof=5, method=method)
    other = calibrate_pointer(rolled, pointer="p", dof=5, method=method)
    np.testing.assert_allclose(other.tip_pointermarker, fit.tip_pointermarker, atol=1e-9)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dof", [5, 6])
def test_a_swing_of_25_degrees_gives_the_tip_within_its_predicted_error(dof, method):
    errors, sigmas = tip_errors(dof, method, cone_deg=25.0, trials=60)
    assert np.sqrt((errors**2).mean()) < {"sphere": 0.3, "ml": 0.12}[method]
    assert 0.6 < np.sqrt((errors**2).mean()) / np.sqrt((sigmas**2).mean()) < 1.6


def test_the_residual_does_not_tell_a_good_swing_from_a_bad_one():
    bad, bad_sigma = tip_errors(6, "sphere", cone_deg=10.0, trials=20)
    good, good_sigma = tip_errors(6, "sphere", cone_deg=40.0, trials=20)
    assert np.median(bad) > 4 * np.median(good)
    assert np.median(bad_sigma) > 4 * np.median(good_sigma)  # the prediction does tell


@pytest.mark.sweep(2)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dof", [5, 6])
def test_gross_errors_are_dropped_and_counted(dof, method):
    rng = np.random.default_rng(2)
    poses = noisy(rng, pivot_poses(rng, tip_of(dof), n=200)[0], 0.05, 0.05)
    spoiled = rng.choice(200, 10, replace=False)
    shift = np.zeros((200, 3))
    shift[spoiled] = rng.uniform(10, 40, (10, 3)) * rng.choice((-1, 1), (10, 3))
    fit = calibrate_pointer(
        Poses(poses.rotations, poses.translations + shift), pointer="p", dof=dof, method=method
    )
    assert np.linalg.norm(fit.tip_pointermarker - tip_of(dof)) < 0.3
    assert not fit.used[spoiled].any()
    assert fit.n_used == fit.used.sum() >= 185
    assert fit.residuals_mm.shape == (200,)


def test_the_rmse_is_the_scatter_of_the_tip():
    rng = np.random.default_rng(6)
    poses = noisy(rng, pivot_poses(rng, TIP_6D)[0], 0.1, 0.05)
    fit = calibrate_pointer(poses, pointer="p", dof=6)
    distances = np.linalg.norm(poses @ fit.tip_pointermarker - fit.pivot_tracker, axis=1)
    np.testing.assert_allclose(fit.residuals_mm, distances, atol=1e-12)
    assert fit.rmse_mm == pytest.approx(np.sqrt((distances[fit.used] ** 2).mean()))


def planar(rng, dof, half_deg=30.0):
    angles = np.deg2rad(np.linspace(-half_deg, half_deg, 50))
    axis = np.array((1.0, 0.0, 0.0))  # across both shafts
    rotations = Rotation.from_rotvec(np.outer(angles, axis)).as_matrix()
    return noisy(rng, Poses(rotations, -rotations @ tip_of(dof)), 0.05, 0.05)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dof", [5, 6])
def test_motions_that_leave_the_tip_open_are_refused_by_name(dof, method):
    rng = np.random.default_rng(9)

    def fit(poses):
        return calibrate_pointer(poses, pointer="p", dof=dof, method=method)

    still = Poses(np.repeat(np.eye(3)[None], 50, axis=0), np.zeros((50, 3)))
    for motion in (still, noisy(rng, still, 0.1, 0.1)):
        with pytest.raises(DegenerateGeometryError, match="hardly turned"):
            fit(motion)
    with pytest.raises(DegenerateGeometryError, match="one plane"):
        fit(planar(rng, dof))
    small, _ = pivot_poses(rng, tip_of(dof), n=60, half_angle_deg=3.5)
    with pytest.raises(DegenerateGeometryError, match="half-angle"):
        fit(small)
    with pytest.raises(InvalidInputError, match="at least 10"):
        fit(pivot_poses(rng, tip_of(dof), n=9)[0])
    wild = pivot_poses(rng, tip_of(dof), n=60)[0]
    slipped = Poses(wild.rotations, wild.translations + np.repeat(((0, 0, 0), (30, 0, 0)), 30, 0))
    assert fit(wild).n_used == 60
    with pytest.raises(DegenerateGeometryError, match=r"slipped|uncertain"):
        fit(slipped)


def test_spinning_about_the_shaft_alone_is_refused():
    angles = np.linspace(0, 2 * np.pi, 40)
    rotations = Rotation.from_rotvec(np.outer(angles, (0, 0, 1))).as_matrix()
    with pytest.raises(DegenerateGeometryError, match="one plane"):
        calibrate_pointer(Poses(rotations, np.zeros((40, 3))), pointer="p", dof=6)


def test_a_5d_marker_that_points_away_from_the_tip_is_refused():
    poses, _ = pivot_poses(np.random.default_rng(1), -TIP_5D, n=40)
    with pytest.raises(DegenerateGeometryError, match="must point to the tip"):
        calibrate_pointer(poses, pointer="p", dof=5)


def test_unknown_choices_are_refused():
    poses, _ = pivot_poses(np.random.default_rng(1), TIP_6D, n=40)
    with pytest.raises(InvalidInputError, match="method"):
        calibrate_pointer(poses, pointer="p", dof=6, method="magic")
    with pytest.raises(InvalidInputError, match="dof"):
        calibrate_pointer(poses, pointer="p", dof=4)
