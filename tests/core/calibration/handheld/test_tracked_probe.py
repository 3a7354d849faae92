import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.calibration.handheld.tracked_probe import calibrate_sono, fit_rotation_axis
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose, Poses

MARKERS = GEOMETRIES["sonopointer"].positions_marker
FACE = np.array((1.5, -151.0, -23.5))
AXIS = np.array((0.02, -1.0, 0.013)) / np.linalg.norm((0.02, -1.0, 0.013))


def turn_onto(a, b):
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis / max(sine, 1e-12) * np.arctan2(sine, a @ b))


def posed(rotations, tips):
    matrices = rotations.as_matrix()
    return Poses(matrices, tips - matrices @ FACE)


def spin(rng, half_deg=60.0, n=300, noise_deg=0.0, play_deg=0.0, aim=(0.1, 0.2, -1.0)):
    """Return poses turned about AXIS to and fro, with white noise and slow play of the axis."""
    aim = np.asarray(aim) / np.linalg.norm(aim)
    time = np.linspace(0.0, 1.0, n)
    turns = np.deg2rad(half_deg) * np.sin(2 * np.pi * 3 * time)
    rotations = Rotation.from_rotvec(turns[:, None] * aim) * turn_onto(AXIS, aim)
    waves, phases = rng.uniform(3.0, 15.0, (5, 3)), rng.uniform(0, 2 * np.pi, (5, 3))
    slow = np.sin(2 * np.pi * time[:, None, None] * waves + phases).sum(axis=1) * np.sqrt(2 / 5)
    shake = np.deg2rad(rng.normal(0.0, noise_deg, (n, 3)) + play_deg * slow)
    return posed(Rotation.from_rotvec(shake) * rotations, np.tile((400.0, 90.0, -1500.0), (n, 1)))


def pivot(rng, n=200, noise_mm=0.0):
    angles = np.deg2rad(30.0) * np.sqrt(rng.uniform(0, 1, n))
    around = rng.uniform(0, 2 * np.pi, n)
    lean = angles[:, None] * np.column_stack((np.cos(around), 0 * around, np.sin(around)))
    tips = np.array((300.0, 80.0, -1400.0)) + rng.normal(0.0, noise_mm, (n, 3))
    return posed(Rotation.from_rotvec(lean), tips)


def angle_deg(a, b):
    return np.rad2deg(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def calibrated(rng, **spun):
    return calibrate_sono(
        pivot(rng), spin(rng, **spun), pointer="sonopointer", positions_marker=MARKERS
    )


def test_without_noise_face_and_axis_are_exact():
    found = calibrated(np.random.default_rng(0))
    np.testing.assert_allclose(found.T_sonomarker_probe.translation, FACE, atol=1e-6)
    assert angle_deg(found.T_sonomarker_probe.rotation[:, 2], AXIS) < 1e-6
    assert found.spin_deg == pytest.approx(120.0, abs=0.5)
    assert found.off_axis_mm < 1e-5
    assert found.verdict == "good"


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 10**6),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-900, 900)] * 3),
)
def test_where_the_tracker_stands_does_not_matter(seed, turn, shift):
    T_a_b = Pose.from_rotvec(turn, shift)
    here = spin(np.random.default_rng(seed), noise_deg=0.2)
    a, b = fit_rotation_axis(here), fit_rotation_axis(T_a_b @ here)
    assert abs(a.axis_marker @ b.axis_marker) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(a.point_marker, b.point_marker, atol=1e-6)
    assert b.sigma_deg == pytest.approx(a.sigma_deg, rel=1e-6)
    np.testing.assert_allclose(b.residuals_deg, a.residuals_deg, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 10**6), st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-90, 90)] * 3)
)
def test_another_marker_frame_moves_the_axis_along(seed, turn, shift):
    T_a_b = Pose.from_rotvec(turn, shift)  # of the marker frame b in another one, a
    here = spin(np.random.default_rng(seed), noise_deg=0.2)
    b, a = fit_rotation_axis(here), fit_rotation_axis(here @ T_a_b.inv())
    moved = T_a_b.rotate(b.axis_marker)
    assert abs(moved @ a.axis_marker) == pytest.approx(1.0, abs=1e-12)
    off = T_a_b @ b.point_marker - a.point_marker
    assert np.linalg.norm(np.cross(off, moved)) < 1e-6  # another point of the same line
    assert a.sigma_deg == pytest.approx(b.sigma_deg, rel=1e-4)


@pytest.mark.parametrize(
    ("noise_deg", "play_deg", "half_deg"), [(0.3, 0.0, 60.0), (0.1, 0.1, 60.0), (0.3, 0.1, 30.0)]
)
def test_the_predicted_sigma_is_what_happens(noise_deg, play_deg, half_deg):
    errors, predicted = [], []
    for seed in range(60):
        fit = fit_rotation_axis(
            spin(np.random.default_rng(seed), half_deg, 300, noise_deg, play_deg)
        )
        error = angle_deg(fit.axis_marker, AXIS)
        errors.append(min(error, 180.0 - error))
        predicted.append(fit.sigma_deg)
    happened = np.sqrt(np.mean(np.square(errors)))
    assert 0.75 < np.sqrt(np.mean(np.square(predicted))) / happened < 1.6


def test_a_wider_spin_tells_more():
    sigmas = [
        fit_rotation_axis(spin(np.random.default_rng(3), half, noise_deg=0.3)).sigma_deg
        for half in (25.0, 45.0, 80.0)
    ]
    assert sigmas[0] > 1.5 * sigmas[1] > 2.0 * sigmas[2]


def test_a_few_wild_poses_do_not_count():
    rng = np.random.default_rng(5)
    good = spin(rng, noise_deg=0.1)
    wild = good.rotations.copy()
    wild[40:50] = Rotation.from_rotvec(rng.normal(0, 0.3, (10, 3))).as_matrix() @ wild[40:50]
    fit = fit_rotation_axis(Poses(wild, good.translations))
    assert not fit.used[40:50].any()
    assert fit.used.sum() > 280
    assert abs(fit.axis_marker @ AXIS) > np.cos(np.deg2rad(0.1))


def test_too_little_spin_is_refused_and_little_is_named():
    rng = np.random.default_rng(1)
    with pytest.raises(DegenerateGeometryError, match="30 degrees from end to end"):
        fit_rotation_axis(spin(rng, half_deg=15.0, noise_deg=0.05))
    with pytest.raises(DegenerateGeometryError, match="from end to end"):
        fit_rotation_axis(spin(rng, half_deg=0.0))
    weak = calibrated(rng, half_deg=30.0, noise_deg=0.05)
    assert weak.verdict == "weak"
    assert "turned by 60 degrees" in " ".join(weak.reasons)


def test_a_probe_that_reels_is_refused_and_few_poses_too():
    rng = np.random.default_rng(2)
    with pytest.raises(DegenerateGeometryError, match="wobbled"):
        fit_rotation_axis(spin(rng, noise_deg=9.0))
    with pytest.raises(InvalidInputError, match="20 poses"):
        fit_rotation_axis(spin(rng, n=19))


def test_a_point_that_sits_askew_is_named():
    rng = np.random.default_rng(4)
    turned = spin(rng)
    shifted = Poses(turned.rotations, turned.translations - turned.rotations @ (4.0, 0.0, 0.0))
    found = calibrate_sono(pivot(rng), shifted, pointer="sonopointer", positions_marker=MARKERS)
    assert found.off_axis_mm == pytest.approx(4.0, abs=0.1)
    assert any("beside the axis" in reason for reason in found.reasons)
