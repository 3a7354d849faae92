import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.devices.samples import ToolTrack, interpolate_poses
from rona_core.geometry.pose import Pose, Poses

RATE = np.array((0.3, -0.2, 0.5))  # rad/s about one axis
SPEED = np.array((12.0, -5.0, 3.0))


def track(times_s, T_a_b=None):
    turns = Rotation.from_rotvec(np.outer(times_s, RATE)).as_matrix()
    poses = Poses(turns, np.outer(times_s, SPEED) + 100.0)
    n = len(times_s)
    poses = poses if T_a_b is None else T_a_b @ poses
    return ToolTrack("sonopointer", np.arange(n), times_s, poses, np.zeros(n), n)


def test_an_even_motion_is_met_exactly_and_a_late_frame_is_put_back():
    times = np.arange(0.0, 2.0, 1 / 60)
    wanted = np.array((0.0, 0.013, 0.777, 1.5))
    found = interpolate_poses(track(times), wanted)
    assert found.known.all()
    np.testing.assert_allclose(
        found.Ts_tracker_marker.translations, np.outer(wanted, SPEED) + 100.0, atol=1e-9
    )
    expected = Rotation.from_rotvec(np.outer(wanted, RATE)).as_matrix()
    np.testing.assert_allclose(found.Ts_tracker_marker.rotations, expected, atol=1e-9)
    late = interpolate_poses(
        track(times), wanted, delay_s=0.02
    )  # frame at t shows what was at t - 0.02
    np.testing.assert_allclose(
        late.Ts_tracker_marker.translations, np.outer(wanted + 0.02, SPEED) + 100.0, atol=1e-9
    )


def test_instants_without_a_frame_close_by_do_not_count():
    times = np.concatenate((np.arange(0.0, 0.5, 0.02), 0.7 + 0.02 * np.arange(15)))
    wanted = np.array((-0.01, 0.0, 0.31, 0.485, 0.55, 0.65, 0.71, 0.98, 0.995))
    found = interpolate_poses(track(times), wanted)
    assert found.known.tolist() == [False, True, True, False, False, False, True, True, False]
    assert len(found.Ts_tracker_marker) == 4


def test_a_tool_that_was_hardly_seen_is_nowhere():
    for n in (0, 1):
        found = interpolate_poses(track(np.arange(n) * 0.1), np.array((0.0, 0.05)))
        assert not found.known.any()
        assert len(found.Ts_tracker_marker) == 0
    assert (
        len(interpolate_poses(track(np.arange(9) * 0.01), np.array((5.0,))).Ts_tracker_marker) == 0
    )


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-900, 900)] * 3))
def test_where_the_tracker_stands_does_not_matter(turn, shift):
    T_a_b = Pose.from_rotvec(turn, shift)
    times, wanted = np.arange(0.0, 1.0, 0.03), np.array((0.1, 0.45, 0.9))
    here, there = (
        interpolate_poses(track(times), wanted),
        interpolate_poses(track(times, T_a_b), wanted),
    )
    moved = T_a_b @ here.Ts_tracker_marker
    np.testing.assert_allclose(there.Ts_tracker_marker.rotations, moved.rotations, atol=1e-9)
    np.testing.assert_allclose(there.Ts_tracker_marker.translations, moved.translations, atol=1e-6)
