import numpy as np
import pytest
from hypothesis import given, settings

from rona_core.calibration.error_propagation import (
    MapSetup,
    pose_covariance,
    predict_map_error,
)
from rona_core.calibration.tracking_error import EVEN, MarkerNoise
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import InvalidInputError
from rona_core.geometry.frame_graph import FrameEdge, FrameGraph
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import deviation_between
from rona_core.geometry.rigid_fit import register_points
from tests.helpers.strategies import disturbed, random_pose, random_rotation, seeds, swings

POINTER = GEOMETRIES["pointer6d"]
STRESS = MarkerNoise(sigma_mm=0.35)


def setup(rng, **changes):
    root = rng.normal(size=(12, 12)) * np.tile(np.repeat((2e-4, 0.1), 3), 2)[:, None]
    values = {
        "T_base_tracker": random_pose(rng, 1500),
        "registration": root @ root.T / 12,
        "tip_pointermarker": POINTER.nominal_tip_marker,
        "tip_covariance": np.diag((0.01, 0.02, 0.04)),
        "positions_pointermarker": POINTER.positions_marker,
        "noise": STRESS,
    }
    return MapSetup(**(values | changes))


def poses(rng, n=12):
    rotations = random_rotation(rng) @ swings(rng, n, 40.0)
    return Poses(rotations, rng.uniform(-60, 60, (n, 3)) + (0.0, 0.0, 1900.0))


def monte_carlo(setup, Ts_tracker_pointermarker, *, draws=1000, seed=0):
    """Return the covariances by repeated simulation, marker by marker; nothing is linearised."""
    rng = np.random.default_rng(seed)
    n, tip = len(Ts_tracker_pointermarker), np.asarray(setup.tip_pointermarker)
    exact_tracker = Ts_tracker_pointermarker @ tip
    exact = setup.T_base_tracker @ exact_tracker
    edge = FrameEdge(
        "base", "tracker", setup.T_base_tracker, "tool", covariance=setup.registration[:6, :6]
    )
    graph = FrameGraph((edge,))
    root = np.linalg.cholesky(setup.tip_covariance + 1e-18 * np.eye(3))
    sums = {name: np.zeros((n, 3, 3)) for name in ("registration", "pointer", "frame", "total")}
    for _ in range(draws):
        T_base_tracker = disturbed(graph, rng).pose("base", "tracker")
        tip_drawn = tip + root @ rng.normal(size=3)
        rotations, translations = averaged_fits(setup, Ts_tracker_pointermarker, rng)
        turn = setup.T_base_tracker.rotation
        errors = {
            "registration": T_base_tracker @ exact_tracker - exact,
            "pointer": setup.T_base_tracker @ (Ts_tracker_pointermarker @ tip_drawn) - exact,
            "frame": (rotations @ tip + translations - exact_tracker) @ turn.T,
            "total": T_base_tracker @ (rotations @ tip_drawn + translations)
            - exact
            + setup.bias_mm / np.sqrt(3.0) * rng.normal(size=3),
        }
        for name, error in errors.items():
            sums[name] += error[:, :, None] * error[:, None, :] / draws
    return sums


def averaged_fits(setup, Ts_tracker_pointermarker, rng):
    """Return poses as averages of fits to noisy markers: rotations (n, 3, 3), translations."""
    positions = np.asarray(setup.positions_pointermarker)
    middle = positions.mean(axis=0)
    R, t = Ts_tracker_pointermarker.rotations, Ts_tracker_pointermarker.translations
    exact = np.einsum("nij,mj->nmi", R, positions) + t[:, None]
    shape = (len(R), setup.n_averaged, len(positions), 3)
    seen = exact[:, None] + setup.noise.sigma_mm * setup.noise.shape() * rng.normal(size=shape)
    centers = seen.mean(axis=2)
    spread = np.einsum("nami,mj->naij", seen - centers[:, :, None], positions - middle)
    rotations = nearest_rotations(nearest_rotations(spread).mean(axis=1))
    return rotations, centers.mean(axis=1) - rotations @ middle


