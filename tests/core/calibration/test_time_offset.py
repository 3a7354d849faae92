"""The delay between two streams of one motion: known delays, honest sigma, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rona_core.calibration.timing.time_offset import estimate_time_offset
from rona_core.errors import DegenerateGeometryError, InvalidInputError

seeds = st.integers(0, 2**32 - 1)
TIMES_A = np.arange(0.0, 10.0, 1.0 / 60.0)
TIMES_B = np.arange(0.004, 10.0, 1.0 / 50.0)


def motion(rng):
    """A smooth irregular motion of some centimetres."""
    frequencies = rng.uniform(0.1, 1.2, (6, 3))
    phases = rng.uniform(0.0, 2.0 * np.pi, (6, 3))
    amplitudes = rng.normal(0.0, 25.0, (6, 3))

    def at(times_s):
        angles = 2.0 * np.pi * frequencies * np.asarray(times_s)[:, None, None] + phases
        return (amplitudes * np.sin(angles)).sum(axis=1)

    return at


@settings(max_examples=15)
@given(seeds)
def test_a_known_delay_is_found_without_noise(seed):
    rng = np.random.default_rng(seed)
    place, delay = motion(rng), rng.uniform(-0.15, 0.15)
    rotation = Rotation.random(rng=rng)
    b = rotation.apply(place(TIMES_B - delay)) + rng.uniform(-2000, 2000, 3)
    found = estimate_time_offset(TIMES_A, place(TIMES_A), TIMES_B, b)
    assert found.offset_s == pytest.approx(delay, abs=2e-4)  # the rates differ
    assert found.correlation > 0.9999


@settings(max_examples=10)
@given(seeds)
def test_streams_exchanged_have_the_opposite_delay(seed):
    rng = np.random.default_rng(seed)
    place, delay = motion(rng), rng.uniform(-0.1, 0.1)
    a, b = place(TIMES_A), place(TIMES_B - delay)
    there = estimate_time_offset(TIMES_A, a, TIMES_B, b)
    back = estimate_time_offset(TIMES_B, b, TIMES_A, a)
    assert there.offset_s == pytest.approx(-back.offset_s, abs=2e-4)


@settings(max_examples=10)
@given(seeds)
def test_moving_a_frame_or_a_clock_changes_nothing_else(seed):
    rng = np.random.default_rng(seed)
    place = motion(rng)
    a, b = place(TIMES_A), place(TIMES_B - 0.03) + rng.normal(0, 0.2, (len(TIMES_B), 3))
    first = estimate_time_offset(TIMES_A, a, TIMES_B, b)
    turned = Rotation.random(rng=rng).apply(b) + rng.uniform(-2000, 2000, 3)
    second = estimate_time_offset(TIMES_A, a, TIMES_B, turned)
    assert second.offset_s == pytest.approx(first.offset_s, abs=1e-6)
    assert second.sigma_s == pytest.approx(first.sigma_s, rel=1e-3)
    later = estimate_time_offset(TIMES_A + 100.0, a, TIMES_B + 100.0, b)
    assert later.offset_s == pytest.approx(first.offset_s, abs=1e-6)


@pytest.mark.slow
def test_the_stated_sigma_is_that_of_the_errors():
    scores, errors = [], []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        place, delay = motion(rng), rng.uniform(-0.1, 0.1)
        times = TIMES_B if seed % 2 else TIMES_A + 0.003
        a = place(TIMES_A) + rng.normal(0, 0.02, (len(TIMES_A), 3))
        b = place(times - delay) + rng.normal(0, 0.35, (len(times), 3))
        found = estimate_time_offset(TIMES_A, a, times, b)
        errors.append(found.offset_s - delay)
        scores.append(errors[-1] / found.sigma_s)
    assert np.sqrt(np.mean(np.square(errors))) < 2e-4  # a hundredth of a frame
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.6


def test_dropped_frames_do_not_shift_the_delay():
    rng = np.random.default_rng(5)
    place = motion(rng)
    kept = np.sort(rng.choice(len(TIMES_A), int(0.8 * len(TIMES_A)), replace=False))
    b = place(TIMES_A - 0.0142)[kept]
    found = estimate_time_offset(TIMES_A, place(TIMES_A), TIMES_A[kept], b)
    assert found.offset_s == pytest.approx(0.0142, abs=3e-4)


def circle(times_s):
    angle = 1.3 * np.asarray(times_s)
    return 80.0 * np.stack((np.cos(angle), np.sin(angle), np.zeros(len(angle))), axis=1)


def swing(times_s):
    times_s = np.asarray(times_s)
    waves = (np.sin(40.0 * times_s), np.sin(80.0 * times_s + 1.0), np.zeros(len(times_s)))
    return 50.0 * np.stack(waves, axis=1)


@pytest.mark.parametrize(
    ("a", "b", "words"),
    [
        (lambda t: np.zeros((len(t), 3)), motion(np.random.default_rng(0)), "stream a moves"),
        (motion(np.random.default_rng(0)), lambda t: np.zeros((len(t), 3)), "stream b moves"),
        (circle, circle, "even|stands out"),
        (swing, lambda t: swing(t - 0.03), "repeats itself"),
        (
            motion(np.random.default_rng(0)),
            motion(np.random.default_rng(1)),
            "do not show the same motion",
        ),
        (
            motion(np.random.default_rng(2)),
            lambda t: motion(np.random.default_rng(2))(t - 0.4),
            "stands out|same motion",
        ),
    ],
)
def test_what_cannot_tell_the_delay_is_refused(a, b, words):
    noise = np.random.default_rng(9).normal(0, 0.05, (len(TIMES_B), 3))
    with pytest.raises(DegenerateGeometryError, match=words):
        estimate_time_offset(TIMES_A, a(TIMES_A), TIMES_B, b(TIMES_B) + noise)


@pytest.mark.parametrize(
    ("times_b", "words"),
    [
        (TIMES_A[:-1], "as many times"),
        (TIMES_A[::-1], "must grow"),
        (TIMES_A + 9.0, "in common"),
    ],
)
def test_times_that_make_no_sense_are_refused(times_b, words):
    points = motion(np.random.default_rng(0))(TIMES_A)
    with pytest.raises(InvalidInputError, match=words):
        estimate_time_offset(TIMES_A, points, times_b, points)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("latency_ms", [0.0, 14.0, 60.0])
def test_the_latency_of_the_virtual_tracker_shows_against_the_robot(latency_ms):
    from rona_core.devices.settings import DeviceSettings, RobotSettings, TrackerSettings
    from rona_core.robot.planning.calibration_motion import ToolMotionSettings, plan_tool_motion
    from rona_core.virtual.rig import VirtualRig
    from tests.helpers.sphere_world import SphereSpecimen

    tracker, robot = TrackerSettings(latency_ms=latency_ms), RobotSettings(latency_ms=0.0)
    rig = VirtualRig(2, SphereSpecimen(), DeviceSettings(tracker=tracker, robot=robot))
    plan = plan_tool_motion(rig.model, ToolMotionSettings(cone_deg=20.0, n_pivot=12, n_translate=4))
    rig.robot.place(plan.qs_rad[0])
    rig.begin(rig.scene.settings, 1)
    moving = rig.robot.move(plan.times_s, plan.qs_rad)
    times, joints, seen = [], [], []
    for frame in rig.tracker.frames():
        times.append(frame.time_s)
        joints.append(rig.robot.state().q_rad)
        seen.append(frame.tool("toolmarker").T_tracker_marker.translation)
        if moving.done():
            break
    rig.close()
    flanges = rig.model.forward(np.array(joints))
    marker_base = flanges @ np.tile(rig.model.T_flange_toolmarker.translation, (len(times), 1))
    found = estimate_time_offset(times, marker_base, times, np.array(seen))
    assert found.offset_s == pytest.approx(latency_ms / 1000.0, abs=max(5e-4, 3 * found.sigma_s))
    assert found.sigma_s < 1e-3
