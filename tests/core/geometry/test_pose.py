import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from rona_core.errors import InvalidInputError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.pose_covariance import rotation_vectors
from tests.helpers.strategies import angle_rad, near_identity_pose, random_pose, random_poses, seeds

few = settings(max_examples=30, deadline=None)
sizes = st.sampled_from([None, 1e-3, 1e-8, 1e-12, 0.0])  # None: anywhere; else near the identity


def pose_of(rng, size):
    return random_pose(rng) if size is None else near_identity_pose(rng, size)


def close(a, b, atol=1e-9):
    np.testing.assert_allclose(a.matrix(), b.matrix(), atol=atol)


@given(seed=seeds, size=sizes)
@few
def test_poses_form_a_group(seed, size):
    rng = np.random.default_rng(seed)
    a, b, c = (pose_of(rng, size) for _ in range(3))
    close((a @ b) @ c, a @ (b @ c))
    close(a @ Pose.identity(), a, 0)
    close(Pose.identity() @ a, a, 0)
    close(a @ a.inv(), Pose.identity())
    close((a @ b).inv(), b.inv() @ a.inv())
    close(a.inv().inv(), a)


@given(seed=seeds, size=sizes)
@few
def test_poses_agree_with_two_other_libraries(seed, size):
    rng = np.random.default_rng(seed)
    a, b = (pose_of(rng, size) for _ in range(2))
    points = rng.normal(0, 100, (5, 3))
    other = RigidTransform.from_matrix(a.matrix()) * RigidTransform.from_matrix(b.matrix())
    np.testing.assert_allclose((a @ b).matrix(), other.as_matrix(), atol=1e-9)
    np.testing.assert_allclose((a @ b) @ points, other.apply(points), atol=1e-9)
    third = pin.SE3(a.rotation, a.translation) * pin.SE3(b.rotation, b.translation)
    np.testing.assert_allclose((a @ b).matrix(), third.homogeneous, atol=1e-9)
    inverse = pin.SE3(a.rotation, a.translation).inverse()
    np.testing.assert_allclose(a.inv().matrix(), inverse.homogeneous, atol=1e-9)


@given(seed=seeds, size=sizes)
@few
def test_poses_survive_their_other_forms(seed, size):
    rng = np.random.default_rng(seed)
    pose = pose_of(rng, size)
    close(Pose.from_matrix(pose.matrix()), pose, 0)
    close(Pose.from_wxyz(pose.wxyz(), pose.translation), pose)
    assert pose.wxyz()[0] >= 0
    rotvec = Rotation.from_matrix(pose.rotation).as_rotvec()
    close(Pose.from_rotvec(rotvec, pose.translation), pose)
    close(Pose.from_translation(pose.translation), Pose(np.eye(3), pose.translation), 0)


@given(seed=seeds)
@few
def test_a_batch_is_its_single_poses(seed):
    rng = np.random.default_rng(seed)
    Ts, Us, T = random_poses(rng, 4), random_poses(rng, 4), random_pose(rng)
    points = rng.normal(0, 100, (4, 3))
    for i, (single, other) in enumerate(zip(Ts, Us, strict=True)):
        close((Ts @ Us)[i], single @ other)
        close((T @ Ts)[i], T @ single)
        close((Ts @ T)[i], single @ T)
        close(Ts.inv()[i], single.inv())
        np.testing.assert_allclose((Ts @ points)[i], single @ points[i], atol=1e-9)
        np.testing.assert_allclose((Ts @ points[0])[i], single @ points[0], atol=1e-9)
        np.testing.assert_allclose(Ts.wxyz()[i], single.wxyz(), atol=1e-12)
    close(Poses.stack(list(Ts))[2], Ts[2], 0)
    close(Ts.select([2, 0])[0], Ts[2], 0)
    close(Ts.select(np.array([False, True, False, False]))[0], Ts[1], 0)
    assert len(Ts.select(slice(1, 3))) == 2


