import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from rona_core.calibration.surface_registration import point_surface, register_surface
from rona_core.errors import CancelledError, DegenerateGeometryError, InvalidInputError
from rona_core.geometry.pose import Pose
from rona_core.geometry.pose_covariance import deviation_between
from tests.helpers.strategies import cap_directions, random_pose, seeds

HALF_AXES_MM = np.array((75.0, 95.0, 72.0))
TARGETS = np.array(((0, 0, 0), (60, 0, 30), (-50, 20, 30), (0, 70, 20), (10, -60, 40.0)))
NOISE_MM = 0.2 / np.sqrt(3.0)  # per axis


def skull_radius_mm(u):
    """An ellipsoid with a few smooth bumps: radius (n,) in directions u (n, 3)."""
    x, y, z = np.moveaxis(u, -1, 0)
    bumps = 0.03 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.02 * np.sin(4 * z + 2 * x)
    bumps += 0.015 * np.cos(5 * y - 3 * z)
    return (1 + bumps) / np.sqrt(((u / HALF_AXES_MM) ** 2).sum(axis=-1))


def round_radius_mm(u):
    return np.full(len(u), 80.0)


def ellipsoid_closest(p):
    """Return foot and normal on an ellipsoid, by Newton on the multiplier: an exact surface."""
    squares = HALF_AXES_MM**2
    t = np.zeros(len(p))
    for _ in range(60):
        ratio = HALF_AXES_MM * p / (squares + t[:, None])
        f = (ratio**2).sum(axis=1) - 1.0
        slope = -2.0 * (ratio**2 / (squares + t[:, None])).sum(axis=1)
        t = t - f / slope
    feet = squares * p / (squares + t[:, None])
    normals = feet / squares
    return feet, normals / np.linalg.norm(normals, axis=1)[:, None]


def dense(radius_mm, n=60000):
    """Return points and outward normals (n, 3) of a star-shaped body."""
    i = np.arange(n) + 0.5
    z, azimuth = 1 - 2 * i / n, i * np.pi * (3 - np.sqrt(5))
    r = np.sqrt(1 - z**2)
    u = np.column_stack((r * np.cos(azimuth), r * np.sin(azimuth), z))
    aside = np.where(np.abs(u[:, :1]) < 0.8, (1.0, 0, 0), (0, 1.0, 0))
    t1 = np.cross(u, aside)
    t1 /= np.linalg.norm(t1, axis=1)[:, None]
    t2 = np.cross(u, t1)

    def at(v):
        v = v / np.linalg.norm(v, axis=1)[:, None]
        return v * radius_mm(v)[:, None]

    normals = np.cross(at(u + 1e-5 * t1) - at(u - 1e-5 * t1), at(u + 1e-5 * t2) - at(u - 1e-5 * t2))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    return at(u), normals * np.sign((normals * u).sum(axis=1))[:, None]


def patch(rng, n, half_angle_deg, radius_mm=skull_radius_mm, outliers=0.0, noise_mm=NOISE_MM):
    """Return digitised points (n, 3) about the upper side."""
    axis = rng.normal(size=3) * 0.3 + (0.5, 0.0, 0.85)
    turn = Rotation.align_vectors([axis / np.linalg.norm(axis)], [(0, 0, 1.0)])[0].as_matrix()
    u = cap_directions(rng, n, half_angle_deg) @ turn.T
    p = u * radius_mm(u)[:, None] + rng.normal(0, noise_mm, (n, 3))
    wrong = rng.permutation(n)[: round(outliers * n)]
    way = rng.normal(size=(len(wrong), 3))
    p[wrong] += way / np.linalg.norm(way, axis=1)[:, None] * rng.uniform(5, 30, (len(wrong), 1))
    return p, wrong


def off_by(rng, T_b_a, center_a, turn_deg=6.0, shift_mm=6.0):
    axis, way = rng.normal(size=(2, 3))
    turn = Rotation.from_rotvec(np.deg2rad(turn_deg) * axis / np.linalg.norm(axis)).as_matrix()
    center = T_b_a @ center_a
    moved = center + shift_mm * way / np.linalg.norm(way)
    return Pose(turn @ T_b_a.rotation, moved + turn @ (T_b_a.translation - center))


@pytest.fixture(scope="module")
def skull():
    return point_surface(*dense(skull_radius_mm))


def register(rng, surface, points_b, **options):
    truth = random_pose(rng, 300)
    points_a = truth.inv() @ points_b
    start = off_by(rng, truth, points_a.mean(axis=0))
    return register_surface(points_a, surface, start=start, **options), truth


def miss_mm(found, truth):
    off = found.T_b_a @ (truth.inv() @ TARGETS) - TARGETS
    return float(np.sqrt((off**2).sum(axis=1).mean()))


@given(seed=seeds)
@settings(max_examples=8, deadline=None)
def test_exact_points_lie_on_the_surface_and_determine_the_pose(seed):
    rng = np.random.default_rng(seed)
    u = cap_directions(rng, 200, 110.0)
    points_b, _ = ellipsoid_closest(u * 100.0)
    found, truth = register(rng, ellipsoid_closest, points_b)
    assert miss_mm(found, truth) < 1e-6
    np.testing.assert_allclose(found.residuals_mm, 0.0, atol=1e-7)
    assert found.used.all()


