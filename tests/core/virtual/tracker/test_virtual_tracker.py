import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.devices.settings import TOOLS, TrackerSettings
from rona_core.devices.trackers import GEOMETRIES
from rona_core.errors import DeviceError
from rona_core.geometry.pose import Pose, Poses
from rona_core.geometry.rigid_fit import register_points
from rona_core.virtual.clock import CaptureClock
from rona_core.virtual.tracker.marker_error import in_volume, marker_error, sample_volume
from rona_core.virtual.tracker.tracker import BLOCK, VirtualTracker, observe
from tests.helpers.sphere_world import ScriptedWorld

seeds = st.integers(0, 2**32 - 1)
FACING = Pose(np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, 1900.0)))  # marker z to the camera
IDEAL = TrackerSettings(profile="ideal")


def facing_pose(rng, tilt_deg=25.0):
    """A random pose well inside the volume that faces the camera to within ``tilt_deg``."""
    tilt = Rotation.from_rotvec(np.deg2rad(rng.uniform(-tilt_deg, tilt_deg, 3)))
    place = rng.uniform((-150, -150, 1750), (150, 150, 2050))
    return Pose((tilt * Rotation.from_matrix(FACING.rotation)).as_matrix(), place)


def observed(tool, pose):
    """What an exact tracker reports of a tool in one frame."""
    geometry = GEOMETRIES[tool]
    white = np.zeros((1, *geometry.positions_marker.shape))
    return observe(geometry, Poses.stack([pose]), white, IDEAL, 0)


def tracker_of(truth, seed=1, ordinal=0, **kwargs):
    tracker = VirtualTracker(CaptureClock(), ScriptedWorld(truth), seed)
    tracker.begin(TrackerSettings(**kwargs), ordinal)
    return tracker


@settings(max_examples=25)
@given(seeds)
def test_an_ideal_tracker_returns_the_true_pose(seed):
    pose = facing_pose(np.random.default_rng(seed))
    tracker = tracker_of(lambda tool, t: pose, profile="ideal")
    for tool in TOOLS:
        sample = tracker.latest().tool(tool)
        assert sample.status == "ok"
        found = sample.T_tracker_marker
        np.testing.assert_allclose(found.translation, pose.translation, atol=1e-9)
        axis = np.array((0, 0, 1.0))
        np.testing.assert_allclose(found.rotate(axis), pose.rotate(axis), atol=1e-12)
        if GEOMETRIES[tool].dof == 6:
            np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-12)
        assert sample.rms_error_mm == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", [0, 5, 9])
def test_the_polaris_error_is_035_mm_over_the_volume_and_three_times_deeper_than_wide(seed):
    error = marker_error(TrackerSettings(profile="polaris"), seed)
    rng = np.random.default_rng(seed)
    points = sample_volume(20000, rng)
    off = error.measure(points, rng.standard_normal(points.shape)) - points
    rms = np.sqrt((off**2).mean(axis=0))
    assert np.linalg.norm(rms) == pytest.approx(0.35, rel=0.03)
    assert rms[2] / np.sqrt(rms[0] * rms[1]) == pytest.approx(3.0, rel=0.05)
    white = error.white_mm
    assert np.linalg.norm(white) == pytest.approx(0.05, rel=1e-9)
    np.testing.assert_allclose(white[2] / white[:2], 3.0)


def test_white035_is_equal_in_all_directions_without_a_field():
    error = marker_error(TrackerSettings(profile="white035"), 3)
    rng = np.random.default_rng(0)
    points = sample_volume(5000, rng)
    np.testing.assert_array_equal(error.bias_mm(points), 0.0)
    off = error.measure(points, rng.standard_normal(points.shape)) - points
    assert np.sqrt((off**2).sum(axis=1).mean()) == pytest.approx(0.35, rel=0.02)
    np.testing.assert_allclose(np.sqrt((off**2).mean(axis=0)), 0.35 / np.sqrt(3), rtol=0.05)


def test_averaging_removes_the_white_noise_but_not_the_field():
    tracker = tracker_of(lambda tool, t: FACING, seed=4)
    model = GEOMETRIES["toolmarker"].positions_marker
    found = [tracker.frame(k).tool("toolmarker").T_tracker_marker for k in range(600)]
    mean = np.mean([pose.translation for pose in found], axis=0)
    bias = marker_error(TrackerSettings(profile="polaris"), 4).bias_mm(FACING @ model)
    expected = register_points(model, FACING @ model + bias).T_b_a.translation
    assert np.linalg.norm(mean - expected) < 0.005
    assert np.linalg.norm(mean - FACING.translation) > 0.05