@given(seed=seeds)
@few
def test_the_mean_follows_the_frame_and_undoes_small_noise(seed):
    rng = np.random.default_rng(seed)
    center, T = random_pose(rng), random_pose(rng)
    near = Poses.stack([center @ near_identity_pose(rng, 0.02) for _ in range(6)])
    close((T @ near).mean(), T @ near.mean(), 1e-7)
    close(Poses.stack([center] * 3).mean(), center)
    assert angle_rad(near.mean(), center) < 0.06


def test_directions_turn_without_shifting():
    rng = np.random.default_rng(0)
    T = random_pose(rng)
    a, b = rng.normal(size=(2, 3))
    np.testing.assert_allclose(T.rotate(a - b), (T @ a) - (T @ b), atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 2.0, np.pi])
def test_the_angle_between_poses_is_that_of_the_turn(angle):
    axis = np.array((0.6, 0.0, 0.8))
    T = random_pose(np.random.default_rng(1))
    assert angle_rad(T, T @ Pose.from_rotvec(angle * axis)) == pytest.approx(angle, abs=1e-12)


def test_poses_cannot_be_changed():
    pose, poses = Pose.identity(), Poses.stack([Pose.identity()])
    for array in (pose.rotation, pose.translation, poses.rotations, poses.translations):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    source = np.zeros(3)
    kept = Pose(np.eye(3), source)
    source[0] = 5.0
    assert kept.translation[0] == 0.0


def test_what_is_not_a_pose_is_refused():
    for rotation in (-np.eye(3), 1.001 * np.eye(3), np.eye(2), np.full((3, 3), np.nan)):
        with pytest.raises(InvalidInputError):
            Pose(rotation, np.zeros(3))
    with pytest.raises(InvalidInputError):
        Pose(np.eye(3), np.zeros(2))
    with pytest.raises(InvalidInputError):
        Pose.from_matrix(np.eye(4)[::-1])
    with pytest.raises(InvalidInputError):
        Poses(np.eye(3)[None], np.zeros((2, 3)))
    with pytest.raises(InvalidInputError):
        Poses.stack([]).mean()
    assert len(Poses.stack([])) == len(Poses.stack([]).inv()) == len(Poses.stack([]).wxyz()) == 0


@given(
    seed=seeds, size=st.sampled_from([0.0, 1e-8, 1e-5, 1e-2, 1.0, 1e200]), mirrored=st.booleans()
)
@few
def test_one_matrix_is_judged_as_a_batch_of_it_is(seed, size, mirrored):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(rng=rng).as_matrix() * (-1.0 if mirrored else 1.0)
    rotation = rotation + size * rng.uniform(-1.0, 1.0, (3, 3))
    with np.errstate(over="ignore", invalid="ignore"):
        accepted = []
        for make in (
            lambda: Pose(rotation, np.zeros(3)),
            lambda: Poses(rotation[None], [[0, 0, 0]]),
        ):
            try:
                make()
                accepted.append(True)
            except InvalidInputError:
                accepted.append(False)
    assert accepted == [size < 1e-6 and not mirrored] * 2


def test_mean_and_rotation_vectors_are_those_of_scipy():
    rng = np.random.default_rng(4)
    about = Rotation.random(rng=rng)
    for spread in (1e-9, 0.2, 3.0):
        turns = Rotation.from_rotvec(rng.normal(0.0, spread, (60, 3))) * about
        mean = Poses(turns.as_matrix(), rng.normal(size=(60, 3))).mean()
        np.testing.assert_allclose(mean.rotation, turns.mean().as_matrix(), atol=1e-12)
        off = turns * about.inv()
        np.testing.assert_allclose(
            rotation_vectors(off.as_matrix()), off.as_rotvec(), rtol=1e-6, atol=1e-12
        )
    assert (rotation_vectors(np.eye(3)[None]) == 0.0).all()