@given(seed=seeds)
@settings(max_examples=5, deadline=None)
def test_moving_points_and_surface_moves_the_pose_with_them(seed):
    rng = np.random.default_rng(seed)
    points, normals = dense(skull_radius_mm, 8000)
    points_a, _ = patch(rng, 200, 70.0)
    T_c_a, T_d_b = random_pose(rng, 300), random_pose(rng, 300)
    start = off_by(rng, Pose.identity(), points_a.mean(axis=0), 3.0, 2.0)
    found = register_surface(points_a, point_surface(points, normals), start=start, n_starts=1)
    moved = register_surface(
        T_c_a @ points_a,
        point_surface(T_d_b @ points, T_d_b.rotate(normals)),
        start=T_d_b @ start @ T_c_a.inv(),
        n_starts=1,
    )
    expected = T_d_b @ found.T_b_a @ T_c_a.inv()
    np.testing.assert_allclose(moved.T_b_a.matrix(), expected.matrix(), atol=1e-5)
    np.testing.assert_allclose(moved.residuals_mm, found.residuals_mm, atol=1e-5)
    np.testing.assert_allclose(moved.sigmas_mm, found.sigmas_mm, rtol=1e-4)
    np.testing.assert_allclose(
        moved.target_errors_mm(T_c_a @ TARGETS), found.target_errors_mm(TARGETS), rtol=1e-4
    )


@pytest.mark.parametrize(
    ("trials", "least", "most"), [(2, 0.4, 2.0), pytest.param(10, 0.6, 1.4, marks=pytest.mark.slow)]
)
def test_a_wide_patch_with_gross_errors_is_met_and_its_error_predicted(skull, trials, least, most):
    misses, expected = [], []
    for trial in range(trials):
        rng = np.random.default_rng((1, trial))
        points_b, wrong = patch(rng, 500, 70.0, outliers=0.05)
        found, truth = register(rng, skull, points_b)
        misses.append(miss_mm(found, truth))
        targets = found.target_errors_mm(truth.inv() @ TARGETS)
        expected.append(np.sqrt((targets**2).mean()))
        assert found.verdict == "good", found.reasons
        assert np.mean(found.weights[wrong] < 0.2) > 0.8  # those along the surface do no harm
    assert np.median(misses) < 0.2
    assert least < np.sqrt(np.mean(np.square(misses))) / np.mean(expected) < most


@pytest.mark.slow
def test_the_covariance_is_that_of_many_patches(skull):
    deviations, predicted = [], []
    rng = np.random.default_rng(3)
    exact, _ = patch(rng, 300, 80.0, noise_mm=0.0)
    for _ in range(80):
        points = exact + rng.normal(0, NOISE_MM, exact.shape)
        found = register_surface(points, skull, start=Pose.identity(), n_starts=1)
        deviations.append(deviation_between(Pose.identity(), found.T_b_a))
        predicted.append(found.covariance)
    spread = np.linalg.inv(np.mean(predicted, axis=0))
    nees = np.einsum("ni,ij,nj->n", deviations, spread, deviations) / 6
    assert 0.7 < nees.mean() < 1.4


def test_a_small_round_patch_is_flagged_and_says_why(skull):
    for trial in range(5):
        rng = np.random.default_rng((4, trial))
        found, _ = register(rng, skull, patch(rng, 100, 35.0)[0])
        assert found.verdict != "good"
        assert "nearly a piece of a sphere" in found.reasons[0]
        assert found.normals_deg < 45.0
        assert (np.diff(found.sigmas_mm) <= 0.0).all()


def test_on_a_ball_every_turn_about_its_centre_is_open():
    rng = np.random.default_rng(5)
    ball = point_surface(*dense(round_radius_mm))
    points_b, _ = patch(rng, 400, 60.0, round_radius_mm)
    found, _ = register(rng, ball, points_b)
    assert found.verdict == "bad"
    assert found.sigmas_mm[2] > 50 * found.sigmas_mm[3]  # three directions are open
    turns = found.directions_b[:3, :3] / found.reach_mm
    shifts = found.directions_b[:3, 3:]
    at_center = shifts + np.cross(turns, -found.center_b)  # how the ball's centre moves
    assert np.abs(at_center).max() < 0.05


@pytest.mark.slow
def test_a_mesh_and_its_points_give_the_same(skull):
    rng = np.random.default_rng(6)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=1.0)
    u = ball.vertices / np.linalg.norm(ball.vertices, axis=1)[:, None]
    mesh = trimesh.Trimesh(u * skull_radius_mm(u)[:, None], ball.faces, process=False)
    points_b, _ = patch(rng, 400, 75.0)
    start = off_by(rng, Pose.identity(), points_b.mean(axis=0))
    by_mesh = register_surface(
        points_b,
        point_surface(
            np.concatenate((mesh.vertices, mesh.triangles_center)),
            np.concatenate((mesh.vertex_normals, mesh.face_normals)),
        ),
        start=start,
    )
    by_points = register_surface(points_b, skull, start=start)
    assert miss_mm(by_mesh, by_points.T_b_a) < 0.08


def test_input_that_cannot_work_is_refused(skull):
    rng = np.random.default_rng(7)
    points, _ = patch(rng, 100, 60.0)
    eye = Pose.identity()
    with pytest.raises(InvalidInputError, match="at least 12"):
        register_surface(points[:11], skull, start=eye)
    with pytest.raises(InvalidInputError, match="n_starts"):
        register_surface(points, skull, start=eye, n_starts=0)
    with pytest.raises(DegenerateGeometryError, match="many places"):
        register_surface(points[:1] + rng.normal(0, 0.1, (20, 3)), skull, start=eye)
    with pytest.raises(InvalidInputError, match="as many normals"):
        point_surface(points, points[:5] / np.linalg.norm(points[:5], axis=1)[:, None])
    with pytest.raises(CancelledError):
        register_surface(points, skull, start=eye, cancel=lambda: True)
    shares = []
    register_surface(points, skull, start=eye, n_starts=3, progress=shares.append)
    assert shares == [0.25, 0.5, 0.75, 1.0]