def test_the_field_is_smooth_and_belongs_to_the_device():
    error = marker_error(TrackerSettings(profile="polaris"), 2)
    points = sample_volume(500, np.random.default_rng(0))
    near = points + 1.0
    assert np.abs(error.bias_mm(near) - error.bias_mm(points)).max() < 0.01
    again = tracker_of(lambda tool, t: FACING, seed=2, ordinal=9)
    other = tracker_of(lambda tool, t: FACING, seed=2, ordinal=1)
    shift = (
        again.latest().tools[0].T_tracker_marker.translation
        - other.latest().tools[0].T_tracker_marker.translation
    )
    assert 0.0 < np.linalg.norm(shift) < 0.2  # white noise differs, the field does not


def test_the_same_seed_gives_the_same_frames_however_often_somebody_looks():
    def run(lookers):
        clock = CaptureClock()
        tracker = VirtualTracker(
            clock, ScriptedWorld(lambda tool, t: FACING @ Pose.from_translation((t, 0, 0))), 8
        )
        tracker.begin(TrackerSettings(rate_hz=50.0), 2)
        result = []
        for frame in tracker.frames():
            for _ in range(lookers):
                tracker.latest()
            result.append(frame)
            if frame.number == 20:
                return result

    for a, b in zip(run(0), run(3), strict=True):
        assert (a.number, a.time_s) == (b.number, b.time_s)
        for x, y in zip(a.tools, b.tools, strict=True):
            np.testing.assert_array_equal(x.T_tracker_marker.matrix(), y.T_tracker_marker.matrix())
            assert x.rms_error_mm == y.rms_error_mm


def test_latest_is_the_last_of_the_frames_and_does_not_move_the_clock():
    clock = CaptureClock()
    tracker = VirtualTracker(clock, ScriptedWorld(lambda tool, t: FACING), 1)
    tracker.begin(TrackerSettings(rate_hz=20.0), 0)
    for frame in tracker.frames():
        newest = tracker.latest()
        assert newest.number == frame.number
        assert clock.now() == frame.time_s == frame.number / 20.0
        np.testing.assert_array_equal(
            newest.tools[0].T_tracker_marker.matrix(), frame.tools[0].T_tracker_marker.matrix()
        )
        if frame.number > 30:
            break


def test_frames_skip_what_went_by_unseen():
    clock = CaptureClock()
    tracker = VirtualTracker(clock, ScriptedWorld(lambda tool, t: FACING), 1)
    frames = tracker.frames()
    assert next(frames).number == 0
    clock.wait_until(1.0)
    assert next(frames).number == 60
    assert next(frames).number == 61


def test_a_covered_tool_yields_no_poses_and_the_others_stay():
    tracker = tracker_of(lambda tool, t: FACING, hidden_tools=("toolmarker",))
    for k in range(10):
        frame = tracker.frame(k)
        assert frame.tool("toolmarker").status == "covered"
        assert frame.tool("toolmarker").T_tracker_marker is None
        assert frame.tool("toolmarker").rms_error_mm is None
        assert frame.tool("pointer6d").T_tracker_marker is not None


def test_covering_one_tool_does_not_change_the_noise_of_another():
    a = tracker_of(lambda tool, t: FACING).frame(5).tool("pointer6d")
    b = tracker_of(lambda tool, t: FACING, hidden_tools=("toolmarker",)).frame(5).tool("pointer6d")
    np.testing.assert_array_equal(a.T_tracker_marker.matrix(), b.T_tracker_marker.matrix())


@pytest.mark.parametrize(
    ("pose", "status"),
    [
        (Pose(np.eye(3), np.array((0, 0, 1900.0))), "out_of_view"),  # turned away
        (Pose(FACING.rotation, np.array((0, 0, 1000.0))), "out_of_volume"),
        (Pose(FACING.rotation, np.array((0, 0, 2700.0))), "out_of_volume"),
        (Pose(FACING.rotation, np.array((700.0, 0, 1900.0))), "out_of_volume"),
        (Pose(FACING.rotation, np.array((500.0, 0, 1900.0))), "too_few_markers"),  # half outside
    ],
)
def test_why_a_tool_is_not_seen(pose, status):
    seen = observed("toolmarker", pose)
    assert seen.statuses[0] == status
    assert not seen.seen[0]


