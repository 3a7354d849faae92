import threading
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rona_core.app.messages.message import message_from, serialize_arguments
from rona_core.app.runtime.session_step import replay
from rona_core.app.runtime.workbench import Workbench
from rona_core.app.steps.pointer.messages import StartPointerCapture
from rona_core.compose import build_virtual_rig, virtual_services
from rona_core.devices.settings import DeviceSettings
from rona_core.errors import (
    DegenerateGeometryError,
    DeviceError,
    InvalidInputError,
    SessionFormatError,
)
from rona_core.session.document import Session
from rona_core.virtual.operator.manual_pivot import MAX_TURN_RAD_S
from tests.core.virtual.test_operator import operator_of


def wxyz(axis, degrees):
    return Rotation.from_rotvec(np.deg2rad(degrees) * np.array(axis)).as_quat(scalar_first=True)


@pytest.mark.sweep(1)
@pytest.mark.parametrize("pointer", ["pointer6d", "pointer5d"])
def test_the_tip_rests_and_the_shaft_follows_at_a_bounded_speed(pointer):
    scene, operator = operator_of(3, pointer)
    assert operator.pivot_by_hand(duration_s=5.0) == 5.0
    motion = operator.motion()
    start = motion.shaft_base(0.0)
    operator.turn(wxyz((1.0, 0.0, 0.0), 80.0))
    times = np.arange(0.0, 3.0, 0.05)
    poses = [motion.Ts_base_pointermarker(np.array([t]))[0] for t in times]
    tips = [pose @ scene.tips[pointer] for pose in poses]
    np.testing.assert_allclose(tips, np.tile(scene.dimple_base, (len(times), 1)), atol=1e-9)
    steps = [
        Rotation.from_matrix(b.rotation @ a.rotation.T).magnitude() for a, b in pairwise(poses)
    ]
    assert max(steps) <= MAX_TURN_RAD_S * 0.05 + np.deg2rad(2.0)  # and the tremor
    wanted = Rotation.from_rotvec((np.deg2rad(80.0), 0.0, 0.0)).apply(start)
    assert np.arccos(motion.shaft_base(3.0) @ wanted) < np.deg2rad(2.0)
    again = motion.Ts_base_pointermarker(np.array([times[7]]))[0]
    np.testing.assert_allclose(again.rotation, poses[7].rotation, atol=1e-12)


def test_turning_is_refused_by_name():
    _, operator = operator_of()
    with pytest.raises(DeviceError, match="by hand"):
        operator.turn((1.0, 0.0, 0.0, 0.0))
    operator.pivot_by_hand(duration_s=5.0)
    for bad in ((2.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (np.nan, 0.0, 0.0, 0.0)):
        with pytest.raises(InvalidInputError, match="wxyz"):
            operator.turn(bad)
    operator.finish()
    assert not operator.in_hand()
    with pytest.raises(DeviceError):
        operator.turn((1.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize("pace", [None, 0.5, 8.0])
def test_the_clock_runs_in_real_time_only_meanwhile(pace):
    rig = build_virtual_rig(Session().setup, pace)
    for end in (rig.operator.finish, lambda: rig.begin(DeviceSettings(), 1)):
        rig.operator.pivot_by_hand(duration_s=5.0)
        rig.operator.pivot_by_hand(duration_s=5.0)
        assert rig.clock.speed == 1.0
        end()
        assert rig.clock.speed == pace
        rig.operator.finish()
        assert rig.clock.speed == pace
    rig.close()


def bench_at(tmp_path, monkeypatch, speed):
    """A workbench on which somebody pivots by hand at this speed, so that the test is short."""
    monkeypatch.setattr("rona_core.virtual.operator.operator.BY_HAND_SPEED", speed)
    return Workbench(Session(), virtual_services(), tmp_path)


@pytest.mark.slow
def test_a_pointer_turned_by_a_thread_is_calibrated(tmp_path, monkeypatch):
    bench = bench_at(tmp_path, monkeypatch, 8.0)
    ended = threading.Event()

    def turn():
        k = 0
        while not ended.wait(0.01):
            if bench.pointer_in_hand():
                k += 1
                axis = (np.cos(0.15 * k), np.sin(0.15 * k), 0.0)
                bench.turn_pointer(wxyz(axis, 20.0))
                if k == 200:
                    bench.finish_pointer()
                    return

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        session = bench.run(StartPointerCapture(duration_s=60.0, by_hand=True))
    finally:
        ended.set()
        thread.join(10)
    assert not session.captures.pointer.partial
    assert session.captures.pointer.marker.times_s[-1] < 59.0  # finished before its time
    assert [same.same for same in replay(session) if same.result == "pointer"] == [True]
    assert bench.rig().clock.speed is None
    truth = bench.rig().scene.tips["pointer6d"]
    assert np.linalg.norm(session.results.pointer.value.tip_pointermarker - truth) < 1.0
    with pytest.raises(DeviceError):
        bench.turn_pointer((1.0, 0.0, 0.0, 0.0))
    bench.close()


def test_a_pointer_that_nobody_turned_is_refused_by_name(tmp_path, monkeypatch):
    bench = bench_at(tmp_path, monkeypatch, 50.0)
    with pytest.raises(DegenerateGeometryError, match="hardly turned"):
        bench.run(StartPointerCapture(duration_s=5.0, by_hand=True))
    assert bench.session.captures.pointer is not None
    assert bench.session.results.pointer is None
    bench.close()


def test_cancel_keeps_the_recording_and_lets_the_pointer_go(tmp_path, monkeypatch):
    bench = bench_at(tmp_path, monkeypatch, 50.0)
    frames = []
    activity = StartPointerCapture(duration_s=60.0, by_hand=True)
    session = bench.run(activity, frames.append, lambda: len(frames) >= 100)
    assert session.captures.pointer.partial
    assert len(session.captures.pointer.marker.times_s) == 100
    assert session.results.pointer is None
    assert not bench.pointer_in_hand()
    assert bench.rig().clock.speed is None
    bench.close()


def test_a_message_of_an_older_log_lacks_only_what_has_a_default():
    old = serialize_arguments(StartPointerCapture(cone_deg=20.0))
    del old["by_hand"]
    assert message_from("StartPointerCapture", old) == StartPointerCapture(cone_deg=20.0)
    with pytest.raises(SessionFormatError, match="does not know by_foot"):
        message_from("StartPointerCapture", {**old, "by_foot": True})
    with pytest.raises(SessionFormatError, match="lacks seed"):
        message_from("SetSeed", {})