def nearest_rotations(matrices):
    u, _, vt = np.linalg.svd(matrices)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return u @ vt


def rms_mm(covariances):
    return np.sqrt(np.trace(covariances, axis1=1, axis2=2).mean())


@pytest.mark.sweep(1)
@pytest.mark.parametrize("n_averaged", [1, 5])
def test_the_prediction_is_what_a_simulation_gives(n_averaged):
    rng = np.random.default_rng(4)
    wanted = setup(rng, n_averaged=n_averaged, bias_mm=0.2)
    pointer = poses(rng)
    expected, simulated = predict_map_error(wanted, pointer), monte_carlo(wanted, pointer, seed=2)
    for name, covariances in simulated.items():
        found = getattr(expected, "rms_mm" if name == "total" else f"{name}_rms_mm")
        assert found == pytest.approx(rms_mm(covariances), rel=0.06), name
    size = np.sqrt(np.trace(expected.total, axis1=1, axis2=2))[:, None, None]
    np.testing.assert_allclose(expected.total / size**2, simulated["total"] / size**2, atol=0.12)
    parts = (expected.registration_rms_mm, expected.pointer_rms_mm, expected.frame_rms_mm, 0.2)
    assert expected.rms_mm == pytest.approx(np.linalg.norm(parts))


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_moving_the_base_turns_the_errors_with_it(seed):
    rng = np.random.default_rng(seed)
    first, pointer = setup(rng), poses(rng, 3)
    T_a_base = random_pose(rng)
    turn = np.kron(np.eye(2), T_a_base.rotation)
    second = setup(
        np.random.default_rng(seed),
        T_base_tracker=T_a_base @ first.T_base_tracker,
        registration=turn @ first.registration[:6, :6] @ turn.T,
    )
    before, after = predict_map_error(first, pointer), predict_map_error(second, pointer)
    np.testing.assert_allclose(
        after.total, T_a_base.rotation @ before.total @ T_a_base.rotation.T, atol=1e-6
    )
    assert after.rms_mm == pytest.approx(before.rms_mm, abs=1e-7)


def test_averaging_reduces_the_error_of_the_frame_only():
    rng = np.random.default_rng(5)
    pointer = poses(rng)
    one = predict_map_error(setup(np.random.default_rng(6)), pointer)
    many = predict_map_error(setup(np.random.default_rng(6), n_averaged=25), pointer)
    assert many.frame_rms_mm == pytest.approx(one.frame_rms_mm / 5)
    assert many.pointer_rms_mm == pytest.approx(one.pointer_rms_mm)
    assert many.registration_rms_mm == pytest.approx(one.registration_rms_mm)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [STRESS, MarkerNoise(EVEN.depth_ratio, 0.35)])
def test_the_covariance_of_a_frame_is_that_of_many_fits(noise):
    rng = np.random.default_rng(7)
    truth = Pose(random_rotation(rng), np.array((50.0, -80.0, 1900.0)))
    markers = truth @ POINTER.positions_marker
    offs = []
    for _ in range(2500):
        error = noise.sigma_mm * noise.shape() * rng.normal(size=markers.shape)
        offs.append(
            deviation_between(
                truth, register_points(POINTER.positions_marker, markers + error).T_b_a
            )
        )
    expected = pose_covariance(truth, POINTER.positions_marker, noise)
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        np.cov(np.transpose(offs)) / np.outer(size, size),
        expected / np.outer(size, size),
        atol=0.1,
    )


def test_a_setup_that_says_too_little_is_refused():
    rng = np.random.default_rng(8)
    with pytest.raises(InvalidInputError, match="needs a size"):
        setup(rng, noise=MarkerNoise())
    with pytest.raises(InvalidInputError, match="n_averaged"):
        setup(rng, n_averaged=0)
    with pytest.raises(InvalidInputError, match=r"\(6, 6\)"):
        setup(rng, registration=np.eye(5))
    with pytest.raises(InvalidInputError, match=r"\(3, 3\)"):
        setup(rng, tip_covariance=np.eye(2))