@pytest.mark.parametrize(("tilt_deg", "visible"), [(55.0, True), (65.0, False)])
def test_flat_markers_are_lost_beyond_sixty_degrees(tilt_deg, visible):
    tilt = Rotation.from_rotvec((np.deg2rad(tilt_deg), 0, 0)).as_matrix()
    pose = Pose(tilt @ FACING.rotation, FACING.translation)
    assert observed("pointer6d", pose).seen[0] == visible


def test_three_of_four_markers_are_enough_and_exact():
    pose = Pose(FACING.rotation, np.array((461.0, 0, 1900.0)))  # one marker pokes out of the silo
    model = GEOMETRIES["toolmarker"].positions_marker
    assert np.count_nonzero(in_volume(pose @ model)) == 3
    seen = observed("toolmarker", pose)
    np.testing.assert_allclose(seen.Ts_tracker_marker[0].matrix(), pose.matrix(), atol=1e-9)


def test_a_tool_that_is_not_there_is_out_of_view():
    sample = tracker_of(lambda tool, t: None).latest().tool("pointer5d")
    assert (sample.status, sample.T_tracker_marker) == ("out_of_view", None)


def test_the_volume_is_a_silo():
    inside = [(0, 0, 1401.0), (0, 0, 2399.0), (499, 0, 2399.0), (0, 499, 1320.0)]
    outside = [(0, 0, 1399.0), (0, 0, 2401.0), (501, 0, 2000.0), (0, 499, 1300.0), (0, 0, -1900.0)]
    assert in_volume(inside).all()
    assert not in_volume(outside).any()


def test_a_closed_tracker_says_so():
    tracker = tracker_of(lambda tool, t: FACING)
    running = tracker.frames()
    next(running)
    tracker.close()
    tracker.close()
    assert list(running) == []
    with pytest.raises(DeviceError, match="closed"):
        tracker.latest()


def swaying(tool, time_s):
    """A tool that sways across the limit at which its markers are lost."""
    tilt = np.deg2rad(59.0 + 8.0 * np.sin(2.0 * time_s))
    turned = Rotation.from_rotvec((tilt, 0.0, 0.0)).as_matrix() @ FACING.rotation
    return Pose(turned, FACING.translation + np.array((5.0 * time_s, 0.0, 0.0)))


def test_a_block_of_frames_is_what_they_are_one_by_one():
    block, single = (
        VirtualTracker(CaptureClock(), ScriptedWorld(swaying, foreseen=foreseen), 5)
        for foreseen in (True, False)
    )
    statuses = set()
    for number in (0, 7, 100, 200, BLOCK - 1, BLOCK, BLOCK + 40, 2 * BLOCK + 3):
        a, b = (tracker.frame(number).tool("toolmarker") for tracker in (block, single))
        assert a.status == b.status
        statuses.add(a.status)
        if a.T_tracker_marker is not None:
            matrices = a.T_tracker_marker.matrix(), b.T_tracker_marker.matrix()
            np.testing.assert_allclose(*matrices, atol=1e-9)
            assert a.rms_error_mm == pytest.approx(b.rms_error_mm, abs=1e-12)
    assert statuses == {"ok", "out_of_view"}


def test_a_frame_is_the_same_to_the_bit_whatever_was_asked_for_before():
    def matrix(tracker, number):
        return tracker.frame(number).tool("pointer6d").T_tracker_marker.matrix()

    def moving(tool, time_s):
        return FACING @ Pose.from_translation((time_s, 0, 0))

    first, other = (tracker_of(moving) for _ in range(2))
    wanted = [matrix(first, number) for number in range(0, 3 * BLOCK, 61)]
    again = [matrix(other, number) for number in reversed(range(0, 3 * BLOCK, 61))]
    np.testing.assert_array_equal(wanted, again[::-1])


def test_a_motion_that_becomes_another_is_seen_from_the_next_frame_on():
    place = [0.0]
    world = ScriptedWorld(lambda tool, t: FACING @ Pose.from_translation((place[0], 0, 0)))
    tracker = VirtualTracker(CaptureClock(), world, 1)
    tracker.begin(IDEAL, 0)

    def x_mm(number):
        return tracker.frame(number).tool("pointer6d").T_tracker_marker.translation[0]

    assert x_mm(3) == pytest.approx(0.0, abs=1e-9)
    place[0], world.changes = 40.0, 1
    assert x_mm(4) == pytest.approx(40.0, abs=1e-9)
